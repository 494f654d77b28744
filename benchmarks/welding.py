"""What a weld misses by: medians over seeds that nothing was tuned on, in the situations that a user would try."""

from benchmarks.accuracy import FEWER_SEEDS, Case, tables
from benchmarks.table import Figure

TORCH = tuple(f"torch_{way}_{what}_error_mm" for way in ("lateral", "vertical") for what in ("mean", "max"))
PICTURES = ("pictures_count", "pictures_valid_count")
CALM = ("--no-weld.arc", "--weld.drift-mm", "0")
FAST = ("--weld.speed-mm-s", "100", "--weld.frame-hz", "100")
NEAR = ("--weld.misplacement-mm", "1", "--weld.misplacement-deg", "0.3")
"""What through-arc sensing can begin with: it must start between the groove's walls."""


def _weld(*options: str, more: tuple[str, ...] = (), **case: tuple[int, ...]) -> Case:
    return Case(scenario="weld", options=options, metrics=(*TORCH, "seam_lost_count", *more), **case)


CASES = {
    "10 mm/s, misplaced 5 mm, drift 2 mm, arc on": _weld(more=(*PICTURES, "seam_end_error_mm")),
    "the same without drift model": _weld("--no-weld.drift-model", seeds=FEWER_SEEDS),
    "10 mm/s, misplaced 10 mm and 3 deg, drift 2 mm, arc on, 10 % of the pictures lost": _weld(
        "--weld.misplacement-mm", "10", "--weld.misplacement-deg", "3", "--weld.lost-frames-ratio", "0.1",
        more=PICTURES,
        seeds=FEWER_SEEDS,
    ),
    "100 mm/s, calm": _weld(*FAST, *CALM),
    "100 mm/s, calm, without feed-forward": _weld(*FAST, *CALM, "--no-weld.feed-forward", seeds=FEWER_SEEDS),
    "scan, then weld, calm": _weld("--weld.guidance", "scan", *CALM),
    "through-arc, misplaced 1 mm, drift 2 mm": _weld("--weld.guidance", "arc", *NEAR),
    "laser on the same seam, weaving": _weld(*NEAR, "--weld.weave", "sine", seeds=FEWER_SEEDS),
    "nothing guides": _weld("--weld.guidance", "none", seeds=FEWER_SEEDS),
}  # fmt: skip


def figures() -> dict[str, list[Figure]]:
    """Median errors in each situation, with what is asked for where something is."""
    return {title: [_asked(title, figure) for figure in rows] for title, rows in tables(CASES).items()}


def _asked(title: str, figure: Figure) -> Figure:
    limits = {"10 mm/s, misplaced 5 mm": (0.12, 0.4), "100 mm/s, calm:": (0.15, None)}
    mean, most = next((limit for start, limit in limits.items() if title.startswith(start)), (None, None))
    at_most = {"torch_lateral_mean_error": mean, "torch_lateral_max_error": most}.get(figure.name)
    return Figure(name=figure.name, value=figure.value, unit=figure.unit, at_most=at_most)

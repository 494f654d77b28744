"""Square butt joints: plates whose light stops at their edges.

An edge is where the light of a plate stops, not where two lines cross, so its place is known to half a column or so
(`curve_end`). A gap may be dark or show what lies below it; both are columns without the plate.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from weldcell.tracking.candidates import (
    EXPLAINED_M,
    MOST_SIGMA_M,
    best_of,
    is_near,
    is_plate_pair,
    mismatch_m,
    near_words,
    on_model,
    unlikelihood,
)
from weldcell.tracking.curve_end import PLATE_LOST_SHARE, End, curve_end
from weldcell.tracking.curves import Curve, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.section import Corner, Section

BUTT_NAMES = ("left", "right")
_STEEPEST = 2.0  # only the plates are looked for
_NEIGHBOURS = 12
_FEWEST_POINTS = 60
_FEWEST_ON_PLATE = 25
_LEAST_INLIER_SHARE = 0.4
_LEAST_EXPLAINED = 0.5
_LEAST_PLATE_M = 3e-3
_HOLE_SPACINGS = 2.5
_MOST_HOLES = 4
_MOST_GAP_M = 0.012
_MOST_MISMATCH_M = 5e-3
_VISIBLE_STEP_SIGMAS = 4.0
_LEAST_STEP_M = 1e-4
_BESIDE_M = 1e-2  # of the plate beside an edge, to tell what strays are usual on it
_BEYOND_M = 1e-3
_LEAST_NATS = 14.0  # one in some 1400 columns may begin a gap, which costs 7; as much again keeps runs of strays out
_KNOWN_NATS = 6.0  # of these, where the last frame says which fifty columns it is in
_SAME_GAP_NATS, _SAME_GAP_M = 5.0, 2.5e-4  # and of the others, where it was as wide: dark runs are of any length
_RISE_M = 3e-4  # what lies higher above the plates inside a gap covers it
_COVERED_SHARE = 0.5
_FITTED_M = 0.012  # of each plate of a butt joint: its ends matter, and it may be bent


@dataclass(frozen=True, kw_only=True)
class _Gap:
    """A stretch that may be a butt joint's gap, and the plates beside it."""

    start_m: float
    end_m: float
    plates: tuple[Curve, Curve]
    ends: tuple[End, End]

    @property
    def nats(self) -> float:
        """Evidence of the gap, which both ends must give: they count the same columns."""
        return min(self.ends[0].nats, self.ends[1].nats)

    @property
    def middle_m(self) -> float:
        return (self.ends[0].corner.x_m + self.ends[1].corner.x_m) / 2


def find_butt(section: Section, previous_x_m: float | None = None, *, previous_gap_m: float | None = None) -> Found:
    """The two edges of a square butt joint: of a gap, of a step, or of both.

    A gap as wide as the last frame's needs less evidence.
    """
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a butt joint (at least {_FEWEST_POINTS})")
    pieces = [
        piece
        for piece in straight_pieces(section, steepest=_STEEPEST, neighbours=_NEIGHBOURS)
        if _length_m(piece) >= _LEAST_PLATE_M
    ]
    found = [_gap(section, start, end, (right, left), 1) for start, end, right, left in _stretches(section, pieces)]
    gaps = [gap for gap in found if gap is not None and is_near(gap.middle_m, previous_x_m)]
    least = _LEAST_NATS - (0.0 if previous_x_m is None else _KNOWN_NATS)
    scores = [
        gap.nats - least - unlikelihood(gap.middle_m, previous_x_m) + _alike_nats(gap, previous_gap_m) for gap in gaps
    ]
    best = best_of(scores, [gap.middle_m for gap in gaps])
    if best is None:
        return Found(reason=f"no butt joint{near_words(previous_x_m)}: no gap or step between two plates")
    gap = gaps[best[0]]
    return _butt(section, _gap(section, gap.start_m, gap.end_m, gap.plates, 3) or gap, best[1])


def _alike_nats(gap: _Gap, previous_gap_m: float | None) -> float:
    """What the last frame's gap, if it is known, says for this one."""
    if not previous_gap_m:
        return 0.0
    width_m = _along(gap.plates, gap.ends[0].corner, gap.ends[1].corner)
    return _SAME_GAP_NATS if abs(width_m - previous_gap_m) <= _SAME_GAP_M else 0.0


def _stretches(section: Section, pieces: list[Piece]) -> list[tuple[float, float, Curve, Curve]]:
    """Where a gap may lie (from x to x), with the lines of the plates on its right (smaller x) and left."""
    lines = [line_curve(piece.slope, piece.intercept_m) for piece in pieces]
    found = []
    for i, j in combinations(range(len(pieces)), 2):
        right, left = pieces[i], pieces[j]
        middle = (right.end_m + left.start_m) / 2
        between = all(piece.z_at(middle) > max(right.z_at(middle), left.z_at(middle)) for piece in pieces[i + 1 : j])
        fits = is_plate_pair(right, left) and left.start_m - right.end_m <= _MOST_GAP_M
        if fits and between and abs(right.z_at(middle) - left.z_at(middle)) <= _MOST_MISMATCH_M:
            found.append((right.end_m, left.start_m, lines[i], lines[j]))
    for piece, line in zip(pieces, lines, strict=True):
        found += [(start, end, line, line) for start, end in _holes(section, piece)]
    return found


def _holes(section: Section, piece: Piece) -> list[tuple[float, float]]:
    """The widest stretches of a piece without points on it: a narrow gap on one level does not part it in two."""
    x_m, z_m = section.x_m, section.z_m
    near = (x_m >= piece.start_m) & (x_m <= piece.end_m)
    near &= np.abs(z_m - piece.intercept_m - piece.slope * x_m) <= EXPLAINED_M
    steps = np.diff(x_m[near])
    if not len(steps):
        return []
    wide = np.flatnonzero((steps > _HOLE_SPACINGS * np.median(steps)) & (steps <= _MOST_GAP_M))
    wide = wide[np.argsort(steps[wide])[::-1][:_MOST_HOLES]]
    return [(float(x_m[near][k]), float(x_m[near][k + 1])) for k in wide]


def _gap(section: Section, start: float, end: float, starts: tuple[Curve, Curve], degree: int) -> _Gap | None:
    """The gap about a stretch, with plates fitted beside it; None where there is none."""
    x = section.x_m
    right = fit_curve(section.only((x >= start - _FITTED_M) & (x <= start)), starts[0], highest_degree=degree)
    left = fit_curve(section.only((x >= end) & (x <= end + _FITTED_M)), starts[1], highest_degree=degree)
    if right is None or left is None or min(right.count, left.count) < _FEWEST_ON_PLATE:
        return None
    if min(right.inlier_share, left.inlier_share) < _LEAST_INLIER_SHARE:
        return None
    middle = (start + end) / 2
    step_m = abs(right.z_at(middle) - left.z_at(middle))
    noise_m = float(np.median(section.sigma_m)) * max(right.sigmas, left.sigmas, 1.0)
    if step_m > max(_VISIBLE_STEP_SIGMAS * noise_m, _LEAST_STEP_M):
        beyond = _BEYOND_M
    else:
        beyond = 0.0
        start, end = _widest_hole(section, (right, left), start - _BEYOND_M, end + _BEYOND_M)
    right_end = curve_end(section, right, start - _BESIDE_M, end + beyond, lost_share=PLATE_LOST_SHARE)
    left_end = curve_end(section, left, end + _BESIDE_M, start - beyond, lost_share=PLATE_LOST_SHARE)
    if right_end is None or left_end is None:
        return None
    return _Gap(start_m=start, end_m=end, plates=(right, left), ends=(right_end, left_end))


def _widest_hole(section: Section, plates: tuple[Curve, Curve], start: float, end: float) -> tuple[float, float]:
    """Between two x, the widest stretch without points of either plate: on one level, each goes on in the other."""
    reach = end - start
    on = on_model(section, [(plate, start - reach, end + reach) for plate in plates])
    x_m = np.sort(section.x_m[on & (section.x_m >= start) & (section.x_m <= end)])
    if len(x_m) < 2:
        return start, end
    widest = int(np.diff(x_m).argmax())
    return float(x_m[widest]), float(x_m[widest + 1])


def _butt(section: Section, gap: _Gap, margin: float) -> Found:
    right, left = gap.ends[0].corner, gap.ends[1].corner
    inside = (section.x_m > right.x_m) & (section.x_m < left.x_m)
    level = np.interp(section.x_m[inside], [right.x_m, left.x_m], [right.z_m, left.z_m])
    columns = (left.x_m - right.x_m) / float(np.median(np.diff(section.x_m)))
    if np.sum(section.z_m[inside] < level - _RISE_M) > max(_COVERED_SHARE * columns, 2):
        return Found(reason="no butt joint: something stands in the gap, such as a tack weld")
    if left.x_m - right.x_m > _MOST_GAP_M:
        return Found(reason=f"no butt joint: a gap of {(left.x_m - right.x_m) * 1e3:.1f} mm is too wide")
    worst = max(right.sigma_m, left.sigma_m)
    if worst > MOST_SIGMA_M:
        return Found(reason=f"butt joint too uncertain: an edge has a standard deviation of {worst * 1e3:.2f} mm")
    low, high = right.x_m - _BESIDE_M, left.x_m + _BESIDE_M
    explained = _share(section, [(gap.plates[0], low, right.x_m), (gap.plates[1], left.x_m, high)])
    if explained < _LEAST_EXPLAINED:
        return Found(reason="no butt joint: most points beside the gap lie off the plates")
    measures = {
        "gap_m": max(_along(gap.plates, right, left), 0.0),
        "mismatch_m": mismatch_m(gap.plates[0], right, gap.plates[1], left),
        "angle_rad": gap.plates[1].angle_at(left.x_m) - gap.plates[0].angle_at(right.x_m),
    }
    support = min(plate.count for plate in gap.plates)
    return Found(
        corners=(left, right), measures=measures, trust=Trust(explained=explained, margin=margin, support=support)
    )


def _along(plates: tuple[Curve, Curve], right: Corner, left: Corner) -> float:
    """Distance of the edges along the plates' mean direction."""
    tilt = (plates[0].angle_at(right.x_m) + plates[1].angle_at(left.x_m)) / 2
    return float((left.x_m - right.x_m) * np.cos(tilt) + (left.z_m - right.z_m) * np.sin(tilt))


def _share(section: Section, model: list[tuple[Curve, float, float]]) -> float:
    """Share of the points within the curves' stretches that lie on them."""
    inside = np.zeros(len(section.x_m), dtype=bool)
    for _, low, high in model:
        inside |= (section.x_m >= low) & (section.x_m <= high)
    return float(on_model(section, model)[inside].mean()) if inside.any() else 0.0


def _length_m(piece: Piece) -> float:
    return (piece.end_m - piece.start_m) * float(np.hypot(1, piece.slope))

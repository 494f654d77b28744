"""`python -m benchmarks.detector_tables`: the detectors compared in tables, for the console and for a page."""

import argparse
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float
from rich.console import Console

from benchmarks.confidence import Reliability, reliability
from benchmarks.detector_examples import example_sheet
from benchmarks.detectors import (
    DETECTORS,
    GATED_MODELS,
    GATED_MORPHOLOGY,
    MODELS,
    MORPHOLOGY,
    SEED,
    TRACKS,
    Comparison,
    Outcome,
    compared,
)
from benchmarks.reliability_diagram import reliability_diagram
from benchmarks.table import Figure, Grid, show, show_grid
from joint_parts import KINDS
from joint_pictures import HIGH, NOMINAL, Level
from weldcell.models.joint_section import JointKind
from weldcell.tracking.confidence import RIGHT_WITHIN_M

_COLUMNS = (
    "across, px: median", "95 %", "across, mm: median", "max", "features, px: median", "95 %", "features, mm: median",
    "max", "valid %", "wrong %", "stripe ms", "frame ms",
)  # fmt: skip


def by_level(comparison: Comparison) -> Grid:
    """One row for each level and detector."""
    rows = [
        (f"{level}, peak/noise {snr:.3g}" if detector == MORPHOLOGY else "", detector, *_cells(outcomes))
        for level, snr in comparison.snr.items()
        for detector in DETECTORS
        for outcomes in [_of(comparison, detector=detector, level=level)]
    ]
    title = f"Detectors on {comparison.pictures} pictures"
    return Grid(title=title, columns=("level", "detector", *_COLUMNS), rows=rows)


def by_kind(comparison: Comparison, level: Level) -> Grid:
    """One row for each kind of joint, of the gated detectors."""
    rows = [
        (kind if detector == GATED_MORPHOLOGY else "", detector, *_cells(outcomes))
        for kind in KINDS
        for detector in (GATED_MORPHOLOGY, GATED_MODELS)
        for outcomes in [_of(comparison, detector=detector, level=level.name, kind=kind)]
        if outcomes
    ]
    return Grid(title=f"By joint, {level.name}", columns=("joint", "detector", *_COLUMNS), rows=rows)


def _of(
    comparison: Comparison, *, detector: str, level: str | None = None, kind: JointKind | None = None
) -> list[Outcome]:
    return [
        outcome
        for outcome in comparison.outcomes
        if outcome.detector == detector and level in (None, outcome.level.name) and kind in (None, outcome.kind)
    ]


def _cells(outcomes: list[Outcome]) -> tuple[str, ...]:
    valid = [outcome for outcome in outcomes if outcome.valid]
    across_px = np.array([outcome.across_px for outcome in valid])
    across_mm = 1e3 * np.array([outcome.across_m for outcome in valid])
    features_px = np.concatenate([outcome.features_px for outcome in valid] or [np.zeros(0)])
    features_mm = 1e3 * np.concatenate([outcome.features_m for outcome in valid] or [np.zeros(0)])
    stripe_ms = np.median([outcome.stripe_ms for outcome in outcomes])
    return (
        *_spread(across_px, 95), *_spread(across_mm, 100), *_spread(features_px, 95), *_spread(features_mm, 100),
        f"{100 * len(valid) / len(outcomes):.0f}",
        f"{100 * sum(outcome.wrong for outcome in outcomes) / len(outcomes):.1f}",
        f"{stripe_ms:.1f}" if stripe_ms else "",
        f"{np.median([outcome.whole_ms for outcome in outcomes]):.1f}",
    )  # fmt: skip


def _spread(values: Float[np.ndarray, "n"], percent: float) -> tuple[str, str]:
    if not len(values):
        return "", ""
    return f"{np.median(values):.3g}", f"{np.percentile(values, percent):.3g}"


def calibration(comparison: Comparison) -> Reliability:
    """How well the ungated models' confidence holds."""
    valid = [one for one in _of(comparison, detector=MODELS) if one.valid]
    errors_m = np.concatenate([one.features_m for one in valid])
    return reliability(np.concatenate([one.confidence for one in valid]), errors_m <= RIGHT_WITHIN_M)


def figures(comparison: Comparison) -> list[Figure]:
    """What is asked of the good detector."""
    high, nominal = (_of(comparison, detector=GATED_MODELS, level=level.name) for level in (HIGH, NOMINAL))
    every, held = _of(comparison, detector=GATED_MODELS), calibration(comparison)
    stripe_ms, whole_ms = (
        float(np.median([getattr(one, name) for one in every])) for name in ("stripe_ms", "whole_ms")
    )
    return [
        Figure(name="pictures", value=comparison.pictures, at_least=2000),
        Figure(name=f"features' median error, {NOMINAL.name}", value=_median_px(nominal), unit="px"),
        Figure(name=f"features' median error, {HIGH.name}", value=_median_px(high), unit="px", at_most=0.5),
        Figure(name=f"valid, {NOMINAL.name}", value=100 * float(np.mean([one.valid for one in nominal])), unit="%"),
        Figure(name=f"valid, {HIGH.name}", value=100 * float(np.mean([one.valid for one in high])), unit="%"),
        Figure(name="stripe and profile", value=stripe_ms, unit="ms"),
        Figure(name="the whole frame", value=whole_ms, unit="ms", at_most=5),
        Figure(name="confidence: calibration error", value=held.calibration_error, unit="probability", at_most=0.05),
        Figure(name="confidence: Brier score", value=held.brier),
    ]


def tables(console: Console) -> dict[str, list[Figure]]:
    """Prints the comparison, and returns what is asked of it."""
    comparison = compared()
    for grid in grids(comparison):
        show_grid(console, grid)
    return {"Detectors": figures(comparison)}


def grids(comparison: Comparison) -> list[Grid]:
    """All tables of a comparison."""
    kinds = [by_kind(comparison, level) for level in (NOMINAL, HIGH)]
    return [by_level(comparison), *kinds, calibration(comparison).grid()]


def _median_px(outcomes: list[Outcome]) -> float:
    return float(np.median(np.concatenate([outcome.features_px for outcome in outcomes if outcome.valid])))


def main() -> None:
    """Prints all tables; `--tracks` makes a quick run, the rest makes what docs/detectors.md shows."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--tracks", type=int, default=TRACKS, help="of each kind of joint, 40 pictures each")
    parser.add_argument("--markdown", type=Path, help="write the tables there")
    parser.add_argument("--picture", type=Path, help="draw the reliability diagram there")
    parser.add_argument("--examples", type=Path, help="draw examples there")
    given = parser.parse_args()
    comparison, console = compared(given.seed, tracks=given.tracks), Console()
    for grid in grids(comparison):
        show_grid(console, grid)
    show(console, "Detectors", figures(comparison))
    if given.markdown:
        given.markdown.write_text("\n".join(f"{grid.title}\n\n{grid.markdown()}\n" for grid in grids(comparison)))
    if given.picture:
        cv2.imwrite(str(given.picture), reliability_diagram(calibration(comparison)))
    if given.examples:
        cv2.imwrite(str(given.examples), example_sheet(given.seed))


if __name__ == "__main__":
    main()

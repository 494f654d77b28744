"""What is seen through a groove's root gap: a backing or the floor, which is no part of the groove.

It is a level run of points below level pieces of the groove's bottom that end beside it. A wall whose lower end is dark
leaves a step too, but is steep; and a drop of spatter hangs above a bottom that is wider than it, and round.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from weldcell.tracking.section import Section

_STEP_M = 6e-4  # thinner root faces than a millimetre are hardly made
_STEP_SIGMAS = 8.0
_FEWEST, _BESIDE = 4, 12  # points of a run, and those that tell how it ends
_LEVEL = 1.0  # slope of a circle's lower half
_LEAST_M2 = 1e-18


@dataclass(frozen=True, kw_only=True)
class _Run:
    """Points without a step between them."""

    points: slice
    count: int
    highest_m: float
    """The least depth."""
    first_m: float | None
    """Depth of its first points, if they are level."""
    last_m: float | None
    """Of its last ones."""


def seen_through_gap(section: Section) -> Bool[np.ndarray, "n"]:
    """Which points of a groove, in the order of the picture's columns and depth along z, are seen through its gap."""
    through = np.zeros(len(section.z_m), bool)
    if len(through) < 2 * _FEWEST:
        return through
    step_m = max(_STEP_M, _STEP_SIGMAS * section.usual_sigma_m)
    runs = _runs(section, step_m)
    for k, run in enumerate(runs):
        before, after = runs[max(k - 1, 0) : k], runs[k + 1 : k + 2]
        count = sum(one.count for one in before + after)
        if 2 * count < run.count or run.first_m is None or run.last_m is None:
            continue  # a drop of spatter above the groove's bottom
        ends_m = [one.last_m for one in before] + [one.first_m for one in after]
        through[run.points] = all(end is not None and run.highest_m > end + step_m for end in ends_m)
    return through


def _runs(section: Section, step_m: float) -> list[_Run]:
    steps = np.flatnonzero(np.abs(section.z_m[1:] - section.z_m[:-1]) > step_m)
    if not len(steps):
        return []
    bounds = [0, *(steps + 1).tolist(), len(section.z_m)]
    return [
        _Run(
            points=slice(first, end),
            count=end - first,
            highest_m=float(section.z_m[first:end].min()),
            first_m=_level_m(section, slice(first, min(first + _BESIDE, end))),
            last_m=_level_m(section, slice(max(end - _BESIDE, first), end)),
        )
        for first, end in zip(bounds[:-1], bounds[1:], strict=True)
        if end - first >= _FEWEST
    ]


def _level_m(section: Section, points: slice) -> float | None:
    """Mean depth of points that lie on a level line."""
    x_m, z_m = section.x_m[points], section.z_m[points]
    away_m, depth_m = x_m - x_m.mean(), float(z_m.mean())
    slope = float(away_m @ (z_m - depth_m)) / max(float(away_m @ away_m), _LEAST_M2)
    return depth_m if abs(slope) < _LEVEL else None

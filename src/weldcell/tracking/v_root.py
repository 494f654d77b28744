"""The root of a V-groove where the crossing of its walls is not it: with a gap, or with members of different height."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from weldcell.tracking.curve_end import curve_end
from weldcell.tracking.curves import Curve
from weldcell.tracking.quantiles import median
from weldcell.tracking.section import Corner, Section

_DEEPER_M = 3e-4
_FILLED_SHARE, _FEWEST_FILLING = 0.5, 6
_FEWEST_TELLING = 2
_LOST_SHARE, _LOST_M = 0.15, 4e-4  # of ends that lost columns or are hidden, and by how much, on average
_HIGHER_M, _HIGHER_SIGMAS = 1e-4, 1.0  # ends so much higher than the last frame's are hidden, or lost columns
_RISE_M, _KEPT_SIGMA_M = 2e-5, 8e-5  # of the depth kept: it gives way in some frames if it was too deep
_WALL_SHARE = 0.3  # from here down a wall tells what strays are usual on it


@dataclass(frozen=True, kw_only=True)
class OpenRoot:
    """The root of a groove with a gap."""

    corner: Corner
    """The middle between the walls' lower ends."""
    gap_m: float
    """Their distance."""
    depth_m: float
    """How deep they lie below their own edges."""
    seen_depth_m: float
    """How deep what is seen of the walls ends: less, where both ends are hidden."""
    filled: bool
    """Whether something fills the gap."""


def open_root(
    section: Section, curves: Sequence[Curve], corners: Sequence[Corner], kept_depth_m: float | None = None
) -> OpenRoot | None:
    """The root of a groove with a gap, from its four curves and their crossings; None if too little of it is seen.

    Ends that are clearly higher than the last frame's depth, `kept_depth_m`, are hidden: the walls go on to it.
    """
    (first, crossed, last), walls = corners, (curves[1], curves[2])
    found = [
        curve_end(section, wall, edge.x_m + _WALL_SHARE * (crossed.x_m - edge.x_m), crossed.x_m)
        for wall, edge in zip(walls, (first, last), strict=True)
    ]
    if found[0] is None or found[1] is None:
        return None
    tilt_rad = (curves[0].angle_at(first.x_m) + curves[3].angle_at(last.x_m)) / 2
    down = (-math.sin(tilt_rad), math.cos(tilt_rad))
    seen_m, variance = _depth((first, last), (found[0].corner, found[1].corner), down)
    depth_m, variance = _with_kept(seen_m, variance, kept_depth_m)
    low, high = (_at_depth(wall, edge, depth_m, down) for wall, edge in zip(walls, (first, last), strict=True))
    sigma_m = math.sqrt(variance + (low.sigma_m**2 + high.sigma_m**2) / 4)
    middle = Corner(x_m=(low.x_m + high.x_m) / 2, z_m=(low.z_m + high.z_m) / 2, sigma_m=sigma_m)
    return OpenRoot(
        corner=middle,
        gap_m=math.hypot(high.x_m - low.x_m, high.z_m - low.z_m),
        depth_m=depth_m,
        seen_depth_m=seen_m,
        filled=_is_filled(section, low, high),
    )


def stepped_root(section: Section, curves: Sequence[Curve], crossed: Corner, mismatch_m: float) -> Corner:
    """Midway between both root edges of a groove without gap, whose left member (larger x) stands higher.

    The root edges lie equally deep in their members, so the left one m above the right one, and without gap above each
    other. From the walls' crossing at depth 0, with s = dx/dz of the walls: s_left (d - m) = s_right d. Plates of
    different thickness whose walls do meet have no such step: the points go on to the crossing, which is the root.
    """
    right, left = (1 / curve.slope_at(crossed.x_m) for curve in (curves[1], curves[2]))
    right_depth_m = left * mismatch_m / (left - right)
    x_m, z_m = crossed.x_m + right * right_depth_m, crossed.z_m + right_depth_m - mismatch_m / 2
    if _goes_on(section, curves[1], curves[2], crossed.x_m, float(x_m)):
        return crossed
    return Corner(x_m=float(x_m), z_m=float(z_m), sigma_m=crossed.sigma_m)


def _goes_on(section: Section, right_wall: Curve, left_wall: Curve, crossed_x_m: float, step_x_m: float) -> bool:
    """Whether the points between a step and the walls' crossing lie on the wall that would end at the step."""
    between = section.between(min(crossed_x_m, step_x_m), max(crossed_x_m, step_x_m), ends=False)
    ending, other = (left_wall, right_wall) if crossed_x_m < step_x_m else (right_wall, left_wall)
    x_m, z_m = section.x_m[between], section.z_m[between]
    if len(x_m) < _FEWEST_TELLING:
        return False
    return median(np.abs(z_m - ending.z_of(x_m))) < median(np.abs(z_m - other.z_of(x_m)))


def _is_filled(section: Section, low: Corner, high: Corner) -> bool:
    """Whether most columns between two ends show something that is no deeper than these."""
    inside = section.between(low.x_m, high.x_m, ends=False)
    level_m = np.interp(section.x_m[inside], [low.x_m, high.x_m], [low.z_m, high.z_m])
    columns = (high.x_m - low.x_m) / section.spacing_m
    filling = np.count_nonzero(section.z_m[inside] < level_m + _DEEPER_M)
    return bool(filling > max(_FILLED_SHARE * columns, _FEWEST_FILLING))


def _depth(edges: tuple[Corner, Corner], ends: tuple[Corner, Corner], down: tuple[float, float]) -> tuple[float, float]:
    """How deep both walls end below their own edges, along `down`, and its variance.

    Root faces are alike, so both ends are equally deep, whatever the mismatch. Of ends that differ the shallower one
    may be hidden, or its last columns lost: with the probability of that against chance, the deeper one counts alone.
    """
    depths = [
        (down[0] * (end.x_m - edge.x_m) + down[1] * (end.z_m - edge.z_m), max(end.sigma_m, 1e-9) ** 2)
        for end, edge in zip(ends, edges, strict=True)
    ]
    (shallow_m, shallow_variance), (deep_m, deep_variance) = sorted(depths)
    apart_m, total = deep_m - shallow_m, shallow_variance + deep_variance
    chance = math.exp(-0.5 * apart_m**2 / total) / math.sqrt(2 * math.pi * total)
    lost = max(0.5 * _LOST_SHARE * math.exp(-apart_m / _LOST_M) / _LOST_M, 1e-300)
    alone = lost / (lost + (1 - _LOST_SHARE) * chance)
    both_m = (shallow_m * deep_variance + deep_m * shallow_variance) / total
    mean_m = alone * deep_m + (1 - alone) * both_m
    spread = alone * (1 - alone) * (deep_m - both_m) ** 2
    return mean_m, alone * deep_variance + (1 - alone) * shallow_variance * deep_variance / total + spread


def _with_kept(seen_m: float, variance: float, kept_m: float | None) -> tuple[float, float]:
    """The depth of the walls' ends and its variance, with what is kept from the frames before."""
    if kept_m is None:
        return seen_m, variance
    clear_m = max(_HIGHER_M, _HIGHER_SIGMAS * math.sqrt(variance))
    if seen_m < kept_m - clear_m:
        return kept_m - _RISE_M, variance + _KEPT_SIGMA_M**2
    return seen_m, variance


def _at_depth(wall: Curve, edge: Corner, depth_m: float, down: tuple[float, float]) -> Corner:
    """Where a wall is this deep below its edge."""
    x_m = edge.x_m + depth_m / (down[0] + down[1] * wall.slope_at(edge.x_m))
    return Corner(x_m=x_m, z_m=wall.z_at(x_m), sigma_m=math.sqrt(wall.variance_at(x_m)))

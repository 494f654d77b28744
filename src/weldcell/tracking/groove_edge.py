"""A groove's edge: where its wall, as drawn, crosses the plate beside it, checked against where the plate ends."""

import math
from dataclasses import replace

import numpy as np

from weldcell.tracking.curve_end import curve_end
from weldcell.tracking.curves import Curve
from weldcell.tracking.groove_drawing import Drawing
from weldcell.tracking.plates_frame import PlatesFrame
from weldcell.tracking.quantiles import quantile
from weldcell.tracking.section import Corner, Section

BESIDE_M = 3e-3
"""How far about a plate's end to look for it."""
_SURE_M = 1e-4  # a wall that tells its edge less well is as good as not seen
_EDGE_SLACK_M = 5e-4
_EDGES_APART_M = 3e-4
_LEAST_NATS = 10.0
_MOST_UNSEEN_M = 8e-3  # of a plate before its edge, if the wall tells that
_FEW_SEEN, _FEW_SEEN_SHARE = 2, 0.1  # of the columns in between: strays
_ON_WALL_M, _FEWEST_ON_WALL, _WALL_SHARE = 1.5e-4, 10, 0.2  # how near, and of the groove's depth
_DEEPER_M = 4e-4  # below the plate: in the groove
_END_HIDDEN = 0.02  # share of plates' ends beside unseen walls that are no edges: 6 of 331, beside an arc


def groove_edge(
    section: Section, frame: PlatesFrame, plate: Curve, drawing: Drawing, side: int, end_m: float
) -> Corner | None:
    """Where the wall of one side (1: larger s) crosses its plate; None if that is not where the plate ends.

    If too little of the wall is seen, the plate's end alone.
    """
    end = curve_end(section, plate, end_m + side * BESIDE_M, end_m - side * BESIDE_M)
    wall, top_m = drawing.walls[0 if side < 0 else 1], drawing.wall_at(side, 0.0)
    s_m, d_m = top_m, 0.0
    for _ in range(4):  # the plate is nearly level in this frame
        d_m = plate_depth(frame, plate, s_m)
        s_m = top_m - side * wall * d_m
    jacobian = drawing.wall_gradient(side, d_m)
    x_m, _ = frame.to_section(s_m, d_m)
    variance = float(jacobian @ drawing.covariance @ jacobian) + (1 + wall**2) * plate.variance_at(x_m)
    crossed = frame.corner(s_m, d_m, math.sqrt(variance))
    sure = crossed.sigma_m <= _SURE_M
    if end is None or end.nats < _LEAST_NATS:
        return crossed if sure and abs(crossed.x_m - end_m) <= _EDGE_SLACK_M else None
    apart_m = side * (end.corner.x_m - crossed.x_m)  # positive where the plate stops short of the wall
    if sure and abs(apart_m) <= max(_EDGES_APART_M, 4 * end.corner.sigma_m):
        return crossed
    if not (sure and _is_wall_seen(section, frame, drawing, side)):
        return _in_the_dark(section, plate, end.corner, -side)
    return crossed if 0 < apart_m <= _MOST_UNSEEN_M and _is_dark(section, crossed.x_m, end.corner.x_m) else None


def plate_depth(frame: PlatesFrame, plate: Curve, s_m: float) -> float:
    """d of the plate at s."""
    d_m = 0.0
    for _ in range(3):
        x_m, z_m = frame.to_section(s_m, d_m)
        d_m += (plate.z_at(x_m) - z_m) * math.cos(frame.angle_rad)
    return d_m


def _is_wall_seen(section: Section, frame: PlatesFrame, drawing: Drawing, side: int) -> bool:
    """Whether the wall is seen over some of its height: a drop of spatter before it lies at one depth."""
    part = frame.of(section)
    top_m, bottom_m = drawing.wall_at(side, 0.0), drawing.wall_at(side, drawing.depth_m)
    off_m = part.x_m - (top_m + (bottom_m - top_m) * part.z_m / drawing.depth_m)
    on = (np.abs(off_m) < _ON_WALL_M) & (part.z_m > _DEEPER_M) & (part.z_m < drawing.depth_m - drawing.radius_m / 2)
    if on.sum() < _FEWEST_ON_WALL:
        return False
    seen_m = quantile(part.z_m[on], 0.9) - quantile(part.z_m[on], 0.1)
    return seen_m > _WALL_SHARE * drawing.depth_m


def _is_dark(section: Section, first_m: float, last_m: float) -> bool:
    """Whether next to nothing is seen between two x: a plate whose last stretch is hidden, not one that bends off."""
    spacing_m = section.spacing_m
    low, high = sorted((first_m, last_m))
    seen = np.sum((section.x_m > low + spacing_m) & (section.x_m < high - spacing_m))
    return bool(seen <= max(_FEW_SEEN, _FEW_SEEN_SHARE * (high - low) / spacing_m))


def _in_the_dark(section: Section, plate: Curve, end: Corner, towards: int) -> Corner:
    """A plate's end with no wall beside it: it may be hidden too, and the edge lie up to where the groove is seen.

    With the probability p that it is, anywhere within w, the mean square of what is missed is p w^2 / 3.
    """
    deeper = section.z_m > plate.z_of(section.x_m) + _DEEPER_M
    beyond_m = towards * (section.x_m[deeper] - end.x_m)
    dark_m = float(beyond_m[beyond_m > 0].min(initial=np.inf))
    return replace(end, sigma_m=float(np.hypot(end.sigma_m, dark_m * np.sqrt(_END_HIDDEN / 3))))

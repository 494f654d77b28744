"""Where a single bevel ends below the square edge of the other plate: its root and its gap.

The camera looks along the seam, past the square edge behind the light. Where the seam bends by a radius R towards the
bevel, that edge hides d^2 / 2R of what lies a depth d below it, and what is hidden looks like a gap. Depth tells them
apart: the bevel's end stays as deep below the square plate as it was in the frames before, and a bevel that seems to
end higher goes on behind the edge. Nor are the stripe's last columns always seen: where the background is bright, a
dark one takes the few behind it along. So a first frame's gap is doubted, and the root lies midway between what it
would be with the gap and without; a gap that is seen again is one. A gap as narrow as what an edge takes along stays
doubted: a sensor that is turned by a degree loses these columns in every frame.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from weldcell.tracking.curves import Curve
from weldcell.tracking.section import Corner, Section

_HIDDEN_SIGMAS = 3.0  # a bevel that ends this much higher than it did goes on behind the edge
_HIDDEN_M = (1e-4, 2.5e-4)  # but no less and no more than so much
_DEPTH_GAIN, _MOST_RISE_M = 0.2, 1e-5  # of the depth kept, a frame: what hides the end must not wear it away
_TIGHTEST_BEND_M = 0.1
_DOUBT_SHARE = 0.35  # of a gap that a bend may feign: half the way between both roots that it leaves open
_MOST_DOUBT_M = 4.5e-4  # so that the next frame can tell
_SHADOW_SPACINGS = 3.0  # a bevel that is seen up to the square edge's shadow has no gap to be seen
_MOST_LOST_SPACINGS = 7.0  # columns that a stripe may lose before an edge: a dark one, and the few behind it


@dataclass(frozen=True, kw_only=True)
class Foot:
    """The lower end of the groove."""

    root: Corner
    edge: Corner
    """The square edge, which the foot tells something of if there is no gap."""
    gap_m: float
    depth_m: float
    """Of the bevel's end below the square plate."""
    kept_depth_m: float | None
    """The depth to go by in the next frame; None where this one does not tell."""


def bevel_foot(section: Section, square: Curve, bevel: Curve, edge: Corner, end: Corner, kept_m: float | None) -> Foot:
    """The foot, from the square edge and the bevel's end, with the depth kept from frames before."""
    lean = square.slope_at(edge.x_m)
    along = (1 / math.hypot(1.0, lean), lean / math.hypot(1.0, lean))  # the square plate
    meeting = _on_face(square, bevel, edge)
    seen_m, deepest_m = (_depth(along, edge, one) for one in (end, meeting))
    tolerance_m = min(max(_HIDDEN_SIGMAS * end.sigma_m, _HIDDEN_M[0]), _HIDDEN_M[1])
    if _ends_in_shadow(section, edge, end, meeting):
        edge = _edge_by_foot(section, square, edge, end, meeting)
        meeting = _on_face(square, bevel, edge)
        deepest_m = _depth(along, edge, meeting)
        return Foot(
            root=meeting, edge=edge, gap_m=0.0, depth_m=deepest_m, kept_depth_m=_kept(deepest_m, kept_m, tolerance_m)
        )
    depth_m = seen_m
    first_seen = kept_m is None or seen_m > kept_m + tolerance_m
    if kept_m is not None and kept_m > seen_m + tolerance_m:
        # Also where something deeper shows in between: a drop of spatter does, and no bevel ends higher at once.
        depth_m = kept_m
        end = _at_depth(bevel, end, along, depth_m - seen_m)
    else:
        kept_m = _kept(seen_m, kept_m, tolerance_m)
    gap_m = along[0] * (edge.x_m - end.x_m) + along[1] * (edge.z_m - end.z_m)
    if depth_m > deepest_m - tolerance_m or gap_m <= 0:
        return Foot(root=meeting, edge=edge, gap_m=0.0, depth_m=deepest_m, kept_depth_m=kept_m)
    # The gap's ends are independent; the middle moves by half of each.
    sigma_m = 0.5 * math.hypot(end.sigma_m, edge.sigma_m)
    x_m, z_m = end.x_m + gap_m / 2 * along[0], end.z_m + gap_m / 2 * along[1]
    lost_m = _MOST_LOST_SPACINGS * section.spacing_m
    feigned_m = lost_m + depth_m**2 / (2 * _TIGHTEST_BEND_M)
    if gap_m < (feigned_m if first_seen else lost_m):  # a gap, or what is hidden: midway between the roots of both
        x_m, z_m = (x_m + meeting.x_m) / 2, (z_m + meeting.z_m) / 2
        doubt_m = math.hypot(x_m - meeting.x_m, z_m - meeting.z_m)
    else:
        doubt_m = _DOUBT_SHARE * gap_m if gap_m < feigned_m else 0.0
    root = Corner(x_m=x_m, z_m=z_m, sigma_m=math.hypot(sigma_m, min(doubt_m, _MOST_DOUBT_M)))
    return Foot(root=root, edge=edge, gap_m=gap_m, depth_m=depth_m, kept_depth_m=kept_m)


def _depth(along: tuple[float, float], edge: Corner, corner: Corner) -> float:
    """Depth of a corner below the square plate, which runs `along` through its edge."""
    return along[0] * (corner.z_m - edge.z_m) - along[1] * (corner.x_m - edge.x_m)


def _at_depth(bevel: Curve, end: Corner, direction: tuple[float, float], deeper_m: float) -> Corner:
    """The bevel's end this much deeper below the plate along `direction`."""
    slope = bevel.slope_at(end.x_m)
    step_m = deeper_m / (direction[0] * slope - direction[1])
    return replace(end, x_m=end.x_m + step_m, z_m=end.z_m + slope * step_m)


def _kept(depth_m: float, kept_m: float | None, tolerance_m: float) -> float:
    """The depth to go by in the next frame."""
    if kept_m is None or abs(depth_m - kept_m) > tolerance_m:
        return depth_m
    return kept_m + max(_DEPTH_GAIN * (depth_m - kept_m), -_MOST_RISE_M)


def _ends_in_shadow(section: Section, edge: Corner, end: Corner, meeting: Corner) -> bool:
    """Whether the bevel is seen as far as the square edge and its face let it."""
    return _farthest_seen_m(section, edge, end, meeting) - end.x_m <= _SHADOW_SPACINGS * section.spacing_m


def _farthest_seen_m(section: Section, edge: Corner, end: Corner, meeting: Corner) -> float:
    """x up to which a bevel that goes on to the face is seen.

    The square edge keeps the light, which goes along z, from what has a larger x, and takes the columns of what lies
    along the camera's rays below it.
    """
    at = min(int(np.searchsorted(section.x_m, edge.x_m)), len(section.x_m) - 1)
    ray_m = edge.x_m + float(section.noise_slope[at]) * (end.z_m - edge.z_m)
    return min(edge.x_m, ray_m, meeting.x_m)


def _edge_by_foot(section: Section, square: Curve, edge: Corner, end: Corner, meeting: Corner) -> Corner:
    """The square edge by both ends that it makes, its own plate's and the bevel's, weighted by their variances.

    What shifts where light ends (blur, dark columns) shifts them in opposite directions.
    """
    missed_m = end.x_m - _farthest_seen_m(section, edge, end, meeting)
    weight = edge.sigma_m**2 / max(edge.sigma_m**2 + end.sigma_m**2, 1e-18)
    x_m = edge.x_m + weight * missed_m
    return Corner(x_m=x_m, z_m=square.z_at(x_m), sigma_m=edge.sigma_m * math.sqrt(1 - weight))


def _on_face(square: Curve, bevel: Curve, edge: Corner) -> Corner:
    """Where the bevel meets the square face, which goes down at right angles to its plate."""
    lean = square.slope_at(edge.x_m)
    slope = bevel.slope_at(edge.x_m)
    down_m = (bevel.z_at(edge.x_m) - edge.z_m) / (1 + slope * lean)
    x_m = edge.x_m - lean * down_m
    shift = (1 + slope**2) / (1 + slope * lean) ** 2  # along the bevel, for each of the edge along the plate
    turn_m = down_m * math.sqrt(square.covariance[1, 1]) / square.length_m
    variance = shift * (edge.sigma_m**2 + turn_m**2) + bevel.variance_at(x_m)
    return Corner(x_m=x_m, z_m=bevel.z_at(x_m), sigma_m=math.sqrt(variance))

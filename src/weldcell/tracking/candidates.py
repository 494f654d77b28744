"""The choice between the joints that the pieces of one section may form."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from weldcell.tracking.curves import Curve
from weldcell.tracking.found import Found
from weldcell.tracking.pieces import Piece
from weldcell.tracking.section import Corner, Section

GATE_M = 0.015
"""Search window about the last frame's joint, as commercial trackers have it."""
EXPLAINED_M = 3e-4
"""Points this close to a model are explained by it."""
PLATE_LENGTH_M = 0.02
"""Plate beyond this adds little precision, and it may be bent."""
MOST_PLATE_ANGLE_RAD = math.radians(25)
"""Between the two plates of a joint in one plane."""
_MOST_SIGMA_M = 5e-4  # a corner less certain than this is not reported
_SAME_JOINT_M = 1e-3
_USUAL_STEP_M = 2e-3  # across the light, from one frame to the next
_EXPLAINED_SIGMAS = 4.0


def best_of(scores: Sequence[float], anchors_m: Sequence[float]) -> tuple[int, float] | None:
    """Which candidate has the highest score, and by what share of it the best one elsewhere falls behind.

    None if no candidate has a positive score. Candidates whose anchors lie within a millimetre are the same joint.
    """
    if not len(scores) or not max(scores) > 0:
        return None
    best = max(range(len(scores)), key=scores.__getitem__)
    rivals = [s for s, m in zip(scores, anchors_m, strict=True) if abs(m - anchors_m[best]) > _SAME_JOINT_M]
    return best, float(1 - max([0.0, *rivals]) / scores[best])


def is_near(x_m: float, previous_x_m: float | None) -> bool:
    """Whether a joint at `x_m` may be the last frame's."""
    return previous_x_m is None or abs(x_m - previous_x_m) <= GATE_M


def unlikelihood(x_m: float, previous_x_m: float | None) -> float:
    """How much less likely (nats) a joint at `x_m` is the last frame's than one at its place."""
    return 0.0 if previous_x_m is None else 0.5 * ((x_m - previous_x_m) / _USUAL_STEP_M) ** 2


def as_deep(found: Found, name: str, previous_depth_m: float | None, most_risen_m: float) -> Found:
    """The groove, unless its bottom has risen by more since the last frame, as where a tack weld fills it."""
    reason = risen_words(name, found.measures.get("depth_m", np.inf), previous_depth_m, most_risen_m)
    return Found(reason=reason) if reason else found


def risen_words(name: str, depth_m: float, previous_depth_m: float | None, most_risen_m: float) -> str:
    """How a reason says that a groove's bottom has risen; empty if it has not by more than that."""
    risen_m = (previous_depth_m or 0.0) - depth_m
    if risen_m <= most_risen_m:
        return ""
    return f"no {name}: its bottom stands {risen_m * 1e3:.1f} mm higher than before, as a tack weld's does"


def uncertain_words(name: str, *corners: Corner) -> str:
    """How a reason says that a corner's place is known too badly to be of use; empty if all are known."""
    worst_m = max(corner.sigma_m for corner in corners)
    if worst_m <= _MOST_SIGMA_M:
        return ""
    return f"{name} too uncertain: a corner has a standard deviation of {worst_m * 1e3:.2f} mm"


def near_words(previous_x_m: float | None) -> str:
    """How a reason says that a joint may exist elsewhere."""
    return "" if previous_x_m is None else f" within {GATE_M * 1e3:.0f} mm of the last one"


def on_model(section: Section, model: Sequence[tuple[Curve, float, float]]) -> Bool[np.ndarray, "n"]:
    """Which points lie on a model: curves, each from one x to another (m)."""
    explained = np.zeros(len(section.x_m), dtype=bool)
    for curve, first_m, last_m in model:
        inside = section.between(first_m, last_m)
        allowed = np.maximum(EXPLAINED_M, _EXPLAINED_SIGMAS * section.sigma_m[inside])
        explained[inside] |= np.abs(section.z_m[inside] - curve.z_of(section.x_m[inside])) <= allowed
    return explained


def share_on_model(section: Section, model: Sequence[tuple[Curve, float, float]]) -> float:
    """Share of the points within the curves' stretches that lie on them; 0 if there are none."""
    inside = np.zeros(len(section.x_m), dtype=bool)
    for _, first_m, last_m in model:
        inside[section.between(first_m, last_m)] = True
    return share_of(on_model(section, model)[inside])


def share_of(told: Bool[np.ndarray, "n"]) -> float:
    """Share of those for which something is true; 0 if there are none."""
    return float(np.count_nonzero(told)) / max(len(told), 1)


def mismatch_m(right: Curve, right_edge: Corner, left: Curve, left_edge: Corner) -> float:
    """How much higher the left plate (that of larger x) stands than the right one, at the joint's middle.

    Across the plates' mean direction; plates that are not parallel are prolonged by their tangents.
    """
    middle = (left_edge.x_m + right_edge.x_m) / 2
    right_z, left_z = (
        edge.z_m + curve.slope_at(edge.x_m) * (middle - edge.x_m)
        for curve, edge in ((right, right_edge), (left, left_edge))
    )
    tilt = (left.angle_at(left_edge.x_m) + right.angle_at(right_edge.x_m)) / 2
    return (right_z - left_z) * math.cos(tilt)


def is_plate_pair(left: Piece, right: Piece, most_angle_rad: float = MOST_PLATE_ANGLE_RAD) -> bool:
    """Whether two pieces may be the plates on both sides of a joint."""
    return abs(right.angle_rad - left.angle_rad) <= most_angle_rad


def mirrored(section: Section) -> Section:
    """The section with left and right swapped."""
    return Section(
        x_m=-section.x_m[::-1],
        z_m=section.z_m[::-1],
        sigma_m=section.sigma_m[::-1],
        noise_slope=-section.noise_slope[::-1],
        amplitude_grey=section.amplitude_grey[::-1],
    )

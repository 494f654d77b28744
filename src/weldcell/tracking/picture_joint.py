"""A joint in a picture whose camera is not known: features in pixels, by the same finders that measure in metres.

The finders work on profiles, and their gates are lengths. A nominal camera that faces a nominal light plane turns
pixels into such lengths: 0.08 mm for each, as a sensor with a field of some 100 mm has. Nothing else depends on that
scale, and the features go back to pixels by the same camera.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import Stripe
from weldcell.tracking.joint import find_joint
from weldcell.tracking.triangulation import triangulate

_METRES_A_PIXEL = 8e-5
_DISTANCE_M = 0.5
_TILT_RAD = 1e-3  # of the plane against the picture: tells that depth moves the stripe along v
_CAMERA = CameraModel(
    width_px=1, height_px=1, focal_px=np.full(2, _DISTANCE_M / _METRES_A_PIXEL), principal_px=np.zeros(2)
)
_PLANE = LaserPlane(normal_camera=np.array([0.0, -np.sin(_TILT_RAD), np.cos(_TILT_RAD)]), offset_m=_DISTANCE_M)


@dataclass(frozen=True, kw_only=True)
class PictureJoint:
    """The named points of a joint in one picture."""

    names: tuple[str, ...]
    points_px: Float[np.ndarray, "k 2"]
    """(u, v) of each; NaN where not valid. Left is left in the picture; above, if the stripe runs along columns."""
    sigma_px: Float[np.ndarray, "k"]
    """Predicted standard deviation of each point."""
    valid: bool
    reason: str = ""
    """Why the joint was not found, if it was not."""


def joint_in_picture(stripe: Stripe, kind: str, *, direction_rad: float = 0.0) -> PictureJoint:
    """The joint's features on a stripe that runs in this direction; not valid, with the reason, if there is none.

    Deeper may be either way across the stripe: down, or to the left if it runs along columns, is tried first.
    """
    found = [_found(stripe, kind, _turned_by(direction_rad, deeper)) for deeper in (1, -1)]
    return next((joint for joint in found if joint.valid), found[0])


def _turned_by(direction_rad: float, deeper: int) -> Float[np.ndarray, "2 2"]:
    """From pixels to the nominal camera's: the stripe along -u, for the finders call large x left, depth along v."""
    cos, sin = np.cos(direction_rad), np.sin(direction_rad)
    return np.array([[-cos, -sin], [-deeper * sin, deeper * cos]])


def _found(stripe: Stripe, kind: str, turn: Float[np.ndarray, "2 2"]) -> PictureJoint:
    u_px, v_px = turn @ np.stack([stripe.u_px, stripe.v_px])
    seen = Stripe(u_px=u_px, v_px=v_px, sigma_px=stripe.sigma_px)
    features = find_joint(triangulate(seen, _CAMERA, _PLANE), kind, _PLANE)
    return PictureJoint(
        names=features.names,
        points_px=_CAMERA.project(features.points_camera) @ turn,  # a turn's inverse is its transpose
        sigma_px=features.sigma_m / _METRES_A_PIXEL,
        valid=features.valid,
        reason=features.reason,
    )

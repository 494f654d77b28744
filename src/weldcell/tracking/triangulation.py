"""From stripe to profile: each stripe point is where its camera ray meets the light plane."""

import numpy as np
from jaxtyping import Bool, Float

from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import Profile, Stripe


def triangulate(
    stripe: Stripe, camera: CameraModel, plane: LaserPlane, *, depth_range_m: tuple[float, float] = (0.05, 1.0)
) -> Profile:
    """The stripe's points in the camera frame, one for each stripe point, in the same order.

    A point is valid if it lies within `depth_range_m` (least and greatest distance along the camera's axis). Its
    `sigma_m` is the share along the light (z of the laser frame) of the step that `sigma_px` across the stripe makes.
    The stripe was cut by columns if depth moves it along them, by rows if depth moves it along those.
    """
    rays, slopes = camera.unproject_with_slopes(np.column_stack([stripe.u_px, stripe.v_px]))
    points_camera = plane.intersect(rays)
    depth_m, axis = points_camera[:, 2], _depth_axis(plane)
    step_m = depth_m * _step_along(plane.T_camera_laser.as_matrix()[:3, 2], points_camera, plane)
    near, far = depth_range_m
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma_m = stripe.sigma_px * np.abs(step_m / (camera.focal_px[axis] * slopes[:, axis, axis]))
        valid = (depth_m >= near) & (depth_m <= far) & np.isfinite(sigma_m)
    points_camera[~valid], sigma_m[~valid] = np.nan, np.nan
    return Profile(
        points_camera=points_camera,
        sigma_m=sigma_m,
        valid=valid,
        reason=_reason(valid, depth_range_m),
        amplitude_grey=stripe.amplitude_grey,
    )


def _reason(valid: Bool[np.ndarray, "n"], depth_range_m: tuple[float, float]) -> str:
    if len(valid) == 0:
        return "no stripe in the picture"
    if not valid.any():
        near, far = depth_range_m
        return f"no point of the stripe lies within the range of {near:.3g} to {far:.3g} m"
    return ""


def noise_slopes(points_camera: Float[np.ndarray, "n 3"], plane: LaserPlane) -> Float[np.ndarray, "n"]:
    """dx/dz (laser frame) of the step that a point makes when its stripe centre moves along its column (or row).

    Lens distortion turns this direction by less than a degree and is left out.
    """
    rotation = plane.T_camera_laser.as_matrix()[:3, :3]
    x, z = (_step_along(rotation[:, n], points_camera, plane) for n in (0, 2))
    return x / z


def _step_along(
    direction_camera: Float[np.ndarray, "3"], points_camera: Float[np.ndarray, "n 3"], plane: LaserPlane
) -> Float[np.ndarray, "n"]:
    """The share along a direction of a point's step in the light plane, as the y of its ray (x, y, 1) moves on.

    From p = s r with s = d / (n.r) follows dp/dy = s (e_y - p n_y / d); s is the point's depth, and the step is counted
    in units of it. Where depth moves the stripe along x, that stands for y.
    """
    axis = _depth_axis(plane)
    return np.asarray(
        direction_camera[axis] - points_camera @ (direction_camera * (plane.normal_camera[axis] / plane.offset_m))
    )


def _depth_axis(plane: LaserPlane) -> int:
    """The picture's axis that depth moves the stripe along: 1 (v) for a stripe along rows, 0 (u) along columns."""
    return int(np.argmax(np.abs(plane.normal_camera[:2])))

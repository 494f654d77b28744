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
    rays = camera.unproject(np.column_stack([stripe.u_px, stripe.v_px]))
    points_camera = plane.intersect(rays)
    axis = _depth_axis(plane)
    pixels_per_step = camera.focal_px[axis] * camera.distortion_jacobian(rays[:, :2])[:, axis, axis]
    light = plane.T_camera_laser.as_matrix()[:3, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma_m = stripe.sigma_px * np.abs((_step_of_ray(points_camera, plane) @ light) / pixels_per_step)
    near, far = depth_range_m
    with np.errstate(invalid="ignore"):
        in_range = (points_camera[:, 2] >= near) & (points_camera[:, 2] <= far)
    valid = in_range & np.isfinite(sigma_m)
    return Profile(
        points_camera=np.where(valid[:, None], points_camera, np.nan),
        sigma_m=np.where(valid, sigma_m, np.nan),
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
    step_laser = _step_of_ray(points_camera, plane) @ plane.T_camera_laser.as_matrix()[:3, :3]
    return step_laser[:, 0] / step_laser[:, 2]


def _step_of_ray(points_camera: Float[np.ndarray, "n 3"], plane: LaserPlane) -> Float[np.ndarray, "n 3"]:
    """How a point moves in the light plane with the y of its ray (x, y, 1); with its x where depth moves along that.

    From p = s r with s = d / (n.r) follows dp/dy = s (e_y - p n_y / d); s is the point's depth.
    """
    axis = _depth_axis(plane)
    turned = np.eye(3)[axis] - points_camera * (plane.normal_camera[axis] / plane.offset_m)
    return points_camera[:, 2:] * turned


def _depth_axis(plane: LaserPlane) -> int:
    """The picture's axis that depth moves the stripe along: 1 (v) for a stripe along rows, 0 (u) along columns."""
    return int(np.argmax(np.abs(plane.normal_camera[:2])))

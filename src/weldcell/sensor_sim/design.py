"""The sensor as designed: camera, light plane and laser source of a `SensorConfig` without any error.

The stripe runs along the picture's rows (P2) or columns (P1); depth moves it the other way, towards +v or +u. In P1's
terms the light plane is tan(theta) = z / (b + x): theta = 90 deg - triangulation, b = distance / tan(theta). With rows
the same holds for y in place of x.
"""

import numpy as np
from jaxtyping import Float

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel, LaserPlane


def nominal_camera(config: SensorConfig) -> CameraModel:
    """The camera: principal point in the picture's centre, the lens's distortion, the picture plane's tilt."""
    focal_px = config.focal_mm * 1e3 / config.pixel_um
    distortion = [*config.distortion, *config.rational, *config.thin_prism, *np.deg2rad(config.tilt_deg)]
    return CameraModel(
        width_px=config.width_px,
        height_px=config.height_px,
        focal_px=np.array([focal_px, focal_px]),
        principal_px=np.array([(config.width_px - 1) / 2, (config.height_px - 1) / 2]),
        distortion=np.array(distortion),
    )


def nominal_plane(config: SensorConfig) -> LaserPlane:
    """The light plane: it meets the camera's axis at the working distance, the light going away towards +v or +u."""
    angle_rad = np.deg2rad(config.triangulation_deg)
    return LaserPlane(
        normal_camera=np.array([0.0, 0.0, np.sin(angle_rad)]) - np.cos(angle_rad) * _depth_axis(config),
        offset_m=config.working_distance_mm * 1e-3 * np.sin(angle_rad),
    )


def nominal_source_camera(config: SensorConfig) -> Float[np.ndarray, "3"]:
    """The laser's source in the camera frame (m): up the light from where it meets the camera's axis."""
    angle_rad = np.deg2rad(config.triangulation_deg)
    light = np.array([0.0, 0.0, np.cos(angle_rad)]) + np.sin(angle_rad) * _depth_axis(config)
    return np.array([0.0, 0.0, config.working_distance_mm * 1e-3]) - laser_range_m(config) * light


def laser_range_m(config: SensorConfig) -> float:
    """Distance from the laser's source to where its sheet meets the camera's axis.

    Unless configured, the source is the plane's nearest point to the camera: the head's two windows are level as the
    light goes.
    """
    level_m = config.working_distance_mm * 1e-3 * np.cos(np.deg2rad(config.triangulation_deg))
    return config.laser_range_mm * 1e-3 or float(level_m)


def scheimpflug_tilt_rad(config: SensorConfig) -> tuple[float, float]:
    """OpenCV's (tau_x, tau_y) that keep the whole light plane in focus, with the lens focused at the working distance.

    A thin lens sends the plane z = D + y cot(alpha), seen in its picture turned to the front of the lens, to the plane
    z = c - y (c / D) cot(alpha) through the principal distance c; OpenCV's tilted picture plane has the normal
    (sin(tau_y) cos(tau_x), -sin(tau_x), cos(tau_y) cos(tau_x)), and both are the same if
    tan(tau_x) = -(c / D) cot(alpha). For a stripe along columns x takes the place of y, and tau_y the opposite sign.
    """
    slope = config.focal_mm / config.working_distance_mm / np.tan(np.deg2rad(config.triangulation_deg))
    tilt_rad = float(np.arctan(slope))
    return (-tilt_rad, 0.0) if config.stripe_along == "rows" else (0.0, tilt_rad)


def stripe_length_px(config: SensorConfig) -> int:
    """Pixels of the picture along the stripe: how many cuts across it there are."""
    return config.width_px if config.stripe_along == "rows" else config.height_px


def _depth_axis(config: SensorConfig) -> Float[np.ndarray, "3"]:
    """The picture's direction that depth moves the stripe along."""
    return np.array([0.0, 1.0, 0.0] if config.stripe_along == "rows" else [1.0, 0.0, 0.0])

"""The sensor as designed: camera, light plane and laser source of a `SensorConfig` without any error."""

import numpy as np
from jaxtyping import Float

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel, LaserPlane


def nominal_camera(config: SensorConfig) -> CameraModel:
    """The camera: principal point in the picture's centre, the lens's distortion, no tilt."""
    focal_px = config.focal_mm * 1e3 / config.pixel_um
    return CameraModel(
        width_px=config.width_px,
        height_px=config.height_px,
        focal_px=np.array([focal_px, focal_px]),
        principal_px=np.array([(config.width_px - 1) / 2, (config.height_px - 1) / 2]),
        distortion=np.concatenate([config.distortion, np.zeros(9)]),
    )


def nominal_plane(config: SensorConfig) -> LaserPlane:
    """The light plane: it meets the camera's axis at the working distance, the light going down and away (+y, +z)."""
    angle_rad = np.deg2rad(config.triangulation_deg)
    return LaserPlane(
        normal_camera=np.array([0.0, -np.cos(angle_rad), np.sin(angle_rad)]),
        offset_m=config.working_distance_mm * 1e-3 * np.sin(angle_rad),
    )


def nominal_source_camera(config: SensorConfig) -> Float[np.ndarray, "3"]:
    """The laser's source in the camera frame (m): the light plane's nearest point to the camera's centre."""
    plane = nominal_plane(config)
    return plane.offset_m * plane.normal_camera

"""What small errors of camera and light plane do to what the sensor measures.

Six parameters, actual less believed:
0, 1  turn of the light plane about the laser frame's x and z axes (rad)
2     its distance from the camera (m)
3     focal length, relative
4, 5  principal point, u and v (px)
A hand-eye transform takes up most of what they do; what remains bends and scales the profiles.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from weldcell.cell.optics import CameraModel, LaserPlane

# What separates a sensor calibrated with some twenty boards (0.002 deg, 5 um, 1e-4, 0.15 px) from one that has been
# knocked since (0.03 deg, 50 um, 1e-3, 1 px): the geometric mean.
SENSOR_SIGMA = np.array([1.4e-4, 1.4e-4, 16e-6, 3e-4, 0.4, 0.4])
"""How large the errors are believed to be, one sigma."""


def corrected_sensor(
    camera: CameraModel, plane: LaserPlane, sensor: Float[np.ndarray, "6"]
) -> tuple[CameraModel, LaserPlane]:
    """The believed camera and plane with these errors put right."""
    turn_laser = np.array([sensor[0], 0.0, sensor[1]])
    turn = Rotation.from_rotvec(plane.T_camera_laser.rotation.apply(turn_laser))
    normal = turn.apply(plane.normal_camera)
    return (
        replace(camera, focal_px=camera.focal_px * (1 + sensor[3]), principal_px=camera.principal_px + sensor[4:]),
        LaserPlane(normal_camera=normal / np.linalg.norm(normal), offset_m=plane.offset_m + sensor[2]),
    )


def corrected_points(
    points_camera: Float[np.ndarray, "n 3"], camera: CameraModel, plane: LaserPlane, sensor: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "n 3"]:
    """Points of a profile (m) as the corrected sensor would have measured them."""
    return _measured(camera.project(points_camera), *corrected_sensor(camera, plane, sensor))


def circles_by_sensor(
    arcs_camera: Sequence[Float[np.ndarray, "_ 3"]],
    centres_camera: Float[np.ndarray, "n 3"],
    circles_laser: Float[np.ndarray, "n 3"],
    radii_m: Float[np.ndarray, "n"],
    camera: CameraModel,
    plane: LaserPlane,
) -> Float[np.ndarray, "n 3 6"]:
    """How each measured circle (x, z, radius), less the one that the sphere's centre predicts, moves with the errors.

    `arcs_camera` are the points (m) that each circle was fitted to, `centres_camera` and `radii_m` the spheres'.
    """
    pixels = [camera.project(arc) for arc in arcs_camera]
    columns = []
    for step in np.diag(SENSOR_SIGMA):
        moved = []
        for sign in (1, -1):
            changed_camera, changed_plane = corrected_sensor(camera, plane, sign * step)
            T_laser_camera = changed_plane.T_camera_laser.inv()
            all_points = _measured(np.concatenate(pixels), changed_camera, changed_plane)
            arcs = np.split(T_laser_camera.apply(all_points)[:, [0, 2]], np.cumsum([len(each) for each in pixels])[:-1])
            refitted = np.array([_refitted(arc, circle) for arc, circle in zip(arcs, circles_laser, strict=True)])
            moved.append(refitted - _sections(T_laser_camera.apply(centres_camera), radii_m))
        columns.append((moved[0] - moved[1]) / (2 * np.max(step)))
    return np.stack(columns, axis=-1)


def points_by_sensor(
    points_camera: Float[np.ndarray, "n 3"], camera: CameraModel, plane: LaserPlane
) -> Float[np.ndarray, "n 3 6"]:
    """How measured points (m) move with the errors."""
    columns = []
    for step in np.diag(SENSOR_SIGMA):
        ahead, behind = (corrected_points(points_camera, camera, plane, sign * step) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * np.max(step)))
    return np.stack(columns, axis=-1)


def _measured(pixels: Float[np.ndarray, "n 2"], camera: CameraModel, plane: LaserPlane) -> Float[np.ndarray, "n 3"]:
    """Where the rays of pixels meet the plane (m)."""
    rays = camera.unproject(pixels)
    return rays * (plane.offset_m / (rays @ plane.normal_camera))[:, None]


def _refitted(arc: Float[np.ndarray, "k 2"], circle: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The circle through an arc near it, by one Gauss-Newton step: all points displaced by microns."""
    offsets = arc - circle[:2]
    distances = np.linalg.norm(offsets, axis=1)
    design = np.column_stack([offsets / distances[:, None], np.ones(len(arc))])
    return circle + np.linalg.lstsq(design, distances - circle[2], rcond=None)[0]


def _sections(centres_laser: Float[np.ndarray, "n 3"], radii_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """The circles that spheres at these centres show."""
    x, y, z = centres_laser.T
    return np.column_stack([x, z, np.sqrt(np.maximum(radii_m**2 - y**2, 0.0))])

import numpy as np
import pytest
from scipy.optimize import least_squares

import synthetic
from weldcell.calib.sensor_errors import (
    SENSOR_SIGMA,
    circles_by_sensor,
    corrected_points,
    corrected_sensor,
    points_by_sensor,
)
from weldcell.cell.optics import CameraModel

CAMERA = CameraModel(
    width_px=1440,
    height_px=1080,
    focal_px=np.array([3478.0, 3478.0]),
    principal_px=np.array([719.5, 539.5]),
    distortion=np.array([-0.1, 0.12, 2e-4, -1e-4, *[0.0] * 10]),
)


def test_corrected_points_are_what_the_actual_sensor_would_measure():
    """Seen by the actual camera on the actual plane, measured with the believed ones, corrected: back again."""
    rng = np.random.default_rng(0)
    errors = rng.normal(size=6) * 10 * SENSOR_SIGMA
    actual_camera, actual_plane = corrected_sensor(CAMERA, synthetic.PLANE, errors)
    across = rng.uniform(-0.02, 0.02, (50, 3)) * [1, 0, 1]
    actual = actual_plane.T_camera_laser.apply(across + [0, 0, 0.194])
    rays = CAMERA.unproject(actual_camera.project(actual))
    believed = rays * (synthetic.PLANE.offset_m / (rays @ synthetic.PLANE.normal_camera))[:, None]
    assert np.abs(believed - actual).max() > 1e-5
    assert corrected_points(believed, CAMERA, synthetic.PLANE, errors) == pytest.approx(actual, abs=1e-12)


def test_points_move_as_their_derivatives_say():
    points = synthetic.PLANE.T_camera_laser.apply([[0.01, 0, 0.19], [-0.01, 0, 0.20]])
    by_sensor = points_by_sensor(points, CAMERA, synthetic.PLANE)
    errors = np.array([1e-4, -2e-4, 1e-5, 1e-4, 0.3, -0.2])
    moved = corrected_points(points, CAMERA, synthetic.PLANE, errors) - points
    assert by_sensor @ errors == pytest.approx(moved, abs=1e-3 * np.abs(moved).max())  # second order
    # a focal length that is larger by a share: less of the picture's angle, so the depth of the plane counts
    assert points_by_sensor(points, CAMERA, synthetic.PLANE)[..., 2] @ synthetic.PLANE.normal_camera == pytest.approx(1)


@pytest.mark.parametrize("column", range(6))
def test_circles_move_as_a_refit_of_the_corrected_arc_says(column):
    height_m = 0.011
    arc, centre = synthetic.arc(height_m, centre_section=(0.003, 0.194))
    circle = np.array([0.003, 0.194, np.sqrt(synthetic.SPHERE_RADIUS_M**2 - height_m**2)])
    errors = SENSOR_SIGMA * (np.arange(6) == column)
    _, plane = corrected_sensor(CAMERA, synthetic.PLANE, errors)
    points = corrected_points(arc, CAMERA, synthetic.PLANE, errors)
    x, _, z = plane.T_camera_laser.inv().apply(points).T
    refitted = least_squares(lambda c: np.hypot(x - c[0], z - c[1]) - c[2], circle, xtol=1e-15, ftol=1e-15).x
    # the sphere stays where it is in the camera; its section with the turned plane changes
    centre_x, centre_y, centre_z = plane.T_camera_laser.inv().apply(centre)
    section = np.array([centre_x, centre_z, np.sqrt(synthetic.SPHERE_RADIUS_M**2 - centre_y**2)])
    radii = np.array([synthetic.SPHERE_RADIUS_M])
    by_sensor = circles_by_sensor([arc], centre[None], circle[None], radii, CAMERA, synthetic.PLANE)
    expected = (refitted - section) / SENSOR_SIGMA[column]
    assert by_sensor[0, :, column] == pytest.approx(expected, rel=1e-2, abs=1e-3 * np.abs(expected).max())

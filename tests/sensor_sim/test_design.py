"""The nominal sensor against P1's and P2's own formulas."""

import numpy as np
import pytest

from sensor_sim.rigs import sensor as sensor_of
from weldcell.cell.configuration import SENSOR_PRESETS, SensorConfig
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera

THETA_RAD, BASE_M, FOCAL_M = np.deg2rad(44.37), 0.09142, 6.7595e-3  # P1, table I


def test_p2_light_crosses_the_camera_axis_at_the_working_distance():
    config = SensorConfig()
    plane, source = nominal_plane(config), nominal_source_camera(config)
    np.testing.assert_allclose(plane.normal_camera, [0, -np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(plane.intersect(np.array([0, 0, 1.0])), [0, 0, 0.275])
    assert plane.distance_m(source) == pytest.approx(0, abs=1e-15)
    # the laser is 0.275 cos(45 deg) above the crossing and the same beside the camera's centre
    np.testing.assert_allclose(np.linalg.norm(source - [0, 0, 0.275]), 0.275 * np.sqrt(0.5))
    np.testing.assert_allclose(np.linalg.norm(source), 0.275 * np.sqrt(0.5))
    assert nominal_camera(config).focal_px[0] == pytest.approx(12e-3 / 3.45e-6)


def test_p1_plane_is_that_of_its_table():
    """tan(theta) = z / (b + x), and Eq. 2: a picture point (X, Y) is (X, Y, f) b / (f cot(theta) - X)."""
    config = SENSOR_PRESETS["p1"]
    camera, plane = nominal_camera(config), nominal_plane(config)
    picture_m = np.random.default_rng(0).uniform(-3e-3, 3e-3, (50, 2))
    rays = np.column_stack([picture_m / FOCAL_M, np.ones(50)])
    points_camera = plane.intersect(rays)
    np.testing.assert_allclose(points_camera[:, 2] / (BASE_M + points_camera[:, 0]), np.tan(THETA_RAD), rtol=1e-5)
    scale = BASE_M / (FOCAL_M / np.tan(THETA_RAD) - picture_m[:, 0])
    expected = np.column_stack([picture_m, np.full(50, FOCAL_M)]) * scale[:, None]
    np.testing.assert_allclose(points_camera, expected, rtol=1e-5)  # digits of the table
    assert camera.focal_px[0] == pytest.approx(FOCAL_M / 5.2e-6)


def test_p1_laser_is_level_with_the_camera_at_the_base_length():
    source = nominal_source_camera(SENSOR_PRESETS["p1"])
    np.testing.assert_allclose(source, [-BASE_M, 0, 0], atol=2e-6)  # m, digits of the table


@pytest.mark.parametrize("name", list(SENSOR_PRESETS))
def test_depth_moves_the_stripe_across_towards_larger_pixels(name):
    sensor = sensor_of(name)
    plane = sensor.fan.plane
    light = plane.T_camera_laser.rotation.as_matrix()[:, 2]
    reference = plane.intersect(np.array([0.0, 0.0, 1.0]))
    pixels = sensor.camera.project(reference + np.linspace(-0.02, 0.02, 5)[:, None] * light)
    along, across = (0, 1) if sensor.config.stripe_along == "rows" else (1, 0)
    assert np.all(np.diff(pixels[:, across]) > 50)
    assert np.ptp(pixels[:, along]) < 1.0  # px, what the lens bends


def test_the_lens_of_a_configuration_reaches_the_camera():
    config = SensorConfig(rational=(0.1, 0.2, 0.3), thin_prism=(1e-3, 2e-3, 3e-3, 4e-3), tilt_deg=(5.0, -3.0))
    expected = [-0.10, 0.12, 2e-4, -1e-4, 0.0, 0.1, 0.2, 0.3, 1e-3, 2e-3, 3e-3, 4e-3, np.pi / 36, -np.pi / 60]
    np.testing.assert_allclose(nominal_camera(config).distortion, expected)

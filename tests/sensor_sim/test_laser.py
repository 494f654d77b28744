"""The laser's fan, the power along it and the sheet's thickness against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from sensor_sim.rigs import sensor as sensor_of
from weldcell.cell.configuration import SENSOR_PRESETS, SensorConfig
from weldcell.cell.errors import BadGeometry
from weldcell.sensor_sim.design import nominal_plane, nominal_source_camera
from weldcell.sensor_sim.laser import laser_fan, laser_sheet, power_ratio


def fan_of(config: SensorConfig):
    return laser_fan(config, nominal_plane(config), nominal_source_camera(config))


def test_the_sheet_is_thinnest_at_its_waist_and_grows_as_a_gaussian_beam():
    """By hand for P2: w0 = 80 um, z_R = pi (80 um)^2 / (1.2 x 0.658 um) = 25.46 mm; four sigma are the full width."""
    sheet = laser_sheet(SensorConfig())
    assert sheet.waist_range_m == pytest.approx(0.275 * np.sqrt(0.5))
    assert sheet.rayleigh_m == pytest.approx(25.464e-3, abs=1e-6)
    widths_m = 4 * sheet.sigma_m(sheet.waist_range_m + np.array([-25.464e-3, 0.0, 25.464e-3]))
    np.testing.assert_allclose(widths_m, 160e-6 * np.sqrt([2, 1, 2]), rtol=1e-5)
    # far away the half angle is M^2 lambda / (pi w0)
    far_m = 2 * sheet.sigma_m(np.array([1e4]))[0]
    assert far_m / 1e4 == pytest.approx(1.2 * 0.658e-6 / (np.pi * 80e-6), rel=1e-4)


def test_the_waist_can_be_put_elsewhere():
    sheet = laser_sheet(replace(SensorConfig(), laser_waist_mm=150.0))
    ranges_m = np.linspace(0.1, 0.3, 201)
    assert ranges_m[np.argmin(sheet.sigma_m(ranges_m))] == pytest.approx(0.150)


def test_power_is_even_or_falls_to_one_over_e_squared_at_the_ends_of_the_fan():
    angles_rad = np.deg2rad([-20.0, -10.0, 0.0, 20.0])
    np.testing.assert_array_equal(power_ratio(angles_rad, np.deg2rad(20), "uniform"), 1)
    np.testing.assert_allclose(power_ratio(angles_rad, np.deg2rad(20), "gaussian"), np.exp([-2, -0.5, 0, -2]))
    fan = fan_of(replace(SensorConfig(), laser_profile="gaussian"))
    np.testing.assert_allclose(fan.power_ratio[[0, -1]], np.exp(-2))
    assert fan.power_ratio.max() == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("name", list(SENSOR_PRESETS))
def test_the_fan_lies_in_the_plane_about_the_light_and_is_as_wide_as_configured(name):
    fan, config = sensor_of(name).fan, sensor_of(name).config
    np.testing.assert_allclose(fan.directions_camera @ fan.plane.normal_camera, 0, atol=1e-15)
    light = fan.plane.T_camera_laser.rotation.as_matrix()[:, 2]
    half = np.deg2rad(config.laser_fan_deg) / 2
    np.testing.assert_allclose(fan.directions_camera[[0, -1]] @ light, np.cos(half))
    assert len(fan.directions_camera) == 2 * (config.width_px if config.stripe_along == "rows" else config.height_px)


@pytest.mark.parametrize("name", list(SENSOR_PRESETS))
def test_the_fan_covers_all_that_the_camera_sees(name):
    sensor = sensor_of(name)
    right, bottom = sensor.camera.width_px - 0.5, sensor.camera.height_px - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]])
    ways = sensor.fan.plane.intersect(sensor.camera.unproject(corners)) - sensor.fan.source_camera
    light = sensor.fan.plane.T_camera_laser.rotation.as_matrix()[:, 2]
    angles_deg = np.rad2deg(np.arccos(ways @ light / np.linalg.norm(ways, axis=1)))
    assert angles_deg.max() < sensor.config.laser_fan_deg / 2


def test_a_laser_that_is_none_is_refused(config):
    plane = nominal_plane(config)
    with pytest.raises(BadGeometry, match="source of 3 finite numbers"):
        laser_fan(config, plane, np.full(3, np.nan))
    with pytest.raises(BadGeometry, match="fan of 0 to 180 deg"):
        laser_fan(replace(config, laser_fan_deg=0.0), plane, np.zeros(3))


def test_a_source_off_the_plane_is_moved_to_its_foot(config):
    plane, source = nominal_plane(config), nominal_source_camera(config)
    moved = laser_fan(config, plane, source + 0.001 * plane.normal_camera)
    np.testing.assert_allclose(moved.source_camera, source, atol=1e-15)

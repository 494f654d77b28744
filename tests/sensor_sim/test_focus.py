"""Blur by diffraction, pixel and defocus against the textbook's formula and rays traced through a thin lens."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sensor_sim.rigs import Rig, rig
from sensor_sim.rigs import sensor as sensor_of
from weldcell.cell.configuration import SENSOR_PRESETS, SensorConfig
from weldcell.sensor_sim.design import nominal_camera, scheimpflug_tilt_rad
from weldcell.sensor_sim.focus import lens

PRESETS = list(SENSOR_PRESETS)
DEPTHS_M = np.linspace(-0.03, 0.03, 7)


def untilted(config: SensorConfig) -> SensorConfig:
    return replace(config, tilt_deg=(0.0, 0.0))


def scheimpflug(config: SensorConfig) -> SensorConfig:
    return replace(config, tilt_deg=tuple(np.rad2deg(scheimpflug_tilt_rad(config))))


def blur_px(config: SensorConfig, points_camera: np.ndarray) -> np.ndarray:
    camera = nominal_camera(config)
    return lens(config).blur_sigma_px(points_camera, camera.project(points_camera), camera)


def test_in_focus_there_is_diffraction_and_the_pixel():
    """By hand: 0.42 x 0.658 um x 8 x (1 + 12/275) / 3.45 um = 0.6688 px; with the pixel's 0.2887 px 0.7285 px."""
    assert blur_px(SensorConfig(), np.array([[0.0, 0.0, 0.275]])) == pytest.approx(0.7285, abs=1e-4)


@pytest.mark.parametrize("f_number", [2.0, 8.0])
def test_out_of_focus_the_blur_is_the_blur_circle(f_number):
    """The usual A f |z - D| / (z (D - f)), a quarter of it, beside what there is in focus."""
    config = replace(SensorConfig(), f_number=f_number)
    focal_mm = 12 * 275 / (12 + 275)
    depth_mm = np.array([200.0, 250.0, 275.0, 300.0, 350.0])
    circle_mm = focal_mm**2 / f_number * np.abs(depth_mm - 275) / (depth_mm * (275 - focal_mm))
    in_focus_px = np.hypot(0.42 * 0.658 * f_number * (1 + 12 / 275) / 3.45, np.sqrt(1 / 12))
    expected = np.hypot(circle_mm / 3.45e-3 / 4, in_focus_px)
    points_camera = np.column_stack([np.zeros(5), np.zeros(5), depth_mm * 1e-3])
    np.testing.assert_allclose(blur_px(config, points_camera), expected, rtol=1e-12)


def traced_sigma_px(config: SensorConfig, point_camera: np.ndarray) -> np.ndarray:
    """Spread along u and v of the rays of one point through all of the opening of a thin lens onto the tilted picture.

    The picture plane is set up from three of its pixels, seen from the lens's centre (where they lie is tested with the
    camera model).
    """
    camera, glass = nominal_camera(config), lens(config)
    focal_m = 1 / (1 / glass.principal_m + 1 / glass.focus_m)
    radius, turn = np.meshgrid(np.sqrt((np.arange(40) + 0.5) / 40), np.linspace(0, 2 * np.pi, 64, endpoint=False))
    opening = glass.aperture_m / 2 * np.column_stack([(radius * f(turn)).ravel() for f in (np.cos, np.sin)])
    opening = np.column_stack([opening, np.zeros(len(opening))])
    image = point_camera / point_camera[2] / (1 / focal_m - 1 / point_camera[2])  # turned to the front of the lens
    corners = np.array([[0.0, 0.0], [1000.0, 0.0], [0.0, 1000.0]])
    origin, right, down = camera.unproject(corners) * camera.picture_depth(corners)[:, None] * glass.principal_m
    normal = np.cross(right - origin, down - origin)
    forward = image + opening  # behind the lens the opening is mirrored, too
    scale = ((origin + opening) @ normal) / (forward @ normal)
    hits = scale[:, None] * forward - opening
    return np.std(camera.project(hits), axis=0)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("tilt", [untilted, scheimpflug])
def test_blur_agrees_with_rays_through_the_opening(name, tilt):
    config = replace(tilt(SENSOR_PRESETS[name]), distortion=(0.0, 0.0, 0.0, 0.0, 0.0), f_number=2.8)
    reach_m = config.working_distance_mm * 1e-3
    points = reach_m * np.array([[0, 0, 0.8], [0.1, 0.05, 0.9], [-0.1, 0.1, 1.2], [0.05, -0.1, 1.3], [0.0, 0.0, 1.001]])
    traced = np.array([traced_sigma_px(config, point) for point in points])
    glass = lens(config)
    sharp_px = np.hypot(glass.airy_sigma_px, np.sqrt(1 / 12))
    defocus_px = np.sqrt(blur_px(config, points) ** 2 - sharp_px**2)
    # left out: the tilted picture's stretch of 1/cos(tilt), 2 %, and its slope through the cone, 3 % of a blur of 12 px
    np.testing.assert_allclose(traced, np.column_stack([defocus_px, defocus_px]), rtol=0.05, atol=2e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_with_the_right_tilt_the_whole_light_plane_is_in_focus(name):
    config = replace(SENSOR_PRESETS[name], distortion=(0.0, 0.0, 0.0, 0.0, 0.0), f_number=1.4)
    plane = sensor_of(name).fan.plane
    along, depth = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.03, 0.03, 5), DEPTHS_M))
    points_laser = np.column_stack([along, np.zeros_like(along), depth])
    to_reference = plane.intersect(np.array([0.0, 0.0, 1.0])) - plane.T_camera_laser.translation
    points_camera = plane.T_camera_laser.apply(points_laser) + to_reference
    sharp_px = np.hypot(lens(config).airy_sigma_px, np.sqrt(1 / 12))
    np.testing.assert_allclose(blur_px(scheimpflug(config), points_camera), sharp_px, rtol=1e-9)
    assert blur_px(untilted(config), points_camera).max() > 3 * sharp_px
    wrong = replace(config, tilt_deg=tuple(-value for value in scheimpflug(config).tilt_deg))
    assert blur_px(wrong, points_camera).max() > 1.8 * blur_px(untilted(config), points_camera).max()


def test_the_profiler_is_tilted_as_scheimpflug_says():
    config = SENSOR_PRESETS["profiler"]
    np.testing.assert_allclose(np.deg2rad(config.tilt_deg), scheimpflug_tilt_rad(config), atol=1e-5)
    # by hand: tan(tilt) = 20 / 190 / tan(30 deg) = 0.18232
    assert np.tan(scheimpflug_tilt_rad(config)[0]) == pytest.approx(-0.18232, abs=1e-5)


def stripe_blur_px(sensor: Rig, depth_m: float) -> float:
    """Blur of the stripe's middle on a level plate `depth_m` above the reference, the sheet's own width taken out.

    The sheet is one sigma wide where points a sigma to its sides are seen.
    """
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 {depth_m}"/></worldbody></mujoco>'
    )
    T_base_camera = sensor.T_base_camera()
    pieces = sensor.pieces(model, T_base_camera)
    middle = np.argmin(np.abs(pieces.cut_px - pieces.cut_px.mean()))
    source = T_base_camera.apply(sensor.fan.source_camera)
    sheet_m = sensor.fan.sheet.sigma_m(np.array([source[2] - depth_m]))[0]
    sides = np.array([[-sheet_m, 0, depth_m], [sheet_m, 0, depth_m]])
    pixels = sensor.camera.project(T_base_camera.inv().apply(sides))
    across = 1 if sensor.config.stripe_along == "rows" else 0
    sheet_px = np.abs(np.diff(pixels[:, across]))[0] / 2
    return float(np.sqrt(pieces.sigma_px[middle] ** 2 - sheet_px**2))


@pytest.mark.parametrize("name", PRESETS)
def test_without_tilt_the_stripe_blurs_with_depth_and_with_the_right_tilt_it_stays_sharp(name):
    config = replace(SENSOR_PRESETS[name], distortion=(0.0, 0.0, 0.0, 0.0, 0.0), f_number=2.8)
    glass, reach_m = lens(config), config.working_distance_mm * 1e-3
    sharp_px = np.hypot(glass.airy_sigma_px, np.sqrt(1 / 12))
    straight, tilted = rig(untilted(config)), rig(scheimpflug(config))
    for depth_m in DEPTHS_M / 2:
        depth_camera = reach_m - depth_m * np.cos(np.deg2rad(config.triangulation_deg))
        lens_focal_m = 1 / (1 / glass.principal_m + 1 / reach_m)
        disc_m = lens_focal_m**2 / 2.8 * abs(depth_camera - reach_m) / (depth_camera * (reach_m - lens_focal_m))
        expected = np.hypot(sharp_px, disc_m * 1e6 / config.pixel_um / 4)
        # the middle cut lies within half a pixel of the axis; the sheet's width is read off at one sigma
        assert stripe_blur_px(straight, depth_m) == pytest.approx(expected, rel=3e-3)
        assert stripe_blur_px(tilted, depth_m) == pytest.approx(sharp_px, rel=3e-3)


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_keeps_its_stripe_narrow_over_its_range(name):
    """Level plates from near to far in the picture: the width stays within what a stripe's centre is found in."""
    sensor = sensor_of(name)
    camera, rows = sensor.camera, sensor.config.stripe_along == "rows"
    ends = np.array([camera.principal_px, camera.principal_px])
    ends[:, 1 if rows else 0] = [0.05, 0.95] * np.array(camera.height_px if rows else camera.width_px)
    T_base_camera = sensor.T_base_camera()
    far, near = (T_base_camera.apply(sensor.fan.plane.intersect(ray))[2] for ray in camera.unproject(ends)[::-1])
    assert near - far > 0.06  # m
    for height_m in np.linspace(far, near, 7):
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 {height_m}"/></worldbody></mujoco>'
        )
        pieces = sensor.pieces(model, T_base_camera)
        assert pieces.sigma_px.min() > 0.6 and np.median(pieces.sigma_px) < 4.0

"""The stripe's centre, width and brightness against closed forms and brute-force integration."""

from dataclasses import replace

import numpy as np
import pytest

from sensor_sim import rigs
from sensor_sim.rigs import Rig
from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import irradiance, light_reference
from weldcell.sensor_sim.stripe import stripe_optics, stripe_pieces

PLATE = '<geom type="box" size=".2 .2 .001" pos="0 0 -.001"/>'


@pytest.fixture(scope="module")
def optics(config, camera, fan):
    return stripe_optics(config, camera, fan)


@pytest.fixture(scope="module")
def crooked_camera(config) -> CameraModel:
    """Off-centre principal point, unequal focal lengths and strong distortion."""
    return CameraModel(
        width_px=config.width_px,
        height_px=config.height_px,
        focal_px=np.array([3450.0, 3500.0]),
        principal_px=np.array([770.0, 500.0]),
        distortion=np.array([-0.2, 0.15, 1e-3, -8e-4, 0.02, *np.zeros(9)]),
    )


def pieces_of(scene, T_base_camera, camera, fan, optics):
    model, data = scene
    section = light_section(RayCaster(model), data, T_base_camera, camera, fan)
    return stripe_pieces(section, irradiance(section, fan.power_ratio, light_reference(fan)), camera, optics)


def exact_rows(camera, fan, T_base_camera, u_px, height_base, rows=(0.0, 1079.0)):
    """Row at which each column's ray meets the light plane on a surface `height_base(points)` = 0, by bisection."""
    low, high = (np.full(len(u_px), row) for row in rows)

    def miss(v_px):
        rays = camera.unproject(np.column_stack([u_px, v_px]))
        return height_base(T_base_camera.apply(fan.plane.intersect(rays)))

    for _ in range(50):
        middle = (low + high) / 2
        above = miss(middle) * miss(low) > 0
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return (low + high) / 2


def column_centroids(picture, pieces):
    """Grey centroid of each piece's own column, over all rows."""
    rows = np.arange(len(picture))
    columns = picture[:, pieces.u_px]
    return rows @ columns / columns.sum(axis=0)


@pytest.mark.parametrize("tilt", ["0 0 0", "25 0 0", "0 20 0", "-20 -15 10"])
@pytest.mark.parametrize("lens", ["camera", "crooked_camera"])
def test_stripe_on_a_plane_is_where_the_closed_form_says(request, scene, overhead, fan, optics, tilt, lens):
    camera = request.getfixturevalue(lens)
    built = scene(PLATE.replace("/>", f' euler="{tilt}"/>'))
    rotation = built[1].geom_xmat[0].reshape(3, 3)
    T_base_camera = overhead((0.0, 0.0, 0.003))
    pieces = pieces_of(built, T_base_camera, camera, fan, optics)
    assert len(pieces.u_px) > 900 and len(np.unique(pieces.u_px)) == len(pieces.u_px)
    surface = (built[1].geom_xpos[0] + 0.001 * rotation[:, 2]) @ rotation[:, 2]
    expected = exact_rows(camera, fan, T_base_camera, pieces.u_px, lambda p: p @ rotation[:, 2] - surface)
    np.testing.assert_allclose(pieces.v_px, expected, atol=2e-4)  # px, chord of the distorted line between rays
    grey = draw_stripe(pieces, camera.width_px, camera.height_px)
    full = (pieces.coverage > 0.999) & (np.abs(pieces.v_px - 540) < 520)
    drawn = column_centroids(grey.grey, pieces) + grey.first_row
    np.testing.assert_allclose(drawn[full], expected[full], atol=1e-3)  # px, cut of the Gaussian at 4 sigma


def test_stripe_on_a_sphere_is_where_the_closed_form_says(scene, overhead, camera, fan, optics):
    radius_m, centre = 0.02, np.array([0.006, 0.004, -0.005])
    T_base_camera = overhead()
    built = scene('<geom type="sphere" size=".02" pos=".006 .004 -.005"/>')
    pieces = pieces_of(built, T_base_camera, camera, fan, optics)
    top_v = pieces.v_px.min()
    expected = exact_rows(
        camera, fan, T_base_camera, pieces.u_px, lambda p: np.linalg.norm(p - centre, axis=1) - radius_m, (100.0, 540.0)
    )
    away_from_limb = np.abs(pieces.u_px - np.median(pieces.u_px)) < 0.45 * np.ptp(pieces.u_px)
    error = pieces.v_px - expected
    assert away_from_limb.sum() > 350 and top_v < 450
    # 0.02 px is a tenth of what noise leaves; chords between rays 0.6 px apart give far less
    assert np.sqrt(np.mean(error[away_from_limb] ** 2)) < 0.02


def brute_force_section(rig: Rig, T_base_camera, normal_base, cut: float, centre: float, reach_px: float):
    """Mean, sigma and light of the true section on one cut of a plane through the base's origin, by summation.

    Each point of a grid of 1/8 px is seen on the plane by a ray, lit by the sheet as thick as its way from the laser
    makes it, and blurred as the lens blurs that very point.
    """
    axis = 0 if rig.config.stripe_along == "rows" else 1
    fine = np.arange(-reach_px, reach_px, 1 / 8)
    grid = np.stack(np.meshgrid(cut + fine[np.abs(fine) < 15], centre + fine), axis=-1).reshape(-1, 2)
    pixels = grid if axis == 0 else grid[:, ::-1]
    rays = rig.camera.unproject(pixels)
    normal_camera = T_base_camera.rotation.inv().apply(normal_base)
    points_camera = rays * (-(T_base_camera.translation @ normal_base) / (rays @ normal_camera))[:, None]
    to_source = rig.fan.source_camera - points_camera
    way_m = np.linalg.norm(to_source, axis=1)
    sheet_m = rig.fan.sheet.sigma_m(way_m)
    light = np.exp(-0.5 * (rig.fan.plane.distance_m(points_camera) / sheet_m) ** 2)
    light *= (to_source @ normal_camera) / way_m**2 / sheet_m
    if rig.config.laser_profile == "gaussian":
        across, _, down = (-to_source @ rig.fan.plane.T_camera_laser.rotation.as_matrix()).T
        light *= np.exp(-2 * (np.arctan2(across, down) / np.deg2rad(rig.config.laser_fan_deg / 2)) ** 2)
    blur_px = rig.optics.lens.blur_sigma_px(points_camera, pixels, rig.camera)
    weight = light * np.exp(-0.5 * ((grid[:, 0] - cut) / blur_px) ** 2) / (np.sqrt(2 * np.pi) * blur_px)
    mean = weight @ grid[:, 1] / weight.sum()
    variance = weight @ (blur_px**2 + (grid[:, 1] - mean) ** 2) / weight.sum()
    return mean, np.sqrt(variance), weight.sum() / 8**2


TILTS = [(0, 0), (50, 12), (-40, 0), (0, 25), (20, -25)]


@pytest.mark.parametrize("name", list(rigs.SENSORS))
@pytest.mark.parametrize("tilt", TILTS)
def test_centre_width_and_brightness_agree_with_summing_up_the_true_light(scene, name, tilt):
    """A thick sheet that grows, seen askew and blurred differently at each place, against one even Gaussian."""
    rig = rigs.sensor(name)
    model, data = scene(f'<geom type="plane" size="1 1 1" euler="{tilt[0]} {tilt[1]} 0"/>')
    T_base_camera, normal = rig.T_base_camera(), data.geom_xmat[0].reshape(3, 3)[:, 2]
    pieces = rig.pieces(model, T_base_camera)
    flat = rig.pieces(scene('<geom type="plane" size="1 1 1"/>')[0], T_base_camera)
    reference = np.argmin(np.abs(flat.cut_px - np.mean(flat.cut_px)))
    _, sigma, unit = brute_force_section(
        rig, T_base_camera, np.array([0.0, 0, 1]), flat.cut_px[reference], flat.centre_px[reference], 8.0
    )
    unit *= rig.config.peak_grey**-1 / (np.sqrt(2 * np.pi) * sigma)
    for one in np.linspace(0.2, 0.8, 3) * len(pieces.cut_px):
        one = int(one)
        reach_px = 6 * pieces.sigma_px[one]
        mean, sigma, light = brute_force_section(
            rig, T_base_camera, normal, pieces.cut_px[one], pieces.centre_px[one], reach_px
        )
        # what is left out: perspective and growth across the sheet make the light a little uneven
        assert mean == pytest.approx(pieces.centre_px[one], abs=3e-3 * sigma)
        assert sigma == pytest.approx(pieces.sigma_px[one], rel=2e-4)
        assert light / (np.sqrt(2 * np.pi) * sigma) / unit == pytest.approx(pieces.amplitude_grey[one], rel=2e-4)


def test_a_camera_rolled_by_a_right_angle_sees_the_same_stripe_along_columns(scene):
    """Rows become columns: the picture is turned, nothing else changes."""
    rows = rigs.rig(replace(SensorConfig(), distortion=(-0.1, 0.12, 0.0, 0.0, 0.0), tilt_deg=(-3.0, 0.0)))
    columns = rigs.rig(replace(rows.config, width_px=1080, height_px=1440, stripe_along="columns", tilt_deg=(0.0, 3.0)))
    model, _ = scene(
        '<geom type="box" size=".03 .03 .01" pos="0 0 -.01" euler="10 20 30"/><geom type="sphere" size=".01"/>'
    )
    flat, upright = (rig.pieces(model, rig.T_base_camera()) for rig in (rows, columns))
    order = np.lexsort((upright.centre_px, -upright.cut_px))
    expected = np.lexsort((flat.centre_px, flat.cut_px))
    np.testing.assert_array_equal(1439 - upright.cut_px[order], flat.cut_px[expected])
    for field in ("centre_px", "sigma_px", "amplitude_grey", "coverage", "ray"):
        np.testing.assert_allclose(
            getattr(upright, field)[order], getattr(flat, field)[expected], rtol=1e-6, atol=1e-6, err_msg=field
        )
    pictures = []
    for rig, pieces in ((rows, flat), (columns, upright)):
        picture = np.zeros((rig.camera.height_px, rig.camera.width_px), np.float32)
        laser = draw_stripe(pieces, rig.camera.width_px, rig.camera.height_px)
        picture[laser.window] = laser.grey
        pictures.append(picture)
    np.testing.assert_allclose(pictures[1], np.rot90(pictures[0]), atol=1e-3)  # grey levels
    np.testing.assert_array_equal(upright.v_px, upright.cut_px)
    np.testing.assert_array_equal(upright.u_px, upright.centre_px)


def test_a_white_plate_hit_head_on_peaks_at_the_peak_grey(scene, overhead, camera, fan, optics):
    pieces = pieces_of(scene(PLATE), overhead(), camera, fan, optics)
    middle = np.abs(pieces.u_px - 719.5) < 2
    np.testing.assert_allclose(pieces.amplitude_grey[middle], 200, rtol=1e-4)
    assert pieces.amplitude_grey[pieces.u_px == 0] < 195  # longer way and slanting light at the border


def test_a_corner_does_not_break_the_stripe_and_a_step_does(scene, overhead, camera, fan, optics):
    ridge = '<geom type="box" size=".05 .02 .02" euler="45 0 0" pos="0 0 -.02"/>'
    pieces = pieces_of(scene(ridge), overhead(), camera, fan, optics)
    columns = np.unique(pieces.u_px[pieces.coverage > 0.5])
    np.testing.assert_array_equal(np.diff(columns), 1)
    top = np.argmin(np.where(pieces.coverage > 0.5, pieces.v_px, np.inf))
    assert pieces.coverage[top] == pytest.approx(1, abs=1e-6)
    step = (
        '<geom type="box" size=".1 .05 .01" pos="0 -.05 -.01"/><geom type="box" size=".1 .05 .01" pos="0 .05 -.015"/>'
    )
    pieces = pieces_of(scene(step), overhead((0.0, 0.0, -0.002)), camera, fan, optics)
    solid = pieces.coverage > 0.5
    jump = np.flatnonzero(np.abs(np.diff(pieces.v_px)) > 20)
    assert len(jump) >= 1 and solid.sum() > 1400
    between = (pieces.v_px > pieces.v_px.min() + 3) & (pieces.v_px < pieces.v_px.max() - 3)
    assert not between.any()  # nothing is drawn down the wall of the step


@pytest.mark.parametrize("depth_mm", [0.05, 0.5, 30.0])
def test_steps_of_any_depth_split_the_stripe(scene, overhead, camera, fan, optics, depth_mm):
    low = -0.01 - depth_mm * 1e-3
    step = (
        f'<geom type="box" size=".1 .05 .01" pos="0 -.05 -.01"/><geom type="box" size=".1 .05 .01" pos="0 .05 {low}"/>'
    )
    pieces = pieces_of(scene(step), overhead((0.0, 0.0, -depth_mm * 5e-4)), camera, fan, optics)
    ends = (pieces.coverage > 0.02) & (pieces.coverage < 0.98)
    assert ends.sum() >= 4  # two ends, each fading over a few columns


def test_a_profile_that_folds_in_the_picture_keeps_both_pieces(scene, overhead, camera, fan, optics):
    """Two plates, the upper covering part of the lower seen from the light; tilted so that columns are shared."""
    plates = (
        '<geom type="box" size=".1 .02 .0005" pos="0 -.02 .02" euler="0 0 0"/>'
        '<geom type="box" size=".1 .05 .0005" pos="0 .0495 -.03"/>'
    )
    pieces = pieces_of(scene(plates), overhead(yaw_rad=0.0), camera, fan, optics)
    _, counts = np.unique(pieces.u_px, return_counts=True)
    assert counts.max() == 2
    laser = draw_stripe(pieces, camera.width_px, camera.height_px)
    total = laser.grey.sum()
    np.testing.assert_allclose(total, (pieces.amplitude_grey * pieces.sigma_px).sum() * np.sqrt(2 * np.pi), rtol=2e-3)


def test_the_stripe_does_not_fade_at_the_picture_border(scene, overhead, camera, fan, optics):
    pieces = pieces_of(scene(PLATE), overhead(), camera, fan, optics)
    assert pieces.u_px[0] == 0 and pieces.u_px[-1] == camera.width_px - 1
    np.testing.assert_allclose(pieces.coverage, 1, atol=1e-6)


def test_the_stripe_ends_at_the_surface_edge_and_fades_like_the_blur(scene, overhead, camera, fan, optics):
    plate = '<geom type="box" size=".1 .02 .01" pos="0 0 -.01"/>'
    T_base_camera = overhead()
    pieces = pieces_of(scene(plate), T_base_camera, camera, fan, optics)
    ends_base = np.array([[0, 0.02, 0], [0, -0.02, 0]])
    ends_u = np.sort(camera.project(T_base_camera.inv().apply(ends_base))[:, 0])
    half = np.interp(0.5, pieces.coverage[:20], pieces.u_px[:20])
    assert half == pytest.approx(ends_u[0], abs=0.4)  # px, half a spacing of the rays
    assert 2 < (pieces.coverage < 0.99).sum() < 12


def test_nothing_seen_is_no_piece_and_no_light(scene, overhead, camera, fan, optics):
    pieces = pieces_of(scene('<geom type="sphere" size=".01" pos="5 5 5"/>'), overhead(), camera, fan, optics)
    assert len(pieces.u_px) == 0
    assert draw_stripe(pieces, camera.width_px, camera.height_px).grey.shape == (0, camera.width_px)

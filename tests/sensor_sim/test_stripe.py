"""The stripe's centre, width and brightness against closed forms and brute-force integration."""

import cv2
import numpy as np
import pytest

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.stripe import sheet_sigma_px, stripe_optics, stripe_pieces

PLATE = '<geom type="box" size=".2 .2 .001" pos="0 0 -.001"/>'


@pytest.fixture(scope="module")
def optics(config):
    return stripe_optics(config)


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
    return stripe_pieces(section, camera, fan, optics)


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


def brute_force_picture(camera, fan, rotation, T_base_camera, u_px, v_rows, sheet_sigma_m):
    """The sheet's Gaussian read off a plane through the base's origin at every (sub-)pixel, by rays from the camera."""
    u, v = np.meshgrid(u_px, v_rows)
    rays = camera.unproject(np.stack([u, v], axis=-1))
    normal_camera = T_base_camera.rotation.inv().apply(rotation[:, 2])
    height = -T_base_camera.translation @ rotation[:, 2]
    points_camera = rays * (height / (rays @ normal_camera))[..., None]
    return np.exp(-0.5 * (fan.plane.distance_m(points_camera) / sheet_sigma_m) ** 2), points_camera


@pytest.mark.parametrize("tilt", [(0, 0), (40, 0), (0, 25), (0, -30), (50, 10)])
def test_sheet_width_agrees_with_integrating_the_sheet_over_the_surface(
    scene, overhead, crooked_camera, fan, optics, tilt
):
    """Second moment along a column of the true sheet on a tilted plane."""
    _, data = scene(f'<geom type="plane" size="1 1 1" euler="{tilt[0]} {tilt[1]} 0"/>')
    rotation = data.geom_xmat[0].reshape(3, 3)
    T_base_camera = overhead()
    u_px = np.array([500.0, 770.0, 1000.0])
    centre = exact_rows(crooked_camera, fan, T_base_camera, u_px, lambda p: p @ rotation[:, 2])
    points = fan.plane.intersect(crooked_camera.unproject(np.column_stack([u_px, centre])))
    normals = np.tile(T_base_camera.rotation.inv().apply(rotation[:, 2]), (3, 1))
    predicted = sheet_sigma_px(points, normals, crooked_camera, fan.plane, optics.sheet_sigma_m)
    for i in range(3):
        rows = centre[i] + np.linspace(-8, 8, 3201) * predicted[i]
        light, _ = brute_force_picture(
            crooked_camera, fan, rotation, T_base_camera, u_px[i : i + 1], rows, optics.sheet_sigma_m
        )
        weight = light[:, 0] / light.sum()
        mean = weight @ rows
        sigma = np.sqrt(weight @ (rows - mean) ** 2)
        assert mean == pytest.approx(centre[i], abs=2e-3)  # px, perspective makes the section slightly skew
        assert sigma == pytest.approx(predicted[i], rel=2e-3)


def test_blurred_section_agrees_with_blurring_the_true_picture(scene, overhead, camera, fan, optics):
    """A sloped stripe, supersampled 16 times, blurred isotropically, and cut along a column."""
    _, data = scene('<geom type="plane" size="1 1 1" euler="55 12 0"/>')
    rotation, T_base_camera = data.geom_xmat[0].reshape(3, 3), overhead()
    pieces = pieces_of((_, data), T_base_camera, camera, fan, optics)
    one = np.flatnonzero(pieces.u_px == 700)[0]
    fine = np.arange(-160, 161) / 16
    rows = pieces.v_px[one] + np.arange(-400, 401) / 16
    light, points = brute_force_picture(camera, fan, rotation, T_base_camera, 700 + fine, rows, optics.sheet_sigma_m)
    blurred = cv2.GaussianBlur(light, (0, 0), 16 * optics.psf_sigma_px)[:, len(fine) // 2]
    weight = blurred / blurred.sum()
    sigma = np.sqrt(weight @ (rows - weight @ rows) ** 2)
    slope = (pieces.v_px[one + 1] - pieces.v_px[one - 1]) / (pieces.u_px[one + 1] - pieces.u_px[one - 1])
    assert abs(slope) > 0.9
    assert pieces.sigma_px[one] == pytest.approx(sigma, rel=0.01)  # kernel of finite size
    # brightness, also independent: incidence and range of the fan at this point against the head-on reference
    point = points[len(rows) // 2, len(fine) // 2]
    to_source = fan.source_camera - point
    incidence = T_base_camera.rotation.inv().apply(rotation[:, 2]) @ to_source / np.linalg.norm(to_source)
    flat, _ = brute_force_picture(
        camera, fan, np.eye(3), T_base_camera, 719.5 + fine, 539.5 + np.arange(-400, 401) / 16, optics.sheet_sigma_m
    )
    head_on = cv2.GaussianBlur(flat, (0, 0), 16 * optics.psf_sigma_px)[:, len(fine) // 2].max()
    reference_m = 0.275 * np.sqrt(0.5)
    expected = 200 * incidence * reference_m / np.linalg.norm(to_source) * blurred.max() / head_on
    assert pieces.amplitude_grey[one] == pytest.approx(expected, rel=0.01)


def test_a_white_plate_hit_head_on_peaks_at_the_peak_grey(scene, overhead, camera, fan, optics):
    pieces = pieces_of(scene(PLATE), overhead(), camera, fan, optics)
    middle = np.abs(pieces.u_px - 719.5) < 2
    np.testing.assert_allclose(pieces.amplitude_grey[middle], 200, rtol=1e-4)
    assert pieces.amplitude_grey[pieces.u_px == 0] < 195  # longer way and slanting light at the border


def test_psf_holds_diffraction_and_pixel():
    """By hand: 0.42 x 0.658 um x 8 x (1 + 12/263) / 3.45 um = 0.670 px; with the pixel's 0.289 px 0.730 px."""
    assert stripe_optics(SensorConfig()).psf_sigma_px == pytest.approx(0.7297, abs=2e-4)


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

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.calib.sphere_sight import SphereSightProblem, _arc_seen, solve
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import LaserPlane

SIGMA_M = 3e-5


def sight(points_camera, *, sigma_m=SIGMA_M, side=1, plane=synthetic.PLANE, radius_m=synthetic.SPHERE_RADIUS_M):
    return solve(
        SphereSightProblem(
            points_camera=points_camera,
            sigma_m=np.full(len(points_camera), sigma_m),
            plane=plane,
            radius_m=radius_m,
            side=side,
        )
    )


def along_light(offsets_m, plane=synthetic.PLANE):
    """Camera displacements of points along the light."""
    return offsets_m[:, None] * plane.T_camera_laser.rotation.apply([0.0, 0.0, 1.0])


def section(x, z, plane=synthetic.PLANE):
    return plane.T_camera_laser.apply(np.column_stack([x, np.zeros_like(x), z]))


def cluttered(points, rng, share=0.0):
    """The arc with table to both sides and its post below, and a share of all points thrown about."""
    table_x = np.linspace(0.025, 0.045, 250)
    post_x = np.linspace(-0.004, 0.004, 100)
    post_depth = 0.045 - np.sqrt(0.006**2 - post_x**2)
    others = [section(-table_x, 0.060 + 0.2 * table_x), section(table_x, 0.060 + 0.2 * table_x)]
    others.append(section(0.03 + post_x, post_depth))
    everything = np.concatenate([points, *others])
    everything += along_light(rng.normal(0, SIGMA_M, len(everything)))
    thrown = rng.random(len(everything)) < share
    everything[thrown] += along_light(rng.uniform(-0.03, 0.03, thrown.sum()))
    return everything


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("height_m", [0.002, 0.008, 0.015, 0.018])
def test_exact_points_give_the_exact_centre(height_m, side):
    points, centre = synthetic.arc(height_m, side=side)
    found = sight(points, side=side)
    assert found.valid and found.centre_camera == pytest.approx(centre, abs=1e-12)  # m: solver precision
    assert found.circle_radius_m == pytest.approx(np.sqrt(0.02**2 - height_m**2), abs=1e-12)
    assert found.rms_m < 1e-12 and found.inliers.all()


def test_side_plus_one_is_beyond_the_plane():
    points, centre = synthetic.arc(0.01, side=1)
    assert synthetic.PLANE.distance_m(centre[None])[0] == pytest.approx(0.01, abs=1e-15)
    assert synthetic.PLANE.distance_m(sight(points, side=1).centre_camera[None])[0] == pytest.approx(0.01, abs=1e-12)
    assert synthetic.PLANE.distance_m(sight(points, side=-1).centre_camera[None])[0] == pytest.approx(-0.01, abs=1e-12)


def test_every_arc_point_is_a_radius_from_the_centre_in_space():
    points, _ = synthetic.arc(0.012)
    found = sight(points)
    distances = np.linalg.norm(points - found.centre_camera, axis=1)
    assert distances == pytest.approx(synthetic.SPHERE_RADIUS_M, abs=1e-12)


def test_points_rounded_to_a_micron_keep_the_centre_to_a_micron():
    points, centre = synthetic.arc(0.010)
    assert np.linalg.norm(sight(np.round(points, 6)).centre_camera - centre) < 1e-6


def test_centres_scatter_as_their_covariance_says():
    rng = np.random.default_rng(0)
    points, centre = synthetic.arc(0.010, half_arc_deg=55)
    chi2, errors, predicted = [], [], []
    for _ in range(150):
        found = sight(points + along_light(rng.normal(0, SIGMA_M, len(points))))
        error = found.centre_camera - centre
        chi2.append(error @ np.linalg.solve(found.covariance_camera, error))
        errors.append(error)
        predicted.append(found.covariance_camera)
    # the covariance allows each point some error across the light too and so is up to 1.5 times too large
    assert 1.7 < np.mean(chi2) < 3.5
    ratio = np.trace(np.mean(predicted, axis=0)) / np.mean(np.sum(np.square(errors), axis=1))
    assert 0.85 < ratio < 1.8
    assert np.linalg.norm(np.mean(errors, axis=0)) < 4 * np.sqrt(np.trace(np.mean(predicted, axis=0)) / 150)


def test_height_error_is_radius_error_times_r_over_y():
    points, _ = synthetic.arc(0.008)
    found = sight(points)
    normal = synthetic.PLANE.normal_camera
    sigma_height_m = np.sqrt(normal @ found.covariance_camera @ normal)
    r_over_y = np.sqrt(0.02**2 - 0.008**2) / 0.008
    assert sigma_height_m == pytest.approx(r_over_y * found.circle_radius_sigma_m, rel=1e-6)


def test_neighbours_that_err_together_widen_the_covariance():
    rng = np.random.default_rng(1)
    points, _ = synthetic.arc(0.010)
    single = rng.normal(0, SIGMA_M, len(points))
    shared = np.repeat(single[::5], 5)[: len(points)]
    alone, together = sight(points + along_light(single)), sight(points + along_light(shared))
    assert np.trace(together.covariance_camera) > 3 * np.trace(alone.covariance_camera)  # 5 neighbours: some 5 times


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_the_arc_is_found_among_table_post_and_outliers(share):
    for seed in range(8):
        rng = np.random.default_rng(seed)
        points, centre = synthetic.arc(0.010, count=500)
        found = sight(cluttered(points, rng, share))
        assert found.valid, found.reason
        error = found.centre_camera - centre
        assert error @ np.linalg.solve(found.covariance_camera, error) < 25  # chi2 of 3: 1e-5
        assert np.linalg.norm(error) < 4e-5  # m; four of the 10 um that 480 points at 10 mm from the centre leave
        assert found.inliers[500:].mean() < 0.05


def test_order_of_points_does_not_matter():
    rng = np.random.default_rng(3)
    points, _ = synthetic.arc(0.010)
    points = cluttered(points, rng, 0.1)
    order = rng.permutation(len(points))
    assert sight(points[order]).centre_camera == pytest.approx(sight(points).centre_camera, abs=1e-12)


def test_the_same_profile_gives_the_same_bits():
    points = cluttered(synthetic.arc(0.010)[0], np.random.default_rng(4), 0.2)
    assert np.array_equal(sight(points).centre_camera, sight(points).centre_camera)


def test_points_that_are_not_valid_are_left_out():
    points, centre = synthetic.arc(0.010)
    points[100:200] = np.nan
    found = sight(points)
    assert found.centre_camera == pytest.approx(centre, abs=1e-12)
    assert found.inliers.sum() == 600 and not found.inliers[100:200].any()


@settings(max_examples=20, deadline=None)
@given(
    turn=st.tuples(*[st.floats(-0.4, 0.4)] * 3),
    height_m=st.floats(0.004, 0.017),
    x=st.floats(-0.02, 0.02),
    z=st.floats(-0.03, 0.03),
)
def test_any_light_plane_will_do(turn, height_m, x, z):
    normal = Rotation.from_rotvec(turn).apply(synthetic.PLANE.normal_camera)
    plane = LaserPlane(normal_camera=normal / np.linalg.norm(normal), offset_m=0.21)
    points, centre = synthetic.arc(height_m, centre_section=(x, z), plane=plane)
    assert sight(points, plane=plane).centre_camera == pytest.approx(centre, abs=1e-11)


def test_a_bigger_circle_than_the_sphere_is_not_its_arc():
    points, _ = synthetic.arc(0.0, radius_m=0.0207)
    found = sight(points)
    assert not found.valid and "more than the sphere's" in found.reason
    assert np.isnan(found.centre_camera).all() and not found.inliers.any()


def test_a_section_through_the_middle_is_kept_with_its_uncertainty():
    rng = np.random.default_rng(5)
    points, centre = synthetic.arc(0.0)
    found = sight(points + along_light(rng.normal(0, SIGMA_M, len(points))))
    assert found.valid
    error = found.centre_camera - centre
    assert (
        np.linalg.norm(error) < 4 * np.sqrt(np.trace(found.covariance_camera)) < 2e-3
    )  # m; in the middle of a field 2e-5


def test_a_short_arc_is_refused():
    found = sight(synthetic.arc(0.005, half_arc_deg=12, count=200)[0])
    assert not found.valid and "deg" in found.reason


@pytest.mark.parametrize("count", [0, 1, 3, 14])
def test_few_points_are_refused(count):
    found = sight(synthetic.arc(0.005, count=700)[0][:count])
    assert not found.valid and f"{count} points" in found.reason


def test_a_table_alone_shows_no_sphere():
    rng = np.random.default_rng(6)
    for slope in (0.0, 0.4):
        x = np.linspace(-0.05, 0.05, 900)
        assert not sight(section(x, slope * x) + along_light(rng.normal(0, SIGMA_M, 900))).valid


def test_a_groove_shows_no_sphere():
    x = np.linspace(-0.04, 0.04, 900)
    for wall in (0.3, 0.6, 1.0, 2.4):
        for sign in (-1, 1):
            found = sight(section(x, sign * np.maximum(0.0, 0.02 - wall * np.abs(x))))
            assert not found.valid, (wall, sign, found.circle_radius_m, found.rms_m, found.arc_rad, found.inliers.sum())


def test_points_off_the_light_plane_are_refused():
    points, _ = synthetic.arc(0.010)
    found = sight(points + 2e-3 * synthetic.PLANE.normal_camera)
    assert not found.valid and "off the light plane" in found.reason


def test_noise_alone_shows_no_sphere():
    for seed in range(10):
        rng = np.random.default_rng(seed)
        assert not sight(section(rng.uniform(-0.05, 0.05, 700), rng.uniform(-0.05, 0.05, 700))).valid


def test_bad_problems_are_refused_by_name():
    points, _ = synthetic.arc(0.010)
    with pytest.raises(BadInput, match="side is 0"):
        sight(points, side=0)
    with pytest.raises(BadInput, match="radius_m is nan"):
        sight(points, radius_m=np.nan)


def test_arc_angle_is_that_between_its_ends():
    angles = np.deg2rad(np.linspace(-50, 70, 1201))
    arc_rad, fill = _arc_seen(np.column_stack([np.sin(angles), -np.cos(angles)]))
    assert np.rad2deg(arc_rad) == pytest.approx(120 * 0.98, abs=0.1) and fill == 1.0  # 1 % left out at each end

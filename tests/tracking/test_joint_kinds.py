"""Every kind of joint on its own exact section: features, measures, and what is no such joint."""

import numpy as np
import pytest

from tracking.joint_sections import JOINTS, PLANE, butt, errors_m, fillet, lap, measured, placed, seen_stripe, u, v
from weldcell.cell.profile import Profile
from weldcell.tracking.joint import JOINT_KINDS, find_joint

PLACES = [
    {"tilt_rad": 0.0, "x_m": 0.0, "z_m": 0.18},
    {"tilt_rad": 0.12, "x_m": 0.012, "z_m": 0.19},
    {"tilt_rad": -0.12, "x_m": -0.012, "z_m": 0.175},
]
STEEP = np.deg2rad(20)
SIZES = {
    "butt": [{"gap": 0.001}, {"gap": 0.004, "mismatch": 0.001}, {"gap": 0.002, "mismatch": -0.0015}],
    "v": [{"angle": np.deg2rad(40)}, {"angle": np.deg2rad(90), "thickness": 0.006}],
    "v-gap": [{"gap": 0.002}, {"gap": 0.004, "thickness": 0.02}],
    "bevel": [{}, {"gap": 0.003}, {"mirror": True, "thickness": 0.008}],
    "u": [{}, {"gap": 0.003, "thickness": 0.025}, {"radius": 0.004}],
    "j": [{}, {"gap": 0.003, "thickness": 0.025}, {"mirror": True}],
    "lap": [{"thickness": 0.0012}, {"thickness": 0.01}, {"mirror": True}],
    "fillet": [{"angle": np.deg2rad(60)}, {}, {"angle": np.deg2rad(120)}],
    "corner": [{}, {"angle": np.deg2rad(75), "thickness": 0.01}],
}
CASES = [(kind, size) for kind, sizes in SIZES.items() for size in sizes]
COLUMN_M = 6e-5  # at most: a column's spacing at these distances
EXACT = {"v": 1e-6, "u": 1e-6, "fillet": 1e-6, "corner": 1e-6}
"""Crossings of fitted curves: to a micrometre. Where light stops: half a column, and what a slope makes of it."""


def _found(kind, drawn, place, **noise):
    parts, truth = placed(drawn, **place)
    return find_joint(measured(seen_stripe(parts), **noise), kind, PLANE), truth


def test_each_kind_has_its_names_and_an_anchor_among_them():
    assert {kind: joint.names for kind, joint in JOINT_KINDS.items()} == {
        "butt": ("left", "right"),
        "v": ("left", "root", "right"),
        "v-gap": ("left", "root", "right"),
        "bevel": ("left", "root", "right"),
        "u": ("left", "centre", "right"),
        "j": ("left", "root", "right"),
        "lap": ("edge", "root"),
        "fillet": ("root",),
        "corner": ("left", "root", "right"),
    }
    assert all(joint.anchor in joint.names for joint in JOINT_KINDS.values())


@pytest.mark.parametrize(("kind", "size"), CASES, ids=str)
def test_exact_sections_give_the_exact_features(kind, size):
    for place in PLACES:
        features, truth = _found(kind, JOINTS[kind](**size), place)
        assert features.valid, (place, features.reason)
        assert errors_m(features, truth).max() < EXACT.get(kind, 2.0 * COLUMN_M)


@pytest.mark.parametrize("tilt_rad", [-STEEP, STEEP])
@pytest.mark.parametrize("kind", ["butt", "v", "lap", "fillet", "corner"])
def test_a_tilt_of_twenty_degrees_does_not_matter(kind, tilt_rad):
    features, truth = _found(kind, JOINTS[kind](), {"tilt_rad": tilt_rad}, noise_m=2e-5, rng=np.random.default_rng(1))
    assert features.valid, features.reason
    assert np.all(errors_m(features, truth) < np.maximum(5 * features.sigma_m, COLUMN_M))


@pytest.mark.parametrize("noise_m", [1e-5, 3e-5, 1e-4])
@pytest.mark.parametrize("kind", JOINTS)
def test_noise_moves_features_by_what_they_claim(kind, noise_m):
    for seed in range(3):
        features, truth = _found(kind, JOINTS[kind](), PLACES[seed], noise_m=noise_m, rng=np.random.default_rng(seed))
        assert features.valid, features.reason
        assert np.all(errors_m(features, truth) < np.maximum(5 * features.sigma_m, COLUMN_M))


@pytest.mark.parametrize("kind", JOINTS)
def test_a_quarter_of_strays_leaves_most_joints_right_and_invents_none(kind):
    valid, worst = 0, []
    for seed in range(6):
        rng = np.random.default_rng([seed, 4])
        place = {"x_m": rng.uniform(-0.01, 0.01), "z_m": rng.uniform(0.175, 0.19)}
        features, truth = _found(kind, JOINTS[kind](), place, noise_m=3e-5, strays=0.25, rng=rng)
        valid += features.valid
        if features.valid:
            worst.append(errors_m(features, truth).max())
    assert valid >= 5
    assert np.median(worst) < 1.6e-4  # m: two columns hidden by strays beside an edge
    assert max(worst) < 1.2e-3  # m: two runs of strays of seven columns


def test_a_lateral_shift_moves_the_features_with_it():
    for shift_m in (-0.02, 0.013):
        features, truth = _found("fillet", fillet(), {"x_m": shift_m})
        assert errors_m(features, truth).max() < 1e-6  # m


@pytest.mark.parametrize("bend", [-5.0, 5.0])
@pytest.mark.parametrize("kind", ["butt", "v", "u", "lap"])
def test_plates_of_200_mm_radius_do_not_matter(kind, bend):
    place = {"z_m": 0.185, "bend": bend}
    features, truth = _found(kind, JOINTS[kind](), place, noise_m=2e-5, rng=np.random.default_rng(2))
    assert features.valid, features.reason
    assert np.all(errors_m(features, truth) < np.maximum(6 * features.sigma_m, 1.5 * COLUMN_M))


def test_measures_are_those_of_the_drawing():
    noise = {"noise_m": 1e-5, "rng": np.random.default_rng(3)}
    plates, _ = _found("butt", butt(gap=0.003, mismatch=0.001), PLACES[1], **noise)
    assert abs(plates.measures["gap_m"] - 0.003) < 2 * COLUMN_M
    assert abs(plates.measures["mismatch_m"] - 0.001) < 1e-5  # m; positive: the left plate stands higher
    groove, _ = _found("v", v(angle=np.deg2rad(60)), PLACES[1], **noise)
    assert abs(groove.measures["groove_angle_rad"] - np.deg2rad(60)) < 2e-3
    valley, _ = _found("fillet", fillet(angle=np.deg2rad(80)), PLACES[1], **noise)
    assert abs(valley.measures["angle_rad"] - np.deg2rad(80)) < 1e-3
    step, _ = _found("lap", lap(thickness=0.004), PLACES[0], **noise)
    assert abs(step.measures["step_m"] - 0.004) < 2e-5
    round_one, _ = _found("u", u(radius=0.006, gap=0.003), PLACES[0], **noise)
    assert abs(round_one.measures["radius_m"] - 0.006) < 1e-4
    assert abs(round_one.measures["gap_m"] - 0.003) < 2e-4


@pytest.mark.parametrize("kind", ["butt", "bevel", "u", "j", "lap", "fillet", "corner"])
def test_a_flat_plate_is_no_joint(kind):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        stripe = seen_stripe([np.array([[-0.04, 0.18], [0.04, 0.18]])])
        features = find_joint(measured(stripe, noise_m=3e-5, strays=0.1 * seed, rng=rng), kind, PLANE)
        assert not features.valid and features.reason
        assert np.isnan(features.points_camera).all() and np.all(features.confidence == 0)


@pytest.mark.parametrize("kind", JOINTS)
def test_where_the_joint_is_hidden_nothing_is_invented(kind):
    parts, truth = placed(JOINTS[kind]())
    low = min(x for x, _ in truth.values()) - 0.015
    high = max(x for x, _ in truth.values()) + 0.015
    hidden = measured(seen_stripe(parts), noise_m=3e-5, hidden_m=[(low, high)], rng=np.random.default_rng(5))
    assert not find_joint(hidden, kind, PLANE).valid


def test_a_tack_weld_that_fills_the_gap_is_not_taken_for_one():
    parts, _ = placed(butt(gap=0.003))
    bump = np.array([[-0.004, 0.1895], [-0.002, 0.1885], [0.002, 0.1885], [0.004, 0.1895]])
    profile = measured(seen_stripe([*parts, bump]), noise_m=2e-5, rng=np.random.default_rng(6))
    assert not find_joint(profile, "butt", PLANE).valid


@pytest.mark.parametrize("kind", ["butt", "bevel", "u", "lap", "fillet"])
def test_the_last_frame_gates_the_next(kind):
    near, _ = _found(kind, JOINTS[kind](), {"x_m": -0.01})
    close, _ = placed(JOINTS[kind](), x_m=-0.004)
    away, _ = placed(JOINTS[kind](), x_m=0.008)
    assert find_joint(measured(seen_stripe(close)), kind, PLANE, previous=near).valid
    refused = find_joint(measured(seen_stripe(away)), kind, PLANE, previous=near)
    assert not refused.valid and "15 mm" in refused.reason


@pytest.mark.parametrize("kind", JOINTS)
def test_few_or_no_points_are_refused_with_a_reason(kind):
    for count in (0, 1, 5):
        points = np.column_stack([np.linspace(0, 1e-3, count), np.zeros(count), np.full(count, 0.2)])
        profile = Profile(points_camera=points, sigma_m=np.full(count, 1e-5), valid=np.ones(count, bool))
        features = find_joint(profile, kind, PLANE)
        assert not features.valid and features.reason

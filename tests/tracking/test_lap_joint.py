"""The lap joint seen across: its face is a line of its own. From above, where it hides itself, see test_joint_kinds."""

import numpy as np
import pytest

from tracking.joint_sections import PLANE, PLATE_M, errors_m, lap, measured, placed, seen_stripe
from weldcell.tracking.joint import find_joint

ACROSS = {False: -np.pi / 4, True: np.pi / 4}
"""Tilts (mirrored or not) at which the light halves the angle between face and plates."""


def found(drawn, *, tilt_rad, noise_m=0.0, rng=None, **place):
    parts, truth = placed(drawn, tilt_rad=tilt_rad, z_m=0.185, **place)
    return find_joint(measured(seen_stripe(parts), noise_m=noise_m, rng=rng), "lap", PLANE), truth


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("thickness", [0.002, 0.006, 0.012])
def test_a_face_that_is_seen_gives_edge_and_root_exactly(mirror, thickness):
    features, truth = found(lap(thickness=thickness, mirror=mirror), tilt_rad=ACROSS[mirror])
    assert features.valid, features.reason
    assert errors_m(features, truth).max() < 1e-6  # m: crossings of exact lines, ten times below a column
    assert abs(features.measures["step_m"] - thickness) < 2e-6


@pytest.mark.parametrize("share", [0.5, 0.75, 1.0, 1.25])
def test_it_does_not_matter_from_how_far_aside_the_face_is_seen(share):
    for seed in range(3):
        rng = np.random.default_rng(seed)
        features, truth = found(lap(), tilt_rad=share * ACROSS[False], noise_m=2e-5, rng=rng)
        assert features.valid, features.reason
        assert np.all(errors_m(features, truth) < np.maximum(5 * features.sigma_m, 1e-6))
        assert features.sigma_m.max() < 2.5e-5  # m: a third of what the columns' spacing leaves to an end of light


def test_noise_scatters_the_corners_by_what_they_claim():
    relative = []
    for seed in range(40):
        features, truth = found(lap(), tilt_rad=ACROSS[False], noise_m=3e-5, rng=np.random.default_rng(seed))
        relative.append(errors_m(features, truth) / features.sigma_m)
    rms = np.sqrt(np.mean(np.square(relative)))
    assert 0.6 < rms < 1.4  # 80 corners tell it to 8 %; the plates' correlation along the stripe is guessed


def test_a_gap_between_the_plates_leaves_the_root_on_the_lower_one():
    """The face's line goes on through the gap, whose inside is dark."""
    gap, thickness = 0.001, 0.006
    upper = [[-PLATE_M, 0], [0, 0], [0, thickness - gap], [-0.004, thickness - gap]]
    lower = [[-PLATE_M, thickness], [PLATE_M, thickness]]
    features, truth = found(
        ([upper, lower], {"edge": (0, 0), "root": (0, thickness)}),
        tilt_rad=ACROSS[False],
        noise_m=1e-5,
        rng=np.random.default_rng(7),
    )
    assert features.valid, features.reason
    assert errors_m(features, truth).max() < 3e-5  # m


def test_the_face_of_a_tack_weld_is_not_taken_for_the_plates():
    """A fillet's face, at 45 deg to the plate: the edge is where the plate's light stops, the root below it."""
    thickness, leg = 0.006, 0.005
    upper = [[-PLATE_M, 0], [0, 0], [0, thickness - leg], [leg, thickness]]
    lower = [[leg, thickness], [PLATE_M, thickness]]
    features, truth = found(
        ([upper, lower], {"edge": (0, 0), "root": (0, thickness)}),
        tilt_rad=ACROSS[False],
        noise_m=2e-5,
        rng=np.random.default_rng(8),
    )
    if features.valid:  # or refused: both are honest
        assert np.all(
            errors_m(features, truth) < np.maximum(5 * features.sigma_m, 2.5e-4)
        )  # m: three columns at 45 deg


@pytest.mark.parametrize("hidden_mm", [3, 5, 8])
def test_an_edge_whose_light_is_lost_is_not_put_where_the_light_stops(hidden_mm):
    """Glare over the face and some of the plates beside it: seen across, the face should be there."""
    parts, truth = placed(lap(), tilt_rad=ACROSS[False], z_m=0.185)
    low, high = sorted(x for x, _ in truth.values())
    hidden = [(low - 1e-3 * hidden_mm, high + 1e-3)]
    profile = measured(seen_stripe(parts), noise_m=2e-5, hidden_m=hidden, rng=np.random.default_rng(9))
    features = find_joint(profile, "lap", PLANE)
    assert not features.valid and features.reason


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("share", [0.25, 0.4])
def test_a_face_too_dim_to_be_seen_leaves_the_joint_where_both_plates_end(share, mirror):
    """Light that grazes the face is dim; the lower plate begins where the face stands."""
    parts, truth = placed(lap(mirror=mirror), tilt_rad=share * ACROSS[mirror], z_m=0.185)
    low, high = sorted(x for x, _ in truth.values())
    for seed in range(3):
        rng = np.random.default_rng(seed)
        profile = measured(seen_stripe(parts), noise_m=2e-5, hidden_m=[(low + 2e-5, high - 2e-5)], rng=rng)
        features = find_joint(profile, "lap", PLANE)
        assert features.valid, features.reason
        assert errors_m(features, truth).max() < 1.6e-4  # m: two columns


@pytest.mark.parametrize("share", [0.25, 0.4])
def test_glare_over_a_leaning_face_and_a_plate_beside_it_is_no_dim_face(share):
    parts, truth = placed(lap(), tilt_rad=share * ACROSS[False], z_m=0.185)
    low, high = sorted(x for x, _ in truth.values())
    hidden = [(low - 3e-3, high + 2e-3)]
    profile = measured(seen_stripe(parts), noise_m=2e-5, hidden_m=hidden, rng=np.random.default_rng(3))
    features = find_joint(profile, "lap", PLANE)
    assert not features.valid and "should be seen" in features.reason

"""The fillet's valley among the edges of what an arc lights."""

import numpy as np
import pytest

from tracking.joint_sections import PLANE, errors_m, fillet, measured, placed, seen_stripe
from weldcell.cell.profile import Profile
from weldcell.tracking.joint import find_joint

ROOT_M = 0.19


def profile_of(parts, sigma_m, rng, scatter=1.0):
    """A profile whose points claim `sigma_m(x)`, and scatter by this share of it."""
    exact = measured(seen_stripe(parts))
    laser = PLANE.T_camera_laser.inv().apply(exact.points_camera)
    sigma = np.array([sigma_m(x) for x in laser[:, 0]])
    laser[:, 2] += scatter * sigma * rng.normal(size=len(sigma))
    return Profile(points_camera=PLANE.T_camera_laser.apply(laser), sigma_m=sigma, valid=exact.valid)


@pytest.mark.parametrize("seed", range(3))
def test_a_valley_of_points_far_less_certain_than_the_stripes_is_none(seed):
    """Two lit edges meet where the stripe is outshone; what is left of the stripe, beside them, tells how sure.

    Edges are smooth: they scatter less than the light about them makes them uncertain.
    """
    parts, _ = placed(fillet(angle=np.deg2rad(110)), z_m=ROOT_M)
    inner_m = 0.012
    outshone = profile_of(parts, lambda x: 2e-4, np.random.default_rng(seed), scatter=0.1)
    seen = np.abs(PLANE.T_camera_laser.inv().apply(outshone.points_camera)[:, 0]) < inner_m
    beside = np.array([[0.012, 0.17], [0.04, 0.17]])  # a plate that the stripe is seen on
    stripe = measured(seen_stripe([beside]), noise_m=2.5e-5, rng=np.random.default_rng(seed))
    both = Profile(
        points_camera=np.concatenate([outshone.points_camera[seen], stripe.points_camera]),
        sigma_m=np.concatenate([outshone.sigma_m[seen], stripe.sigma_m]),
        valid=np.concatenate([outshone.valid[seen], stripe.valid]),
    )
    features = find_joint(both, "fillet", PLANE)
    assert not features.valid and features.reason


@pytest.mark.parametrize("seed", range(3))
def test_a_dim_stripe_is_no_less_a_stripe_for_being_uncertain_all_over(seed):
    parts, truth = placed(fillet(), z_m=ROOT_M)
    features = find_joint(profile_of(parts, lambda x: 2e-4, np.random.default_rng(seed)), "fillet", PLANE)
    assert features.valid, features.reason
    assert errors_m(features, truth)[0] < 5 * features.sigma_m[0]


@pytest.mark.parametrize("seed", range(3))
def test_one_plate_may_be_three_times_as_uncertain_as_the_other(seed):
    parts, truth = placed(fillet(), z_m=ROOT_M)
    rng = np.random.default_rng(seed)
    features = find_joint(profile_of(parts, lambda x: 1.2e-4 if x > 0 else 4e-5, rng), "fillet", PLANE)
    assert features.valid, features.reason
    assert errors_m(features, truth)[0] < 5 * features.sigma_m[0]

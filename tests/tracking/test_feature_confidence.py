"""What a feature claims, its sigma and its confidence, against what it does."""

import numpy as np
import pytest

from joint_pictures import LEVELS, JointScene
from tracking.joint_sections import JOINTS, PLANE, errors_m, measured, placed, seen_stripe
from weldcell.tracking.confidence import RIGHT_WITHIN_M, confidence, grounds, probability
from weldcell.tracking.joint import find_joint
from weldcell.tracking.section import Corner
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate


def _trials(kind, count, *, strays, seed):
    """Errors, sigmas and confidences of all features found at random places, tilts and noise."""
    rows = []
    for number in range(count):
        rng = np.random.default_rng([number, seed])
        parts, truth = placed(
            JOINTS[kind](),
            tilt_rad=np.deg2rad(rng.uniform(-8, 8)),
            x_m=rng.uniform(-0.012, 0.012),
            z_m=rng.uniform(0.172, 0.195),
        )
        profile = measured(seen_stripe(parts), noise_m=10 ** rng.uniform(-4.8, -4.1), strays=strays, rng=rng)
        features = find_joint(profile, kind, PLANE)
        if features.valid:
            rows.append(np.stack([errors_m(features, truth), features.sigma_m, features.confidence]))
    return np.array(rows)


@pytest.mark.parametrize("kind", JOINTS)
def test_errors_are_as_large_as_sigma_says(kind):
    rows = _trials(kind, 24, strays=0.0, seed=31)
    ratio = np.sqrt(np.mean((rows[:, 0] / rows[:, 1]) ** 2))
    # 0.8 to 1.25 is asked for; the mean square of some 50 draws is known to 10 to 15 % beside that.
    assert 0.68 < ratio < 1.42
    assert len(rows) >= 23


def test_with_strays_at_least_the_share_that_is_claimed_is_right():
    rows = np.concatenate(
        [
            _trials(kind, 6, strays=strays, seed=47).swapaxes(0, 1).reshape(3, -1).T
            for kind in JOINTS
            for strays in (0.25, 0.5)
        ]
    )
    right, claimed = rows[:, 0] < RIGHT_WITHIN_M, rows[:, 2]
    for low, high in ((0.0, 0.7), (0.7, 0.95), (0.95, 1.01)):
        inside = (claimed >= low) & (claimed < high)
        # Three standard deviations of the count, twice for features of one joint being right together, and 0.05. More
        # may be right than is claimed: these profiles have no blurred edges, so their sigmas are more honest.
        assert right[inside].mean() > claimed[inside].mean() - 3 * 1.5 * _scatter(claimed[inside]) - 0.05
    assert claimed[right].mean() > claimed[~right].mean() + 0.15


def test_on_pictures_the_share_that_is_claimed_is_right():
    levels = [level for level in LEVELS if level.name in ("nominal", "light 1/30", "10 grey added", "20 grey added")]
    claims = []
    for kind in JOINTS:
        with JointScene(7, kind, 0) as scene:
            for shown in scene.pictures(1, levels):
                found = find_joint(
                    triangulate(find_stripe(shown.picture), shown.camera, shown.plane), kind, shown.plane
                )
                order = [shown.truth.names.index(name) for name in found.names]
                errors = np.linalg.norm(found.points_camera - shown.truth.points_camera[order], axis=1)
                claims += [
                    (error, claimed) for error, claimed in zip(errors, found.confidence, strict=True) if found.valid
                ]
    errors, claimed = np.array(claims).T
    right = errors < RIGHT_WITHIN_M
    assert len(right) >= 40
    # 0.05 is asked for; the benchmark counts 2000 pictures, here some 60 features of 25 joints leave this scatter.
    assert abs(right.mean() - claimed.mean()) < 0.05 + 3 * 1.5 * _scatter(claimed)
    sure = claimed > 0.95
    assert right[sure].mean() > 0.95


def _scatter(claimed):
    """Standard deviation of a share, were each right with the probability that it claims."""
    return np.sqrt(np.sum(claimed * (1 - claimed))) / len(claimed)


def test_confidence_falls_with_sigma_and_grows_with_support():
    sigma_m, support = np.geomspace(1e-6, 1e-3, 200), np.full(200, 40.0)
    by_sigma = probability(grounds(sigma_m, support))
    assert np.all(np.diff(by_sigma) <= 1e-12) and by_sigma[0] > 0.999 and by_sigma[-1] < 0.6
    by_support = probability(grounds(np.full(200, 5e-5), np.geomspace(1, 1000, 200)))
    assert np.all(np.diff(by_support) > 0)


def test_a_feature_without_grounds_is_judged_by_its_sigma():
    sure, unsure = confidence([Corner(x_m=0.0, z_m=0.2, sigma_m=sigma_m) for sigma_m in (1e-5, 3e-4)], None)
    assert sure > 0.95 > 0.65 > unsure  # large sigmas are doubts more often than errors: of 700, 0.55 were right

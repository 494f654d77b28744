"""Paper P2 as a chain, on fabricated numbers: ten translations, ten free poses, sixty touches, compensation.

The robot's pose noise is 0.04 mm an axis, the sphere's centre is seen to 5 um an axis, and the torch's tip
is not where its drawing says. The torch error is how far the actual tip misses the actual point when the
flange is sent, in the orientation of the sight, to put the tip it believes in on the measured point.
"""

import numpy as np
import pytest

import synthetic
from weldcell.calib import compensation, hand_eye, touches

POSE_SIGMA_M, SIGHT_SIGMA_M = 4e-5, 5e-6


def sight_covariances(count):
    return np.broadcast_to(SIGHT_SIGMA_M**2 * np.eye(3), (count, 3, 3))


def calibrate(seed, *, tool_error_m, estimate_tip, touch_yaw_deg=0.0):
    """First and compensated solution, the tip to command with, and the actual tip."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    actual_tip = synthetic.TIP_FLANGE + tool_error_m * direction / np.linalg.norm(direction)
    sights = synthetic.sights(rng)
    reported = synthetic.moved(sights.T_base_flange, rng, POSE_SIGMA_M)
    seen = sights.centres_camera + rng.normal(0, SIGHT_SIGMA_M, sights.centres_camera.shape)
    first = hand_eye.solve(
        hand_eye.HandEyeProblem(
            T_base_flange=reported,
            centres_camera=seen,
            covariances_camera=sight_covariances(20),
            pose_sigma_m=POSE_SIGMA_M,
        )
    )
    touching = synthetic.touch_poses(rng, tip_flange=actual_tip, yaw_deg=touch_yaw_deg)
    touched = touches.solve(
        touches.TouchProblem(
            T_base_flange=synthetic.moved(touching, rng, POSE_SIGMA_M),
            tip_flange=synthetic.TIP_FLANGE,
            radius_m=synthetic.SPHERE_RADIUS_M,
            tip_radius_m=synthetic.TIP_RADIUS_M,
            estimate_tip=estimate_tip,
            sigma_m=POSE_SIGMA_M,
        )
    )
    compensated = compensation.solve(
        compensation.CompensationProblem(
            T_base_flange=reported,
            centres_camera=seen,
            centre_base=touched.centre_base,
            T_flange_camera=first.T_flange_camera,
            covariances_camera=sight_covariances(20),
            pose_sigma_m=POSE_SIGMA_M,
            centre_covariance_base=touched.covariance[:3, :3],
        )
    )
    return first, compensated, touched, actual_tip


def torch_errors_m(seed, T_flange_camera, believed_tip, actual_tip):
    """Three points near the sphere, each from ten viewpoints."""
    rng = np.random.default_rng(1000 + seed)
    errors_m = []
    for offset in np.array([[0.060, -0.050, 0.020], [-0.070, 0.030, 0.040], [0.020, 0.080, -0.020]]):
        point_base = synthetic.SPHERE_BASE + offset
        sights = synthetic.sights(rng, translations=0, free=10, target_base=point_base)
        reported = synthetic.moved(sights.T_base_flange, rng, POSE_SIGMA_M)
        seen = sights.centres_camera + rng.normal(0, SIGHT_SIGMA_M, (10, 3))
        measured_base = reported.apply(T_flange_camera.apply(seen))
        lever_base = reported.rotation.apply(actual_tip - believed_tip)
        arrived_base = measured_base + lever_base + rng.normal(0, POSE_SIGMA_M, (10, 3))
        errors_m.append(np.linalg.norm(arrived_base - point_base, axis=1))
    return float(np.mean(errors_m))


def before_and_after_mm(seed, **options):
    first, compensated, touched, actual_tip = calibrate(seed, **options)
    before_m = torch_errors_m(seed, first.T_flange_camera, synthetic.TIP_FLANGE, actual_tip)
    after_m = torch_errors_m(seed, compensated.T_flange_camera, touched.tip_flange, actual_tip)
    return 1e3 * before_m, 1e3 * after_m


def median_mm(**options):
    return np.median([before_and_after_mm(seed, **options) for seed in range(8)], axis=0)


@pytest.mark.parametrize("tool_error_m", [0.0005, 0.004])
def test_with_the_tip_estimated_the_robots_noise_is_what_remains(tool_error_m):
    before_mm, after_mm = median_mm(tool_error_m=tool_error_m, estimate_tip=True)
    assert before_mm == pytest.approx(1e3 * tool_error_m, rel=0.15)  # the tool's error, whole
    # mm; the two moves of the check, 0.04 mm an axis each, make 0.090 of it
    assert after_mm < 0.11


def test_to_the_letter_most_of_the_tools_error_goes_and_a_part_remains():
    before_mm, after_mm = median_mm(tool_error_m=0.004, estimate_tip=False)
    assert 3.5 < before_mm < 4.5  # published: 4.573
    assert 0.3 < after_mm < 0.9  # published: 0.707


def test_to_the_letter_works_only_where_touches_and_sights_are_turned_alike():
    """The centre moves with the tip's error in the touches' orientation: touched from behind, it is wrong twice."""
    before_mm, after_mm = median_mm(tool_error_m=0.0005, estimate_tip=False, touch_yaw_deg=180.0)
    assert after_mm > 1.3 * before_mm
    assert median_mm(tool_error_m=0.0005, estimate_tip=True, touch_yaw_deg=180.0)[1] < 0.13  # mm


def test_the_tools_error_does_not_disturb_an_estimate_of_it():
    for seed in range(4):
        _, _, touched, actual_tip = calibrate(seed, tool_error_m=0.004, estimate_tip=True)
        sigma_m = np.sqrt(np.trace(touched.covariance[3:, 3:]))
        assert np.linalg.norm(touched.tip_flange - actual_tip) < 4 * sigma_m < 4e-4
        assert touched.verdict == "accepted"

"""Predicted covariances against Monte Carlo: 500 trials on the same poses, 200 where a solution takes long.

A standard deviation of 500 trials scatters by 3 % (200: 5 %), a share of 95 % by 1 % (1.5 %). Where the covariance
comes from the residuals, its own scatter belongs to the region: Fisher's distribution instead of chi2.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution

import synthetic
from weldcell.calib import compensation, hand_eye, hand_eye_batch, touches
from weldcell.calib.sight_model import perturbation
from weldcell.cell.frames import rigid_from

TRIALS, FEWER_TRIALS = 500, 200


def assert_honest(errors, covariances, freedom):
    """Every standard deviation within 15 %, and 92 to 98 % of the truths within the 95 % region."""
    size = errors.shape[1]
    predicted = np.sqrt(np.mean(np.einsum("tii->ti", covariances), axis=0))
    assert np.std(errors, axis=0) == pytest.approx(predicted, rel=0.15)
    distance2 = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(covariances), errors)
    assert 0.92 < np.mean(distance2 < size * f_distribution.isf(0.05, size, freedom)) < 0.98


def test_of_the_joint_hand_eye_estimate():
    rng = np.random.default_rng(0)
    sights = synthetic.sights(rng)
    centres = sights.centres_camera + rng.normal(0, 2e-4, (TRIALS, 20, 3))
    found = hand_eye_batch.solve(
        hand_eye_batch.HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=centres)
    )
    mounts = rigid_from(Rotation.from_matrix(found.R_flange_camera), found.translation_flange)
    errors = np.array([perturbation(sights.T_flange_camera, mount) for mount in mounts])
    assert_honest(errors, found.covariances, freedom=51)


def test_of_the_closed_form_hand_eye():
    rng = np.random.default_rng(1)
    sights = synthetic.sights(rng)
    errors, covariances = [], []
    for _ in range(FEWER_TRIALS):
        noisy = sights.centres_camera + rng.normal(0, 2e-4, (20, 3))
        given = hand_eye.HandEyeProblem(
            T_base_flange=sights.T_base_flange, centres_camera=noisy, translations=sights.translations
        )
        found = hand_eye.solve(given)
        errors.append(perturbation(sights.T_flange_camera, found.T_flange_camera))
        covariances.append(found.covariance)
    assert_honest(np.array(errors), np.array(covariances), freedom=51)


def test_of_the_compensation():
    rng = np.random.default_rng(2)
    sights = synthetic.sights(rng, translations=0, free=12)
    errors, covariances = [], []
    for _ in range(FEWER_TRIALS):
        noisy = sights.centres_camera + rng.normal(0, 1e-4, (12, 3))
        place = sights.target_base + rng.normal(0, 3e-5, 3)
        found = compensation.solve(
            compensation.CompensationProblem(
                T_base_flange=sights.T_base_flange,
                centres_camera=noisy,
                centre_base=place,
                T_flange_camera=sights.T_flange_camera,
                pose_sigma_m=1e-4,
                centre_covariance_base=np.eye(3) * 3e-5**2,
            )
        )
        errors.append(perturbation(sights.T_flange_camera, found.T_flange_camera))
        covariances.append(found.covariance)
    assert_honest(np.array(errors), np.array(covariances), freedom=10_000)  # the sigmas are given


def test_of_touches():
    rng = np.random.default_rng(3)
    poses = synthetic.touch_poses(rng, 60)
    truth = np.append(synthetic.SPHERE_BASE, synthetic.TIP_FLANGE)
    errors, covariances = [], []
    for _ in range(TRIALS):
        found = touches.solve(
            touches.TouchProblem(
                T_base_flange=synthetic.moved(poses, rng, 1e-4),
                tip_flange=synthetic.TIP_FLANGE,
                radius_m=synthetic.SPHERE_RADIUS_M,
                tip_radius_m=synthetic.TIP_RADIUS_M,
                sigma_m=1e-4,
            )
        )
        errors.append(np.append(found.centre_base, found.tip_flange) - truth)
        covariances.append(found.covariance)
    assert_honest(np.array(errors), np.array(covariances), freedom=10_000)

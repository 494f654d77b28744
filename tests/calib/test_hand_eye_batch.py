import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.calib import hand_eye
from weldcell.calib.hand_eye import HandEyeProblem
from weldcell.calib.hand_eye_batch import HandEyeBatch, solve
from weldcell.calib.joint_hand_eye import joint_estimate
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from


def noisy(sights, rng, trials, sigma_m=2e-4):
    return sights.centres_camera + rng.normal(0, sigma_m, (trials, len(sights.centres_camera), 3))


def mount_of(found, k):
    return np.column_stack([found.R_flange_camera[k], found.translation_flange[k]])


@pytest.mark.parametrize("seed", range(3))
def test_exact_sights_give_the_exact_camera(seed):
    sights = synthetic.sights(np.random.default_rng(seed))
    for refine in (False, True):
        found = solve(
            HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=sights.centres_camera[None]), refine=refine
        )
        assert mount_of(found, 0) == pytest.approx(sights.T_flange_camera.as_matrix()[:3], abs=1e-9)
        assert found.targets_base[0] == pytest.approx(sights.target_base, abs=1e-9) and found.rms_m[0] < 1e-12


@pytest.mark.parametrize("moved_flange", [False, True])
def test_each_problem_has_the_answer_it_has_alone(moved_flange):
    rng = np.random.default_rng(3)
    sights = synthetic.sights(rng)
    centres = noisy(sights, rng, 12)
    places = sights.T_base_flange.translation + rng.normal(0, 1e-4, centres.shape) * moved_flange
    batch = HandEyeBatch(
        T_base_flange=sights.T_base_flange, centres_camera=centres, flange_base=places if moved_flange else None
    )
    closed, refined = solve(batch, refine=False), solve(batch)
    for k in range(12):
        T_base_flange = rigid_from(sights.T_base_flange.rotation, places[k])
        alone = hand_eye.solve(HandEyeProblem(T_base_flange=T_base_flange, centres_camera=centres[k]))
        assert mount_of(closed, k) == pytest.approx(alone.T_flange_camera.as_matrix()[:3], abs=1e-9)  # m
        assert closed.rms_m[k] == pytest.approx(alone.rms_m, abs=1e-12)
        problem = HandEyeProblem(T_base_flange=T_base_flange, centres_camera=centres[k])
        joint = joint_estimate(problem, alone.T_flange_camera, np.zeros(20, dtype=int))
        assert mount_of(refined, k) == pytest.approx(joint.T_flange_camera.as_matrix()[:3], abs=1e-9)
        assert refined.targets_base[k] == pytest.approx(joint.targets_base[0], abs=1e-9)
        scale = np.sqrt(np.diag(refined.covariances[k]))
        assert refined.covariances[k] / np.outer(scale, scale) == pytest.approx(
            joint.found.covariance[:6, :6] / np.outer(scale, scale), abs=1e-6
        )


def test_undetermined_problems_are_nan_and_leave_the_others_alone():
    rng = np.random.default_rng(4)
    sights = synthetic.sights(rng, translations=15, free=0)
    found = solve(HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=noisy(sights, rng, 3)))
    assert np.isnan(found.translation_flange).all() and np.isnan(found.R_flange_camera).all()
    sights = synthetic.sights(rng)
    centres = noisy(sights, rng, 2)
    centres[0] = centres[0, 0]  # the target never moves in the camera
    found = solve(HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=centres))
    alone = solve(HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=centres[1:]))
    assert mount_of(found, 1) == pytest.approx(mount_of(alone, 0), abs=1e-12)


def test_shapes_that_do_not_belong_together_are_named():
    sights = synthetic.sights(np.random.default_rng(5))
    with pytest.raises(BadInput, match="NaN"):
        HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=sights.centres_camera[None] * np.nan)
    with pytest.raises(BadInput, match="20 poses, centres of shape"):
        HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=sights.centres_camera[None, :-1])


def test_it_agrees_with_a_loop_over_least_squares():
    """How much faster it is, `python -m benchmarks hand-eye` tells."""
    rng = np.random.default_rng(6)
    sights = synthetic.sights(rng)
    centres = noisy(sights, rng, 60)
    batch = HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=centres)
    R_base_flange, places = sights.T_base_flange.rotation.as_matrix(), sights.T_base_flange.translation

    def residuals(p, seen):
        flange = seen @ Rotation.from_rotvec(p[:3]).as_matrix().T + p[3:6]
        return (np.einsum("nij,nj->ni", R_base_flange, flange) + places - p[6:]).ravel()

    start = np.concatenate(
        [sights.T_flange_camera.rotation.as_rotvec(), sights.T_flange_camera.translation, sights.target_base]
    )
    loop = [least_squares(residuals, start, args=(one,)).x[3:6] for one in centres]
    found = solve(batch)
    assert found.translation_flange == pytest.approx(np.array(loop), abs=1e-6)  # m; SciPy's own tolerance

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.calib import hand_eye_batch
from weldcell.calib.pose_design import PoseDesignProblem, design, predicted_covariance
from weldcell.calib.sight_model import perturbation
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from


def problem(seed=0, count=150, **changes):
    sights = synthetic.sights(np.random.default_rng(seed), translations=0, free=count)
    return sights, PoseDesignProblem(
        T_base_flange=sights.T_base_flange,
        centres_camera=sights.centres_camera,
        T_flange_camera=sights.T_flange_camera,
        **changes,
    )


def worst_shift_m(covariance):
    return np.sqrt(np.linalg.eigvalsh(covariance[3:, 3:])[-1])


@pytest.mark.parametrize("seed", range(3))
def test_planned_poses_beat_random_ones(seed):
    _, given = problem(seed, most=10)
    planned = design(given)
    rng = np.random.default_rng(seed)
    chance = [worst_shift_m(predicted_covariance(given, rng.choice(150, 10, replace=False))) for _ in range(50)]
    assert planned.shift_sigma_m[-1] < 0.75 * np.median(chance) and planned.shift_sigma_m[-1] < np.min(chance)


def test_predicted_sigmas_agree_with_monte_carlo():
    """1000 trials of the joint estimate with 12 planned poses: each standard deviation within 10 %."""
    sights, given = problem(1, most=12, pose_sigma_m=1.5e-4)
    planned = design(given)
    rng = np.random.default_rng(0)
    T_base_flange, centres = sights.T_base_flange[planned.order], sights.centres_camera[planned.order]
    found = hand_eye_batch.solve(
        hand_eye_batch.HandEyeBatch(
            T_base_flange=T_base_flange,
            centres_camera=centres + rng.normal(0, 1.5e-4, (1000, 12, 3)),
        ),
        start=sights.T_flange_camera,
    )
    mounts = rigid_from(Rotation.from_matrix(found.R_flange_camera), found.translation_flange)
    errors = np.array([perturbation(sights.T_flange_camera, mount) for mount in mounts])
    assert np.std(errors, axis=0) == pytest.approx(np.sqrt(np.diag(planned.covariance)), rel=0.1)


def test_enough_is_the_first_number_that_meets_the_wanted_accuracy():
    _, given = problem(2, most=25, wanted_shift_m=3e-4)
    planned = design(given)
    assert planned.enough is not None and planned.reason == ""
    assert planned.shift_sigma_m[planned.enough - 1] <= 3e-4 < planned.shift_sigma_m[planned.enough - 2]
    assert np.all(np.diff(planned.shift_sigma_m[3:]) <= 0)  # a pose more never hurts


def test_what_cannot_be_reached_is_said():
    _, given = problem(3, most=5, wanted_shift_m=1e-6, wanted_turn_rad=1.0)
    planned = design(given)
    assert planned.enough is None and "mm, wanted 0.001" in planned.reason and "deg" not in planned.reason
    sights = synthetic.sights(np.random.default_rng(0), translations=20, free=0)
    still = design(
        PoseDesignProblem(
            T_base_flange=sights.T_base_flange,
            centres_camera=sights.centres_camera,
            T_flange_camera=sights.T_flange_camera,
        )
    )
    assert still.enough is None and "direction of the mount open" in still.reason


def test_measured_poses_count_and_are_not_chosen_again():
    _, given = problem(4, most=6)
    first = design(given)
    _, more = problem(4, most=4, measured=first.order)
    second = design(more)
    assert not set(second.order) & set(first.order)
    assert second.shift_sigma_m[-1] < first.shift_sigma_m[-1]
    together = predicted_covariance(given, np.concatenate([first.order, second.order]))
    assert second.covariance == pytest.approx(together, rel=1e-9)


def test_wishes_that_make_no_sense_are_refused():
    with pytest.raises(BadInput, match="wanted_shift_m"):
        problem(wanted_shift_m=0.0)
    with pytest.raises(BadInput, match="most"):
        problem(most=0)

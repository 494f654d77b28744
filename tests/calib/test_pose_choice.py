from itertools import combinations

import numpy as np
import pytest

import synthetic
from weldcell.calib.pose_choice import choose, sight_candidates, translation_candidates
from weldcell.cell.errors import BadInput


def smallest(jacobians):
    return np.linalg.svd(jacobians.reshape(-1, jacobians.shape[-1]), compute_uv=False)[-1]


def test_axes_are_chosen_one_of_each():
    jacobians = np.array([[[3.0, 0, 0]], [[2.9, 0, 0]], [[0, 2.0, 0]], [[0, 0, 1.0]]])
    assert sorted(choose(jacobians, 3)) == [0, 2, 3]


def test_the_last_of_them_is_the_best_possible_addition():
    rng = np.random.default_rng(0)
    jacobians = rng.normal(size=(40, 3, 5))
    chosen = choose(jacobians, 6)
    left = np.setdiff1d(np.arange(40), chosen[:-1])
    best = max(smallest(jacobians[np.append(chosen[:-1], index)]) for index in left)
    assert smallest(jacobians[chosen]) == pytest.approx(best, rel=1e-9)


def test_greedy_comes_close_to_the_best_of_all_sets():
    rng = np.random.default_rng(1)
    jacobians = rng.normal(size=(14, 2, 4))
    best = max(smallest(jacobians[list(some)]) for some in combinations(range(14), 5))
    assert smallest(jacobians[choose(jacobians, 5)]) > 0.75 * best


def test_what_was_measured_already_counts():
    jacobians = np.array([[[1.0, 0.0]], [[0.0, 0.5]]])
    assert choose(jacobians, 1, already=np.array([[[0.0, 2.0]]])).tolist() == [0]
    assert choose(jacobians, 1, already=np.array([[[2.0, 0.0]]])).tolist() == [1]


def test_no_candidate_is_taken_twice_and_the_first_of_equals_is_taken():
    assert choose(np.ones((5, 1, 1)), 3).tolist() == [0, 1, 2]
    with pytest.raises(BadInput, match="6 poses asked for, 5 candidates"):
        choose(np.ones((5, 1, 1)), 6)


def test_chosen_translations_vary_all_three_axes():
    rng = np.random.default_rng(2)
    sights = synthetic.sights(rng, translations=300, free=0)
    candidates = translation_candidates(sights.T_base_flange, sights.T_flange_camera, sights.centres_camera, 0.275)
    chosen = choose(candidates, 10)
    assert np.all(np.std(sights.centres_camera[chosen], axis=0) > 1.1 * np.std(sights.centres_camera, axis=0))
    assert smallest(candidates[chosen]) > 1.3 * np.median([smallest(candidates[i : i + 10]) for i in range(0, 300, 10)])


def test_chosen_free_poses_beat_random_ones():
    rng = np.random.default_rng(3)
    sights = synthetic.sights(rng, translations=0, free=300)
    candidates = sight_candidates(sights.T_base_flange, sights.T_flange_camera, sights.centres_camera, 0.275)
    chosen = choose(candidates, 10)
    assert smallest(candidates[chosen]) > 1.5 * np.median([smallest(candidates[i : i + 10]) for i in range(0, 300, 10)])

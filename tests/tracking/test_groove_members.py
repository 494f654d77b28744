"""Roots of grooves whose members differ in height, whose foot is hidden, or that are filled; doubtful gaps."""

import numpy as np
import pytest

from tracking.joint_sections import JOINTS, PLANE, PLATE_M, _arc, butt, errors_m, measured, placed, seen_stripe
from weldcell.cell.optics import LaserPlane
from weldcell.tracking.joint import find_joint

COLUMN_M = 6e-5
ANGLE, WALL, DEPTH, FACE = np.deg2rad(45), np.deg2rad(15), 0.012, 0.003
SQUARE = [[-PLATE_M, 0], [0, 0], [0, DEPTH + FACE]]


def _raised(kind, by_m):
    """Section and features with the left member higher: each root edge lies as deep in its member as before."""
    up = np.array([0.0, -by_m])
    if kind == "v":
        half = [[0, DEPTH], [DEPTH * np.tan(ANGLE / 2), 0], [PLATE_M, 0]]
        left, right = np.array(half) + up, np.array(half)[::-1] * [-1, 1]
        edges = {"left": left[1], "right": right[1]}
    elif kind == "bevel":
        left, right = np.array([[0, DEPTH], [DEPTH * np.tan(ANGLE), 0], [PLATE_M, 0]]) + up, np.array(SQUARE)
        edges = {"left": left[1], "right": (0, 0)}
    elif kind == "j":
        left, right = np.array(_arc(0.006, WALL, 0.0, DEPTH)) + up, np.array(SQUARE)
        edges = {"left": left[-2], "right": (0, 0)}
    else:
        half = np.array(_arc(0.006, WALL, 0.0, DEPTH))
        left, right = half + up, half[::-1] * [-1, 1]
        edges = {"left": left[-2], "right": right[1]}
    middle = "centre" if kind == "u" else "root"
    return [right, left], {**edges, middle: (0, DEPTH - by_m / 2)}


@pytest.mark.parametrize("by_m", [-0.001, 0.0, 0.0012])
@pytest.mark.parametrize("kind", ["v", "bevel", "j", "u"])
def test_the_root_is_midway_between_the_members_root_edges(kind, by_m):
    parts, truth = placed(_raised(kind, by_m), z_m=0.185)
    features = find_joint(measured(seen_stripe(parts), noise_m=1e-5, rng=np.random.default_rng(1)), kind, PLANE)
    assert features.valid, features.reason
    assert errors_m(features, truth).max() < 2 * COLUMN_M  # a square edge and what hangs on it; a tilted mismatch
    if kind in ("v", "u"):
        assert errors_m(features, truth).max() < 3e-5  # m
    assert features.measures["mismatch_m"] == pytest.approx(by_m, abs=2e-5)


def test_noise_does_not_widen_a_round_groove_without_gap():
    outward = []
    for seed in range(8):
        parts, truth = placed(JOINTS["u"](), z_m=0.185)
        features = find_joint(measured(seen_stripe(parts), noise_m=5e-5, rng=np.random.default_rng(seed)), "u", PLANE)
        x = (features.points_camera @ _across(PLANE))[[0, 2]]
        outward.append(np.subtract(*x) - (truth["left"][0] - truth["right"][0]))
    assert abs(np.mean(outward)) < 3 * np.std(outward) / np.sqrt(len(outward)) + 1e-6  # m


def _across(plane: LaserPlane):
    return plane.T_camera_laser.rotation.as_matrix()[:, 0]


def _bevel(hidden_m, rng, previous=None, gap=0.0, mirror=False):
    """A single bevel whose last `hidden_m` (across) before the square edge are not seen."""
    parts, truth = placed(JOINTS["bevel"](gap=gap, thickness=0.02, mirror=mirror), z_m=0.185)
    low, high = sorted([truth["right"][0], truth["right"][0] + hidden_m + gap]) if not mirror else (0.0, 0.0)
    profile = measured(seen_stripe(parts), noise_m=1e-5, hidden_m=[(low + 1e-5, high)], rng=rng)
    return find_joint(profile, "bevel", PLANE, previous=previous), truth


def test_a_foot_that_a_bend_hides_is_where_it_was_before():
    rng = np.random.default_rng(2)
    seen, _ = _bevel(0.0, rng)
    previous = seen
    for hidden_m in np.linspace(5e-5, 1.2e-3, 60):  # slowly, as along an S
        previous, truth = _bevel(hidden_m, rng, previous)
        assert errors_m(previous, truth).max() < 3 * COLUMN_M
    alone, truth = _bevel(1.2e-3, rng)
    assert errors_m(alone, truth)[1] > 5 * COLUMN_M  # what is hidden looks like a gap
    assert alone.sigma_m[1] > 0.3 * errors_m(alone, truth)[1] and alone.confidence[1] < 0.7  # and says so


def test_a_bevels_gap_that_was_seen_stays():
    rng = np.random.default_rng(3)
    seen, truth = _bevel(0.0, rng, gap=0.003)
    hidden, _ = _bevel(0.0008, rng, seen, gap=0.003)
    for features in (seen, hidden):
        assert features.measures["gap_m"] == pytest.approx(0.003, abs=3 * COLUMN_M)
        assert errors_m(features, truth).max() < 3 * COLUMN_M


@pytest.mark.parametrize("kind", ["u", "j"])
def test_a_round_groove_that_has_become_shallow_is_filled(kind):
    deep, _ = placed(JOINTS[kind](thickness=0.018), z_m=0.185)
    filled, _ = placed(JOINTS[kind](thickness=0.015), z_m=0.185)
    previous = find_joint(measured(seen_stripe(deep)), kind, PLANE)
    assert find_joint(measured(seen_stripe(filled)), kind, PLANE).valid
    refused = find_joint(measured(seen_stripe(filled)), kind, PLANE, previous=previous)
    assert not refused.valid and "higher than before" in refused.reason
    assert find_joint(measured(seen_stripe(deep)), kind, PLANE, previous=refused).valid


def test_a_tack_in_a_v_with_gap_is_not_taken_for_its_root():
    parts, _ = placed(JOINTS["v-gap"](gap=0.003, thickness=0.018), z_m=0.185)
    tack = np.array([[-0.004, 0.1955], [-0.002, 0.195], [0.002, 0.195], [0.004, 0.1955]])
    stripe = seen_stripe([*parts, tack])
    assert not find_joint(measured(stripe, noise_m=2e-5, rng=np.random.default_rng(4)), "v-gap", PLANE).valid


def test_one_hidden_end_of_a_v_with_gap_does_not_matter():
    parts, truth = placed(JOINTS["v-gap"](gap=0.002, thickness=0.018), z_m=0.185)
    profile = measured(seen_stripe(parts), noise_m=1e-5, hidden_m=[(1e-3, 2.5e-3)], rng=np.random.default_rng(5))
    features = find_joint(profile, "v-gap", PLANE)
    assert errors_m(features, truth).max() < 3 * COLUMN_M


def test_of_two_gaps_the_one_where_the_last_frame_had_it_is_taken():
    parts, truth = placed(butt(gap=0.001), z_m=0.185)
    before = find_joint(measured(seen_stripe(parts)), "butt", PLANE)
    hidden = [(0.009, 0.0115)]  # by a drop of spatter: wider than the gap
    features = find_joint(measured(seen_stripe(parts), hidden_m=hidden), "butt", PLANE, previous=before)
    assert features.valid and errors_m(features, truth).max() < 2 * COLUMN_M

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import f as f_distribution

import synthetic
from weldcell.calib.pivot import PivotProblem, solve
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from

vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)


def pivot(T_base_flange):
    return solve(PivotProblem(T_base_flange=T_base_flange))


@pytest.mark.parametrize("count", [4, 6, 30])
def test_exact_touches_give_the_exact_tip(count):
    found = pivot(synthetic.pivot_poses(np.random.default_rng(count), count))
    assert found.tip_flange == pytest.approx(synthetic.TIP_FLANGE, abs=1e-9)
    assert found.point_base == pytest.approx(synthetic.SPHERE_BASE, abs=1e-9)
    assert found.rms_m < 1e-12 and found.sound.all() and not found.observability
    assert found.verdict == ("accepted" if count > 4 else "doubtful")  # of four, a wrong one cannot be told


def test_quarter_turns_by_hand():
    """A tip 0.1 m along x and 0.3 m along z; the flange turned by quarters about z and about x, at the origin."""
    turns = Rotation.from_euler("zyx", [[0, 0, 0], [90, 0, 0], [0, 0, 90], [0, 0, -90]], degrees=True)
    places = -np.array([[0.1, 0, 0.3], [0, 0.1, 0.3], [0.1, -0.3, 0], [0.1, 0.3, 0]])
    found = pivot(rigid_from(turns, places))
    assert found.tip_flange == pytest.approx([0.1, 0, 0.3], abs=1e-12)
    assert found.point_base == pytest.approx([0, 0, 0], abs=1e-12)


@settings(max_examples=15, deadline=None)
@given(turn=vectors, shift=vectors, mount_turn=vectors, mount_shift=vectors)
def test_frames_may_be_chosen_freely(turn, shift, mount_turn, mount_shift):
    rng = np.random.default_rng(7)
    poses = synthetic.moved(synthetic.pivot_poses(rng), rng, 2e-4)
    T_other_base = rigid_from(Rotation.from_rotvec(turn), shift)
    T_flange_other = rigid_from(Rotation.from_rotvec(mount_turn), 0.1 * mount_shift)
    here, there = pivot(poses), pivot(T_other_base * poses * T_flange_other)
    assert there.tip_flange == pytest.approx(T_flange_other.inv().apply(here.tip_flange), abs=1e-9)
    assert there.point_base == pytest.approx(T_other_base.apply(here.point_base), abs=1e-9)
    assert there.rms_m == pytest.approx(here.rms_m, abs=1e-9)


def test_errors_scatter_as_the_covariance_says():
    """300 trials: each standard deviation within 15 % (its own is 4 %), 92 to 98 % within the 95 % region.

    The residuals of 10 poses tell the sigma with 24 degrees of freedom: Fisher's distribution instead of chi2.
    """
    rng = np.random.default_rng(1)
    exact = synthetic.pivot_poses(rng, 10)
    truth = np.append(synthetic.TIP_FLANGE, synthetic.SPHERE_BASE)
    limit = 3 * f_distribution.isf(0.05, 3, 24)
    errors, variances, inside = [], [], []
    for _ in range(300):
        found = pivot(synthetic.moved(exact, rng, 2e-4))
        error = np.append(found.tip_flange, found.point_base) - truth
        errors.append(error)
        variances.append(np.diag(found.covariance))
        inside.append(error[:3] @ np.linalg.solve(found.covariance[:3, :3], error[:3]) < limit)
    ratio = np.std(errors, axis=0) / np.sqrt(np.mean(variances, axis=0))
    assert ratio == pytest.approx(np.ones(6), abs=0.15)
    assert 0.92 < np.mean(inside) < 0.98


def test_wrong_poses_are_named_and_cost_less_than_twice_the_clean_error():
    clean_m, found_m = [], []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        poses = synthetic.moved(synthetic.pivot_poses(rng, 10), rng, 2e-4)
        wrong = np.isin(np.arange(10), rng.choice(10, 3, replace=False))
        spoilt = rigid_from(poses.rotation, poses.translation + wrong[:, None] * rng.uniform(0.005, 0.05, (10, 3)))
        clean, found = pivot(poses), pivot(spoilt)
        assert np.array_equal(found.sound, ~wrong) and clean.sound.all()
        clean_m.append(np.linalg.norm(clean.tip_flange - synthetic.TIP_FLANGE))
        found_m.append(np.linalg.norm(found.tip_flange - synthetic.TIP_FLANGE))
    assert np.sqrt(np.mean(np.square(found_m))) < 2 * np.sqrt(np.mean(np.square(clean_m)))


@pytest.mark.parametrize("sigma_m", [0.0, 2e-4])
def test_one_orientation_leaves_every_direction_open(sigma_m):
    rng = np.random.default_rng(2)
    found = pivot(synthetic.moved(synthetic.pivot_poses(rng, tilt_deg=0.0), rng, sigma_m))
    assert found.verdict == "refused" and len(found.observability) == 3 and np.isinf(found.covariance).all()


@pytest.mark.parametrize("sigma_m", [0.0, 2e-4])
def test_one_axis_leaves_the_tip_open_along_it(sigma_m):
    rng = np.random.default_rng(3)
    turned = synthetic.torch_down() * Rotation.from_rotvec(rng.uniform(-1, 1, (9, 1)) * [0.0, 0.6, 0.8])
    poses = rigid_from(turned, synthetic.SPHERE_BASE - turned.apply(synthetic.TIP_FLANGE))
    found = pivot(synthetic.moved(poses, rng, sigma_m))
    assert found.verdict == "refused" and len(found.observability) == 1
    assert "0.60, " in found.reasons[0] and "0.80) of the flange" in found.reasons[0]


def test_angles_that_are_only_reading_noise_do_not_pass_for_turns():
    """One orientation, read with 0.01 degrees of noise: least squares would give a tip near the flange."""
    rng = np.random.default_rng(4)
    still = synthetic.pivot_poses(rng, tilt_deg=0.0)
    read = rigid_from(Rotation.from_rotvec(rng.normal(0, 2e-4, (8, 3))) * still.rotation, still.translation)
    found = pivot(synthetic.moved(read, rng, 1e-5))
    assert found.verdict == "refused"


def test_duplicates_and_too_few_poses_are_refused():
    poses = synthetic.pivot_poses(np.random.default_rng(5))
    assert pivot(poses[[0] * 5 + [3] * 4]).verdict == "refused"
    assert pivot(poses[:3]).verdict == "refused" and "expected at least 4" in " ".join(pivot(poses[:3]).reasons)
    assert pivot(poses[:1]).verdict == "refused"


def test_inverted_transforms_and_mixed_units_are_refused():
    poses = synthetic.pivot_poses(np.random.default_rng(6), 12)
    assert pivot(poses.inv()).verdict == "doubtful"  # a pivot about the point, 1 m from the flange: only odd
    assert pivot(rigid_from(poses.rotation, poses.translation * 1e3)).verdict == "refused"
    with pytest.raises(BadInput, match="stack"):
        PivotProblem(T_base_flange=RigidTransform.identity())


def test_leave_one_out_agrees_with_leaving_out():
    rng = np.random.default_rng(8)
    poses = synthetic.moved(synthetic.pivot_poses(rng, 9), rng, 2e-4)
    missed = []
    for row in range(9):
        without = pivot(poses[np.arange(9) != row])
        assert without.sound.all()
        missed.append(np.linalg.norm(poses[row].apply(without.tip_flange) - without.point_base))
    assert pivot(poses).leave_one_out_rms_m == pytest.approx(np.sqrt(np.mean(np.square(missed))), rel=1e-9)

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

import synthetic
from weldcell.calib.hand_eye import HandEyeProblem, rotation_between, same_orientation, solve
from weldcell.calib.sight_model import perturbation
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import difference, rigid_from

vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)


def problem(sights, **changes):
    given_ = {"T_base_flange": sights.T_base_flange, "centres_camera": sights.centres_camera}
    return HandEyeProblem(**{**given_, "translations": sights.translations, **changes})


def only(sights, chosen):
    return replace(
        sights,
        T_base_flange=sights.T_base_flange[chosen],
        centres_camera=sights.centres_camera[chosen],
        translations=sights.translations[chosen],
    )


@pytest.mark.parametrize("seed", range(5))
def test_exact_sights_give_the_exact_camera(seed):
    sights = synthetic.sights(np.random.default_rng(seed))
    found = solve(problem(sights))
    angle_rad, distance_m = difference(found.T_flange_camera, sights.T_flange_camera)
    assert angle_rad < 1e-9 and distance_m < 1e-9  # solver precision
    assert found.target_base == pytest.approx(sights.target_base, abs=1e-9)
    assert found.rms_m < 1e-12 and found.verdict == "accepted" and found.converged and not found.observability


@settings(max_examples=25, deadline=None)
@given(turn=vectors, shift=vectors, mount_turn=vectors, mount_shift=vectors)
def test_frames_may_be_chosen_freely(turn, shift, mount_turn, mount_shift):
    """Another base leaves the camera's place alone, another camera frame moves it by just that."""
    rng = np.random.default_rng(7)
    sights = synthetic.sights(rng)
    noisy = sights.centres_camera + rng.normal(0, 1e-4, sights.centres_camera.shape)
    T_other_base = rigid_from(Rotation.from_rotvec(turn), shift)
    T_other_camera = rigid_from(Rotation.from_rotvec(mount_turn), 0.1 * mount_shift)
    here = solve(problem(sights, centres_camera=noisy))
    there = solve(
        problem(
            sights, T_base_flange=T_other_base * sights.T_base_flange, centres_camera=T_other_camera.inv().apply(noisy)
        )
    )
    angle_rad, distance_m = difference(there.T_flange_camera, here.T_flange_camera * T_other_camera)
    assert angle_rad < 1e-9 and distance_m < 1e-9
    assert there.target_base == pytest.approx(T_other_base.apply(here.target_base), abs=1e-9)
    assert there.residual_m == pytest.approx(here.residual_m, abs=1e-9)


@settings(max_examples=50, deadline=None)
@given(turn=vectors, normal=vectors, seed=st.integers(0, 10**6))
def test_moves_in_a_plane_never_give_a_reflection(turn, normal, seed):
    rotation = Rotation.from_rotvec(3 * turn)
    across = Rotation.from_rotvec(normal).as_matrix()[:, :2]
    moves_camera = np.random.default_rng(seed).normal(0, 0.02, (9, 2)) @ across.T
    found, values = rotation_between(moves_camera, rotation.apply(moves_camera))
    assert np.linalg.det(found.as_matrix()) == pytest.approx(1, abs=1e-12)
    assert (found.inv() * rotation).magnitude() < 1e-7  # rad; nine random moves may lie close to a line
    assert abs(values[2]) < 1e-12 * values[0]


def test_moves_in_a_plane_determine_the_rotation():
    sights = synthetic.sights(np.random.default_rng(3))
    moves_flange = sights.T_base_flange.translation[sights.translations]
    in_plane = moves_flange.copy()
    in_plane[:, 2] = in_plane[0, 2]
    centres = (sights.T_base_flange.rotation[0] * sights.T_flange_camera.rotation).inv().apply(moves_flange - in_plane)
    sights.centres_camera[sights.translations] += centres
    translation_base = sights.T_base_flange.translation
    translation_base[sights.translations] = in_plane
    found = solve(problem(sights, T_base_flange=rigid_from(sights.T_base_flange.rotation, translation_base)))
    assert difference(found.T_flange_camera, sights.T_flange_camera)[0] < 1e-9
    assert found.verdict == "accepted"


def test_without_the_determinant_moves_in_a_plane_may_reflect():
    """The misprint: P1 Eq. 13 as printed, R = V U', has determinant -1 for some sights in a plane."""
    moves = np.random.default_rng(0).normal(size=(12, 8, 2)) @ np.eye(3)[:2]
    turned = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).apply(moves.reshape(-1, 3)).reshape(moves.shape)
    printed = [np.linalg.svd(a.T @ b) for a, b in zip(moves, turned, strict=True)]
    assert min(np.linalg.det(Vt.T @ U.T) for U, _, Vt in printed) == pytest.approx(-1, abs=1e-9)


@pytest.mark.parametrize("with_covariances", [False, True])
def test_errors_scatter_as_the_covariance_says(with_covariances):
    rng = np.random.default_rng(5)
    sights = synthetic.sights(rng, translations=12, free=12)
    spread = np.array([2e-5, 6e-5, 4e-5])  # m; the height off the light plane is the worst
    given_ = {}
    if with_covariances:
        given_ = {"covariances_camera": np.broadcast_to(np.diag(spread**2), (24, 3, 3)), "pose_sigma_m": 4e-5}
    chi2, errors, predicted = [], [], []
    for _ in range(150):
        noisy = sights.centres_camera + rng.normal(size=(24, 3)) * spread
        reported = synthetic.moved(sights.T_base_flange, rng, 4e-5)
        found = solve(problem(sights, T_base_flange=reported, centres_camera=noisy, **given_))
        error = np.append(
            perturbation(sights.T_flange_camera, found.T_flange_camera), found.target_base - sights.target_base
        )
        chi2.append(error[:6] @ np.linalg.solve(found.covariance, error[:6]))
        errors.append(error)
        predicted.append(np.append(np.diag(found.covariance), np.diag(found.target_covariance_base)))
    # chi2 of 6: mean 6, scatter of the mean of 150 trials 0.28; residuals taken as alike cost a little more
    assert 4.5 < np.mean(chi2) < 7.5
    ratio = np.mean(np.square(errors), axis=0) / np.mean(predicted, axis=0)
    assert np.all((ratio > 0.6) & (ratio < 1.6))  # 150 trials: 12 % one sigma


def test_translation_is_least_squares_over_all_pairs():
    """P1 Eq. 14, 15: the same as eliminating the target from the poses (independent computation)."""
    rng = np.random.default_rng(6)
    sights = synthetic.sights(rng)
    noisy = sights.centres_camera + rng.normal(0, 3e-4, sights.centres_camera.shape)
    found = solve(problem(sights, centres_camera=noisy))
    R_base_flange = sights.T_base_flange.rotation.as_matrix()
    turned = (
        np.einsum("nij,nj->ni", R_base_flange, found.T_flange_camera.rotation.apply(noisy))
        + sights.T_base_flange.translation
    )
    first, second = np.triu_indices(len(noisy), 1)
    rows = (R_base_flange[first] - R_base_flange[second]).reshape(-1, 3)
    right = -(turned[first] - turned[second]).ravel()
    expected = np.linalg.lstsq(rows, right)[0]
    assert found.T_flange_camera.translation == pytest.approx(expected, abs=1e-12)


def test_rotation_minimises_the_moves_residual():
    rng = np.random.default_rng(8)
    a = rng.normal(size=(10, 3))
    b = Rotation.from_rotvec([0.5, 1, -2]).apply(a) + rng.normal(0, 0.1, (10, 3))
    found, _ = rotation_between(a, b)
    expected, _ = Rotation.align_vectors(b, a)  # SciPy's own Kabsch
    assert (found.inv() * expected).magnitude() < 1e-12


def test_the_group_of_translations_is_found():
    sights = synthetic.sights(np.random.default_rng(9), translations=4, free=9)
    shuffled = np.random.default_rng(0).permutation(13)
    group = same_orientation(sights.T_base_flange.rotation[shuffled])
    assert np.array_equal(group, sights.translations[shuffled])
    found = solve(problem(sights, translations=None))
    assert difference(found.T_flange_camera, sights.T_flange_camera)[1] < 1e-9


def test_pure_translations_are_refused():
    found = solve(problem(synthetic.sights(np.random.default_rng(10), translations=15, free=0)))
    assert found.verdict == "refused" and np.isinf(found.translation_condition) and found.rotation_condition < 100
    assert len(found.observability) == 3 and "translation along" in found.observability[0]
    assert np.all(np.isinf(found.covariance)) and not found.converged


def test_a_single_axis_of_rotation_is_refused_and_named():
    sights = synthetic.sights(np.random.default_rng(11))
    angles = np.where(sights.translations, 0.0, np.linspace(-0.6, 0.6, 20))
    start = sights.T_base_flange.rotation[0]
    axis_flange = np.array([0.0, 0.0, 1.0])
    R_base_flange = start * Rotation.from_rotvec(angles[:, None] * axis_flange)
    reach = R_base_flange.apply(sights.T_flange_camera.apply(sights.centres_camera))
    found = solve(problem(sights, T_base_flange=rigid_from(R_base_flange, sights.target_base - reach)))
    assert found.verdict == "refused" and found.condition_number > 1e4
    (open_direction,) = found.observability
    assert "(0.00, 0.00, 1.00) of the flange" in open_direction or "(0.00, 0.00, -1.00) of the flange" in open_direction
    assert "target along" in open_direction


def test_moves_along_a_line_are_refused():
    sights = synthetic.sights(np.random.default_rng(12))
    group = sights.translations
    step = np.linspace(-0.03, 0.03, 10)[:, None] * np.array([0.6, 0.0, 0.8])
    sights.centres_camera[group] = np.array([0.0, 0.0, 0.275]) + step
    R_base_flange = sights.T_base_flange.rotation
    reach = R_base_flange.apply(sights.T_flange_camera.apply(sights.centres_camera))
    for noise_m in (0.0, 3e-6):
        centres = sights.centres_camera + np.random.default_rng(0).normal(0, 1, (20, 3)) * noise_m
        T_base_flange = rigid_from(R_base_flange, sights.target_base - reach)
        found = solve(problem(sights, T_base_flange=T_base_flange, centres_camera=centres))
        assert found.verdict == "refused" and found.rotation_condition > 1e4
        assert any("rotation about" in words for words in found.observability)


def test_small_turns_are_doubtful():
    found = solve(problem(synthetic.sights(np.random.default_rng(13), tilt_deg=1.0)))
    assert found.verdict == "doubtful" and 100 < found.translation_condition < 1e4


def test_two_poses_are_refused():
    sights = only(synthetic.sights(np.random.default_rng(14)), np.array([0, 15]))
    for group in (None, np.array([True, True])):
        found = solve(problem(sights, translations=group))
        assert found.verdict == "refused" and np.isinf(found.condition_number)


def test_duplicates_are_refused():
    sights = only(synthetic.sights(np.random.default_rng(15)), np.array([0] * 10 + [12] * 10))
    assert solve(problem(sights)).verdict == "refused"


def test_inverted_transforms_are_refused():
    sights = synthetic.sights(np.random.default_rng(16))
    found = solve(problem(sights, T_base_flange=sights.T_base_flange.inv()))
    assert found.verdict == "refused" and found.rms_m > 0.02


@pytest.mark.parametrize("scale", [1e3, 1e-3])
def test_mixed_units_are_refused_and_guessed(scale):
    sights = synthetic.sights(np.random.default_rng(17))
    found = solve(problem(sights, centres_camera=sights.centres_camera * scale))
    assert found.verdict == "refused" and any("mm and m mixed" in reason for reason in found.reasons)


def test_a_mirrored_sensor_is_refused():
    sights = synthetic.sights(np.random.default_rng(18))
    found = solve(problem(sights, centres_camera=sights.centres_camera * [-1, 1, 1]))
    assert found.verdict == "refused" and any("mirror image" in reason for reason in found.reasons)


def test_translations_that_turn_are_doubted():
    sights = synthetic.sights(np.random.default_rng(19))
    turned = sights.T_base_flange.rotation * Rotation.from_rotvec(np.eye(20)[3][:, None] * np.deg2rad([0.2, 0, 0]))
    found = solve(problem(sights, T_base_flange=rigid_from(turned, sights.T_base_flange.translation)))
    assert found.verdict != "accepted" and any("turns by" in reason for reason in found.reasons)


def test_one_gross_row_is_named():
    rng = np.random.default_rng(20)
    sights = synthetic.sights(rng)
    centres = sights.centres_camera + rng.normal(0, 2e-5, (20, 3))
    centres[14] += [0.004, -0.003, 0.002]
    found = solve(problem(sights, centres_camera=centres))
    assert found.verdict != "accepted" and np.argmax(found.residual_m) == 14
    assert any(reason.startswith("sight 14 ") for reason in found.reasons)


def test_input_that_does_not_belong_together_is_named():
    sights = synthetic.sights(np.random.default_rng(21))
    with pytest.raises(BadInput, match="20 poses and centres of shape"):
        problem(sights, centres_camera=sights.centres_camera[:-1], translations=None)
    with pytest.raises(BadInput, match="NaN"):
        problem(sights, centres_camera=sights.centres_camera * np.nan)
    with pytest.raises(BadInput, match="translations"):
        problem(sights, translations=np.zeros(20, dtype=bool))
    with pytest.raises(BadInput, match="1 poses"):
        problem(sights, T_base_flange=RigidTransform.identity())

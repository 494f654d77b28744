"""Intrinsics from board pictures: exact recovery, honest covariance, refusal of pictures that cannot tell."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.fabricated_boards import BOARD, CAMERA, board_poses, corners
from weldcell.calib.board_bundle import intrinsics_of
from weldcell.calib.camera import CameraProblem, pose_board, solve
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import difference, rigid_from


def problem(rng, count=8, sigma_px=0.0, camera=CAMERA, lens="plain", poses=None, hold_out=False):
    poses = board_poses(rng, count) if poses is None else poses
    return CameraProblem(
        width_px=camera.width_px,
        height_px=camera.height_px,
        corners=corners(rng, poses, sigma_px, camera),
        sigma_px=max(sigma_px, 0.01),
        lens=lens,
        hold_out=hold_out,
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_exact_corners_give_the_camera_exactly(seed):
    result = solve(problem(np.random.default_rng(seed)))
    assert result.verdict == "accepted"
    # 1e-9 of the focal length in px, the solver's precision
    np.testing.assert_allclose(result.camera.focal_px, CAMERA.focal_px, rtol=1e-9)
    np.testing.assert_allclose(result.camera.principal_px, CAMERA.principal_px, atol=1e-6)
    np.testing.assert_allclose(result.camera.distortion, CAMERA.distortion, atol=1e-8)
    assert result.rms_px < 1e-8


def test_a_tilted_lens_is_found_with_its_sign():
    tilt = np.radians([10.3, 0.0])
    tilted = dataclasses.replace(CAMERA, distortion=np.array([-0.04, 0.02, *np.zeros(10), *tilt]))
    result = solve(problem(np.random.default_rng(3), camera=tilted, lens="tilted"))
    np.testing.assert_allclose(result.camera.distortion[12:], tilt, atol=1e-8)  # rad
    assert result.rms_px < 1e-7


def test_predicted_spread_of_the_intrinsics_is_what_noise_makes():
    names = ("fx", "cx", "cy", "k1", "k2", "p1", "p2")
    index = [0, 2, 3, 4, 5, 6, 7]
    poses = board_poses(np.random.default_rng(4), 8)
    scores = []
    for seed in range(12):
        result = solve(problem(np.random.default_rng(seed), sigma_px=0.1, poses=poses))
        assert result.names == names
        error = (intrinsics_of(result.camera) - intrinsics_of(CAMERA))[index]
        scores.append(error @ np.linalg.solve(result.covariance, error))
    # chi square of 7 degrees over 12 trials: mean 7, standard deviation sqrt(14 / 12) = 1.1
    assert 4.0 < np.mean(scores) < 10.0


def test_held_out_error_is_near_the_noise():
    result = solve(problem(np.random.default_rng(5), count=10, sigma_px=0.1, hold_out=True))
    # two axes of 0.1 px make 0.14 px; the left-out boards' own poses add a little
    assert 0.13 < result.held_out_rms_px < 0.19


def test_one_bad_picture_is_named():
    rng = np.random.default_rng(6)
    good = problem(rng, count=10, sigma_px=0.1)
    pixels = good.corners.pixels.copy()
    pixels[good.corners.picture == 4] += rng.normal(size=(len(BOARD), 2)) * 3.0
    result = solve(dataclasses.replace(good, corners=dataclasses.replace(good.corners, pixels=pixels)))
    assert result.outlying == (4,)
    assert any("picture 4" in reason for reason in result.reasons)
    assert abs(result.camera.focal_px[0] - CAMERA.focal_px[0]) < 5  # px: four sigma of nine good pictures


def test_parallel_boards_are_not_accepted():
    rng = np.random.default_rng(7)
    shift = rng.uniform([-0.05, -0.04, 0.25], [-0.04, -0.03, 0.30], (8, 3))
    poses = rigid_from(Rotation.from_euler("xyz", np.zeros((8, 3))), shift)
    result = solve(problem(rng, sigma_px=0.1, poses=poses))
    assert result.verdict == "refused"
    assert "fx" in " ".join(result.reasons)


def test_a_board_is_posed_exactly_by_a_known_camera():
    T = board_poses(np.random.default_rng(8), 1)[0]
    angle_rad, distance_m = difference(pose_board(CAMERA, BOARD, CAMERA.project(T.apply(BOARD))), T)
    assert angle_rad < 1e-9 and distance_m < 1e-9  # rad and m


def test_too_few_pictures_are_refused_by_name():
    with pytest.raises(BadInput, match="2 pictures show the board, expected at least 3"):
        problem(np.random.default_rng(9), count=2)

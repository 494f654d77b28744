import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.calib.axxb_methods import METHODS, motions
from weldcell.cell.frames import difference, rigid, rigid_from

vectors = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array)
methods = pytest.mark.parametrize("name", METHODS)


@methods
@pytest.mark.parametrize("seed", range(4))
def test_exact_boards_give_the_exact_camera(name, seed):
    seen = synthetic.board_sights(np.random.default_rng(seed))
    found = METHODS[name](motions(seen.T_base_flange, seen.T_camera_board))
    angle_rad, distance_m = difference(found, seen.T_flange_camera)
    assert angle_rad < 1e-9 and distance_m < 1e-9  # solver precision


@methods
@settings(max_examples=8, deadline=None)
@given(turn=vectors, shift=vectors)
def test_any_mounting_is_found_half_turns_too(name, turn, shift):
    lengths = np.linalg.norm(turn)
    half_turn = Rotation.from_rotvec(np.pi * turn / lengths) if lengths > 0.1 else Rotation.identity()
    mount = rigid_from(half_turn, 0.3 * shift)
    seen = synthetic.board_sights(np.random.default_rng(7), T_flange_camera=mount)
    found = METHODS[name](motions(seen.T_base_flange, seen.T_camera_board))
    angle_rad, distance_m = difference(found, mount)
    assert angle_rad < 1e-9 and distance_m < 1e-9


@methods
@settings(max_examples=8, deadline=None)
@given(turn=vectors, shift=vectors)
def test_base_and_board_frames_may_be_chosen_freely(name, turn, shift):
    rng = np.random.default_rng(1)
    seen = synthetic.board_sights(rng, turn_sigma_rad=1e-3, shift_sigma_m=1e-3)
    other = rigid_from(Rotation.from_rotvec(turn), shift)
    here = METHODS[name](motions(seen.T_base_flange, seen.T_camera_board))
    there = METHODS[name](motions(other * seen.T_base_flange, seen.T_camera_board * other))
    angle_rad, distance_m = difference(here, there)
    assert angle_rad < 1e-9 and distance_m < 1e-9


@pytest.mark.parametrize("name", ["park", "horaud", "andreff"])
@settings(max_examples=8, deadline=None)
@given(turn=vectors)
def test_the_camera_may_be_turned(name, turn):
    """Not with Tsai, whose tangent of the mounting's half angle weighs the motions by the camera's axes, nor with
    Daniilidis, who leaves the scalar parts of his equations out."""
    rng = np.random.default_rng(2)
    seen = synthetic.board_sights(rng, turn_sigma_rad=1e-3, shift_sigma_m=1e-3)
    turned = rigid_from(Rotation.from_rotvec(turn), np.zeros(3))
    here = METHODS[name](motions(seen.T_base_flange, seen.T_camera_board))
    there = METHODS[name](motions(seen.T_base_flange, turned.inv() * seen.T_camera_board))
    angle_rad, distance_m = difference(here * turned, there)
    assert angle_rad < 1e-9 and distance_m < 1e-9


# Flange and board poses of three pictures (quaternion with the scalar first, then mm), and what OpenCV 4.10's
# calibrateHandEye makes of them with each method: rotation vector (rad) and translation (mm).
RECORDED_FLANGE = np.array(
    [
        [0.08, 0.98, 0.11, -0.14, 620.0, 35.0, 540.0],
        [-0.12, 0.95, -0.21, 0.17, 655.0, -60.0, 505.0],
        [0.25, 0.93, 0.05, 0.22, 590.0, 90.0, 560.0],
        [0.02, 0.96, 0.26, 0.03, 700.0, 15.0, 580.0],
    ]
)


def recorded():
    """Poses written down once, the boards' with errors of a degree and some mm: every method gives its own answer."""
    rotation = Rotation.from_quat(RECORDED_FLANGE[:, :4], scalar_first=True)
    T_base_flange = rigid_from(rotation, RECORDED_FLANGE[:, 4:] * 1e-3)
    mount = rigid_from(Rotation.from_rotvec([0.3, -0.2, 1.4]), np.array([0.05, -0.02, 0.11]))
    board = rigid_from(Rotation.from_rotvec([0.1, 0.2, -0.4]), np.array([0.8, 0.1, 0.05]))
    exact = (T_base_flange * mount).inv() * board
    turns = np.array([[0.01, -0.02, 0.015], [-0.012, 0.004, 0.02], [0.003, 0.018, -0.011], [-0.007, -0.01, 0.006]])
    shifts = np.array([[1.0, -2, 0.5], [-1.5, 0.8, 2], [0.3, 1.1, -1.8], [0.9, -0.4, 0.7]]) * 1e-3
    return T_base_flange, rigid_from(Rotation.from_rotvec(turns) * exact.rotation, exact.translation + shifts)


RECORDED_CAMERA = {
    "tsai": ([0.2968232627, -0.2096817303, 1.3976781809], [49.2873428, -20.19157354, 114.90497346]),
    "park": ([0.2901591199, -0.2090160837, 1.3976992267], [49.41934996, -20.36213669, 114.82055971]),
    "horaud": ([0.2898664577, -0.2088261641, 1.3979530182], [49.43104841, -20.36549768, 114.79448537]),
    "andreff": ([0.2900348902, -0.2089992638, 1.3972365164], None),  # OpenCV does not find t again for the rotation
    "daniilidis": ([0.2968857741, -0.2095807535, 1.3973780688], [51.18212009, -16.33352696, 117.02246831]),
}


@methods
def test_noisy_boards_give_what_opencv_makes_of_them(name):
    found = METHODS[name](motions(*recorded()))
    turn_rad, place_mm = RECORDED_CAMERA[name]
    assert found.rotation.as_rotvec() == pytest.approx(turn_rad, abs=1e-9)  # rad; as printed
    assert place_mm is None or found.translation * 1e3 == pytest.approx(place_mm, abs=1e-7)  # mm; as printed


def test_pairs_that_hardly_turn_or_turn_by_half_are_no_motions():
    turns = Rotation.from_rotvec(np.deg2rad([[0, 0, 0], [0.05, 0, 0], [0, 30, 0], [0, 0, 179]]))
    T_base_flange = rigid_from(turns, np.zeros((4, 3)))
    board = rigid(np.eye(4)) * rigid_from(turns.inv(), np.zeros((4, 3)))
    assert len(motions(T_base_flange, board)) == 2  # of six pairs: 0 and 1 hardly turn, all three with pose 3 too far

"""Calibration boards: what is printed where, and what stands in the scene."""

import mujoco
import numpy as np
import pytest

from weldcell.calib.chessboard import board_points
from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import translation
from weldcell.models.board import Chessboard, LineBoard, StepTarget

BOARD = Chessboard(columns=4, rows=3, square_m=0.01)
STEPS = StepTarget(edges_m=(-0.03, -0.01, 0.01, 0.03), heights_m=(0.0, 0.01, 0.02), length_m=0.04)


def test_inner_corners_are_those_of_the_estimator():
    np.testing.assert_array_equal(BOARD.corners_board, board_points(4, 3, 0.01))


def test_squares_alternate_and_end_at_the_border():
    def black(x, y):
        return BOARD.pattern.blackness(np.array([[x, y]]))[0]

    assert black(0.005, 0.005) == black(-0.005, -0.005) == 0  # on both sides of the first inner corner, diagonally
    assert black(-0.005, 0.005) == black(0.005, -0.005) == 1
    assert black(-0.0101, 0.005) == 0  # beyond the outermost square
    places = np.random.default_rng(1).uniform([-0.01, -0.01], [0.04, 0.03], (4000, 2))
    shade = BOARD.pattern.blackness(places)
    expected = np.floor(places / 0.01).sum(axis=1) % 2
    np.testing.assert_array_equal(shade, expected)


def test_lines_are_black_where_they_should_be():
    board = LineBoard(lines=2, spacing_m=0.02, width_m=0.002, length_m=0.05)
    np.testing.assert_allclose(board.places_m, [-0.01, 0.01])
    shade = board.pattern.blackness(np.array([[-0.0105, 0], [0.0, 0], [0.0109, 0.024], [0.01, 0.026], [0.0111, 0]]))
    np.testing.assert_array_equal(shade, [1, 0, 1, 0, 0])


def test_only_ends_above_their_neighbours_are_free():
    assert STEPS.free_edges == ((0, 0), (1, 1), (2, 2), (2, 3))


@pytest.mark.parametrize("board", [BOARD, LineBoard(lines=3, spacing_m=0.02, width_m=0.001, length_m=0.05), STEPS])
def test_a_board_stands_where_it_is_put(board):
    spec = mujoco.MjSpec()
    board.add_to(spec, translation([1.0, 2.0, 3.0]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert model.body(board.name).mocapid[0] >= 0
    np.testing.assert_allclose(data.body(board.name).xpos, [1.0, 2.0, 3.0])


def test_the_print_lies_in_the_plate_s_face():
    spec = mujoco.MjSpec()
    BOARD.add_to(spec, translation([0.0, 0.0, 0.0]))
    model = spec.compile()
    assert model.geom_pos[0, 2] - model.geom_size[0, 2] == pytest.approx(0.0, abs=1e-12)  # m
    np.testing.assert_allclose(model.geom_pos[0, :2], [0.015, 0.01])  # the middle of the inner corners


@pytest.mark.parametrize(
    "make",
    [
        lambda: Chessboard(columns=1, rows=3, square_m=0.01),
        lambda: Chessboard(columns=4, rows=3, square_m=0.0),
        lambda: LineBoard(lines=2, spacing_m=0.01, width_m=0.02, length_m=0.05),
        lambda: StepTarget(edges_m=(0.0, 0.01), heights_m=(0.0, 0.01), length_m=0.04),
    ],
)
def test_impossible_boards_are_refused(make):
    with pytest.raises(BadGeometry):
        make()

"""The model of hand-eye calibration from a board: T_camera_board = (T_base_flange T_flange_camera)^-1 T_base_board.

Parameters: the six of `sight_model` for the camera, then the board's turn (board axes, rad) and shift (base axes, m).
A residual is a picture's board pose against the expected one: turn (rad), then shift (m), camera axes.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.least_squares import Model
from weldcell.calib.sight_model import ROTATION, TRANSLATION, cross_matrix, right_jacobian
from weldcell.cell.frames import rigid_from

BOARD_TURN, BOARD_SHIFT = slice(6, 9), slice(9, 12)


def board_residuals(
    T_base_flange: RigidTransform,
    T_camera_board: RigidTransform,
    T_flange_camera: RigidTransform,
    T_base_board: RigidTransform,
) -> Float[np.ndarray, "n 6"]:
    """Each picture's board pose against the expected one."""
    expected = (T_base_flange * T_flange_camera).inv() * T_base_board
    turn = (T_camera_board.rotation * expected.rotation.inv()).as_rotvec()
    return np.concatenate([turn, T_camera_board.translation - expected.translation], axis=1)


def board_model(
    T_base_flange: RigidTransform,
    T_camera_board: RigidTransform,
    T_start: RigidTransform,
    T_board: RigidTransform,
    whitening: Float[np.ndarray, "n 6 6"],
) -> Model:
    """Whitened residuals and their derivatives by the twelve parameters about a start (plain arrays, for speed)."""
    R_flange_base, flange_base = T_base_flange.rotation.inv().as_matrix(), T_base_flange.translation
    R_seen, seen_camera = T_camera_board.rotation.as_matrix(), T_camera_board.translation
    R_start, start_flange = T_start.rotation.as_matrix(), T_start.translation
    R_board, board_base = T_board.rotation.as_matrix(), T_board.translation

    def model(parameters: Float[np.ndarray, "12"]) -> tuple[np.ndarray, np.ndarray]:
        turns = Rotation.from_rotvec(parameters.reshape(4, 3)[::2]).as_matrix()
        R_camera_base = (R_start @ turns[0]).T @ R_flange_base
        R_base_board = R_board @ turns[1]
        arms_flange = np.einsum("nij,nj->ni", R_flange_base, board_base + parameters[BOARD_SHIFT] - flange_base)
        places = (arms_flange - start_flange - parameters[TRANSLATION]) @ R_start @ turns[0]
        missed = R_seen @ (R_camera_base @ R_base_board).swapaxes(1, 2)
        residuals = np.concatenate([Rotation.from_matrix(missed).as_rotvec(), seen_camera - places], axis=1)
        jacobian = board_derivatives(R_camera_base, R_start @ turns[0], R_base_board, places)
        jacobian[:, :3] = _of_turned_logarithm(residuals[:, :3]) @ jacobian[:, :3]
        jacobian[..., ROTATION] = jacobian[..., ROTATION] @ right_jacobian(parameters[ROTATION])
        jacobian[..., BOARD_TURN] = jacobian[..., BOARD_TURN] @ right_jacobian(parameters[BOARD_TURN])
        return np.einsum("nij,nj->ni", whitening, residuals), whitening @ jacobian

    return model


def board_derivatives(
    R_camera_base: Float[np.ndarray, "n 3 3"],
    R_flange_camera: Float[np.ndarray, "3 3"],
    R_base_board: Float[np.ndarray, "3 3"],
    places_camera: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 6 12"]:
    """Of the residuals, where their turns are small, with the board at `places_camera`."""
    jacobian = np.zeros((len(R_camera_base), 6, 12))
    jacobian[:, :3, ROTATION] = np.eye(3)
    jacobian[:, :3, BOARD_TURN] = -R_camera_base @ R_base_board
    jacobian[:, 3:, ROTATION] = -cross_matrix(places_camera)
    jacobian[:, 3:, TRANSLATION] = R_flange_camera.T
    jacobian[:, 3:, BOARD_SHIFT] = -R_camera_base
    return jacobian


def _of_turned_logarithm(turns: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """d log(exp(v) exp(w)) / dw at 0, to third order in v (Sola, Deray, Atchuthan 2018, eq. 144)."""
    cross = cross_matrix(turns)
    return np.asarray(np.eye(3) + cross / 2 + cross @ cross / 12)


def board_moved(T_base_board: RigidTransform, parameters: Float[np.ndarray, "12"]) -> RigidTransform:
    """The board moved by the last six parameters."""
    rotation = T_base_board.rotation * Rotation.from_rotvec(parameters[BOARD_TURN])
    return rigid_from(rotation, T_base_board.translation + parameters[BOARD_SHIFT])

"""The model of hand-eye calibration: a sight maps a target M from the camera to the base, M_b = T_bf T_fc M_c.

Parameters, wherever they stand in a row of nine:
0..2  rotation vector (rad), axes of the camera: R_flange_camera exp(rotation vector)
3..5  translation (m), axes of the flange: added to the camera's origin in the flange
6..8  target (m), axes of the base: added to the target
The first six are the perturbation of T_flange_camera that every 6x6 covariance here refers to.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.verdict import Block
from weldcell.cell.frames import rigid_from

ROTATION, TRANSLATION, TARGET = slice(0, 3), slice(3, 6), slice(6, 9)


def targets_base(
    T_base_flange: RigidTransform, T_flange_camera: RigidTransform, centres_camera: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Where each sight puts the target, in the base (m)."""
    return T_base_flange.apply(T_flange_camera.apply(centres_camera))


def sight_jacobian(
    T_base_flange: RigidTransform, T_flange_camera: RigidTransform, centres_camera: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3 9"]:
    """Derivatives of T_bf T_fc M_c - M_b by the nine parameters (residual in m, base axes)."""
    return jacobian_of(T_base_flange.rotation.as_matrix(), T_flange_camera.rotation.as_matrix(), centres_camera)


def mount_model(
    T_base_flange: RigidTransform, T_start: RigidTransform, centres_camera: Float[np.ndarray, "n 3"]
) -> Callable[[Float[np.ndarray, "6"]], tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 6"]]]:
    """What turns a perturbation of `T_start` (the first six parameters) into the targets in the base and their
    derivatives; unlike `sight_jacobian` also away from zero.
    """
    R_base_flange, flange_base = T_base_flange.rotation.as_matrix(), T_base_flange.translation
    R_start, start_flange = T_start.rotation.as_matrix(), T_start.translation

    def model(parameters: Float[np.ndarray, "6"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 6"]]:
        R_flange_camera = R_start @ Rotation.from_rotvec(parameters[ROTATION]).as_matrix()
        seen_flange = centres_camera @ R_flange_camera.T + start_flange + parameters[TRANSLATION]
        seen_base = np.einsum("nij,nj->ni", R_base_flange, seen_flange) + flange_base
        by_mount = jacobian_of(R_base_flange, R_flange_camera, centres_camera)[..., :6]
        by_mount[..., ROTATION] = by_mount[..., ROTATION] @ right_jacobian(parameters[ROTATION])
        return seen_base, by_mount

    return model


def jacobian_of(
    R_base_flange: Float[np.ndarray, "n 3 3"],
    R_flange_camera: Float[np.ndarray, "3 3"],
    centres_camera: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3 9"]:
    """The same from plain matrices, for loops: SciPy's transforms cost more than the arithmetic."""
    turning = R_base_flange @ R_flange_camera @ -cross_matrix(centres_camera)
    return np.concatenate([turning, R_base_flange, np.broadcast_to(-np.eye(3), R_base_flange.shape)], axis=-1)


def sight_covariances_base(
    T_base_flange: RigidTransform,
    T_flange_camera: RigidTransform,
    covariances_camera: Float[np.ndarray, "n 3 3"] | None,
    pose_sigma_m: float,
) -> Float[np.ndarray, "n 3 3"]:
    """Covariance of each sight's target in the base (m^2): the centre's, and the robot's for a single pose."""
    R_base_camera = (T_base_flange.rotation * T_flange_camera.rotation).as_matrix()
    robot = np.broadcast_to(pose_sigma_m**2 * np.eye(3), R_base_camera.shape)
    if covariances_camera is None:
        return robot
    return robot + R_base_camera @ covariances_camera @ R_base_camera.swapaxes(1, 2)


def perturbed(T_flange_camera: RigidTransform, parameters: Float[np.ndarray, "6"]) -> RigidTransform:
    """The transform moved by the first six parameters."""
    rotation = T_flange_camera.rotation * Rotation.from_rotvec(parameters[ROTATION])
    return rigid_from(rotation, T_flange_camera.translation + parameters[TRANSLATION])


def perturbation(T_from: RigidTransform, T_to: RigidTransform) -> Float[np.ndarray, "6"]:
    """The six parameters that move one transform to the other: the inverse of `perturbed`."""
    turn = (T_from.rotation.inv() * T_to.rotation).as_rotvec()
    return np.concatenate([turn, T_to.translation - T_from.translation])


def sight_blocks(lever_m: float) -> tuple[Block, Block, Block]:
    """Names of the nine parameters; a rotation counts by what it moves at the lever's distance."""
    return (
        Block(name="rotation about", frame="camera", unit_m=lever_m),
        Block(name="translation along", frame="flange"),
        Block(name="target along", frame="base"),
    )


def lever_m(centres_camera: Float[np.ndarray, "n 3"]) -> float:
    """Length scale for rotations: root mean square distance of the targets from the camera."""
    return float(np.sqrt(np.mean(np.sum(np.square(centres_camera), axis=-1))))


def cross_matrix(vectors: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """[v]x, the matrix with [v]x w = v x w."""
    return np.cross(np.asarray(vectors)[..., None, :], np.eye(3)).swapaxes(-1, -2)


def right_jacobian(rotation_vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """J with exp(v + dv) = exp(v) exp(J dv) (Sola, Deray, Atchuthan 2018, A micro Lie theory, eq. 143)."""
    angle = np.linalg.norm(rotation_vector)
    cross = cross_matrix(rotation_vector)
    if angle < 1e-4:  # the series is exact to 1e-16 there, the closed form loses digits
        return np.eye(3) - cross / 2 + cross @ cross / 6
    first = (1 - np.cos(angle)) / angle**2
    second = (angle - np.sin(angle)) / angle**3
    return np.eye(3) - first * cross + second * cross @ cross

"""Closed-form solutions of A X = X B: the camera X on the flange from motions A of the flange and B of the camera.

Each from its paper:
- Tsai, Lenz 1989, A new technique for fully autonomous and efficient 3D robotics hand/eye calibration
- Park, Martin 1994, Robot sensor calibration: solving AX = XB on the Euclidean group
- Horaud, Dornaika 1995, Hand-eye calibration (closed form, with quaternions)
- Andreff, Horaud, Espiau 2001, Robot hand-eye calibration using structure-from-motion (linear form)
- Daniilidis 1999, Hand-eye calibration using dual quaternions

All take every pair of poses as a motion, so that none is preferred. They differ in what they minimise, and so under
noise; from exact motions about two axes or more all give the same X.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.sight_model import cross_matrix
from weldcell.cell.frames import rigid_from

Method = Literal["tsai", "park", "horaud", "andreff", "daniilidis"]

SMALLEST_TURN_RAD = np.deg2rad(0.1)  # below, a motion's axis is noise
LARGEST_TURN_RAD = np.deg2rad(175.0)  # beyond, noise may turn the axis round
_QUARTER_FRAMES = Rotation.from_quat(np.eye(4))  # half turns about x, y, z, and none


@dataclass(frozen=True, kw_only=True, eq=False)
class Motions:
    """Motions of flange and camera between pairs of poses: A X = X B for each."""

    A_flange: RigidTransform
    """From the first pose's flange to the second's (k transforms)."""
    B_camera: RigidTransform
    """The same of the camera."""

    def __len__(self) -> int:
        return len(self.A_flange)


def motions(T_base_flange: RigidTransform, T_camera_board: RigidTransform) -> Motions:
    """All pairs of poses whose motion has an axis: it turns by 0.1 to 175 degrees, as flange and as camera say."""
    first, second = np.triu_indices(len(T_base_flange), 1)
    A = T_base_flange[second].inv() * T_base_flange[first]
    B = T_camera_board[second] * T_camera_board[first].inv()
    turns = np.stack([A.rotation.magnitude(), B.rotation.magnitude()])
    usable = np.all((turns > SMALLEST_TURN_RAD) & (turns < LARGEST_TURN_RAD), axis=0)
    return Motions(A_flange=A[usable], B_camera=B[usable])


def tsai(given: Motions) -> RigidTransform:
    """Tsai and Lenz Eq. 12: [Pa + Pb]x P' = Pb - Pa with P = 2 sin(angle / 2) axis, P' = tan(angle of X / 2) axis.

    P' is infinite for an X of half a turn, so that four frames of the camera are tried, half turns apart; the one in
    which the axes then agree best counts.
    """
    axes_flange, axes_camera = 2 * _vector_part(given.A_flange.rotation), 2 * _vector_part(given.B_camera.rotation)
    tried = [_tsai_rotation(axes_flange, frame.apply(axes_camera)) * frame for frame in _QUARTER_FRAMES]
    missed = [np.sum((axes_flange - rotation.apply(axes_camera)) ** 2) for rotation in tried]
    return _with_translation(given, tried[int(np.argmin(missed))])


def park(given: Motions) -> RigidTransform:
    """Park and Martin Eq. 21: the rotation that best maps log B to log A (by SVD, never a reflection)."""
    return _with_translation(given, _aligned(given.B_camera.rotation.as_rotvec(), given.A_flange.rotation.as_rotvec()))


def horaud(given: Motions) -> RigidTransform:
    """Horaud and Dornaika's closed form: the unit quaternion q that best maps the quaternion axis of B to that of A.

    It is the eigenvector for the least eigenvalue of sum (Q(a) - W(b))' (Q(a) - W(b)), where Q(a) q = a q and
    W(b) q = q b. Axes are sin(angle / 2) long: as unit vectors, those of small turns would count too much.
    """
    axes_flange, axes_camera = _vector_part(given.A_flange.rotation), _vector_part(given.B_camera.rotation)
    difference = _left_product(_pure(axes_flange)) - _right_product(_pure(axes_camera))
    _, vectors = np.linalg.eigh(np.einsum("kij,kil->jl", difference, difference))
    return _with_translation(given, Rotation.from_quat(vectors[:, 0], scalar_first=True))


def andreff(given: Motions) -> RigidTransform:
    """Andreff, Horaud and Espiau: R and t at once from (I - Ra (x) Rb) vec R = 0, (I (x) tb') vec R + (I - Ra) t = ta.

    The nine numbers of R are free and made a rotation afterwards, t found again with it; lengths and plain numbers
    are weighed alike, so that the unit of length (m) counts.
    """
    R_flange, R_camera = given.A_flange.rotation.as_matrix(), given.B_camera.rotation.as_matrix()
    count = len(given)
    kron = np.einsum("kij,klm->kiljm", R_flange, R_camera).reshape(count, 9, 9)
    turning = np.concatenate([np.eye(9) - kron, np.zeros((count, 9, 3))], axis=2)
    shift = np.einsum("ij,kl->kijl", np.eye(3), given.B_camera.translation).reshape(count, 3, 9)
    moving = np.concatenate([shift, np.eye(3) - R_flange], axis=2)
    rows = np.concatenate([turning, moving], axis=1).reshape(-1, 12)
    right = np.concatenate([np.zeros((count, 9)), given.A_flange.translation], axis=1).ravel()
    free = np.linalg.lstsq(rows, right, rcond=1e-12)[0][:9].reshape(3, 3)
    return _with_translation(given, _nearest_rotation(free))


def daniilidis(given: Motions) -> RigidTransform:
    """Daniilidis: the unit dual quaternion in the null space of the screws' difference (his Eq. 31 to 35)."""
    a, a_dual = _screw(given.A_flange)
    b, b_dual = _screw(given.B_camera)
    zeros = np.zeros((len(given), 3, 4))
    real = np.concatenate([(a - b)[:, :, None], cross_matrix(a + b)], axis=2)
    dual = np.concatenate([(a_dual - b_dual)[:, :, None], cross_matrix(a_dual + b_dual)], axis=2)
    rows = np.concatenate([np.concatenate([real, zeros], axis=2), np.concatenate([dual, real], axis=2)], axis=1)
    basis = np.linalg.svd(rows.reshape(-1, 8), full_matrices=True)[2][-2:]
    # q.q' = 0 makes the mixture of both null vectors isotropic for M; the larger real part is X (the other is rounding)
    mixed = basis[:, :4] @ basis[:, 4:].T
    values, vectors = np.linalg.eigh((mixed + mixed.T) / 2)
    lengths = np.sqrt(np.abs(values[::-1]))
    choices = (vectors @ (lengths * [[1, 1], [1, -1]]).T).T @ basis
    chosen = choices[np.argmax(np.linalg.norm(choices[:, :4], axis=1) / np.linalg.norm(choices, axis=1))]
    q, q_dual = chosen[:4] / np.linalg.norm(chosen[:4]), chosen[4:] / np.linalg.norm(chosen[:4])
    conjugate = q * [1, -1, -1, -1]
    translation = 2 * (_left_product(q_dual) @ conjugate)[1:]  # q' = t q / 2
    return rigid_from(Rotation.from_quat(q, scalar_first=True), translation)


METHODS: dict[Method, Callable[[Motions], RigidTransform]] = {
    "tsai": tsai,
    "park": park,
    "horaud": horaud,
    "andreff": andreff,
    "daniilidis": daniilidis,
}
"""T_flange_camera from motions, by name."""


def _with_translation(given: Motions, R_flange_camera: Rotation) -> RigidTransform:
    """The translation by least squares over all motions: (Ra - I) t = R tb - ta."""
    rows = (given.A_flange.rotation.as_matrix() - np.eye(3)).reshape(-1, 3)
    right = R_flange_camera.apply(given.B_camera.translation) - given.A_flange.translation
    return rigid_from(R_flange_camera, np.linalg.lstsq(rows, right.ravel(), rcond=1e-12)[0])


def _tsai_rotation(axes_flange: Float[np.ndarray, "k 3"], axes_camera: Float[np.ndarray, "k 3"]) -> Rotation:
    rows = cross_matrix(axes_flange + axes_camera).reshape(-1, 3)
    half_tangent = np.linalg.lstsq(rows, (axes_camera - axes_flange).ravel(), rcond=1e-12)[0]
    return Rotation.from_quat(np.append(half_tangent, 1.0))


def _aligned(vectors_camera: Float[np.ndarray, "k 3"], vectors_flange: Float[np.ndarray, "k 3"]) -> Rotation:
    return _nearest_rotation(vectors_flange.T @ vectors_camera)


def _nearest_rotation(matrix: Float[np.ndarray, "3 3"]) -> Rotation:
    """The rotation R for which trace(R' M) is largest; of a matrix with negative determinant its negative's."""
    U, _, Vt = np.linalg.svd(matrix)
    return Rotation.from_matrix(U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt)


def _vector_part(rotation: Rotation) -> Float[np.ndarray, "k 3"]:
    """sin(angle / 2) times the axis, with the angle below half a turn."""
    return np.asarray(rotation.as_quat(canonical=True)[:, :3])


def _screw(T: RigidTransform) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Vector parts of the dual quaternion of a motion: real part q, dual part t q / 2."""
    q = T.rotation.as_quat(canonical=True, scalar_first=True)
    dual = np.einsum("kij,kj->ki", _left_product(_pure(T.translation)), q) / 2
    return q[:, 1:], dual[:, 1:]


def _pure(vectors: Float[np.ndarray, "*k 3"]) -> Float[np.ndarray, "*k 4"]:
    """The quaternion (scalar first) with this vector part and no scalar."""
    return np.concatenate([np.zeros((*vectors.shape[:-1], 1)), vectors], axis=-1)


def _left_product(q: Float[np.ndarray, "*k 4"]) -> Float[np.ndarray, "*k 4 4"]:
    """The matrix Q(q) with Q(q) p = q p (scalar first)."""
    return _product(q, 1.0)


def _right_product(q: Float[np.ndarray, "*k 4"]) -> Float[np.ndarray, "*k 4 4"]:
    """The matrix W(q) with W(q) p = p q (scalar first)."""
    return _product(q, -1.0)


def _product(q: Float[np.ndarray, "*k 4"], sign: float) -> Float[np.ndarray, "*k 4 4"]:
    matrix = q[..., :1, None] * np.eye(4)
    matrix[..., 1:, 0], matrix[..., 0, 1:] = q[..., 1:], -q[..., 1:]
    matrix[..., 1:, 1:] += sign * cross_matrix(q[..., 1:])
    return matrix

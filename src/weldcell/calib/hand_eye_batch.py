"""Many hand-eye calibrations from one set of poses at once, e.g. for Monte Carlo trials: points only, no outliers.

The residuals e_i = R_i R c_i + R_i t + p_i - M (flange pose R_i p_i, target c_i in the camera, R t the camera on the
flange, M the target) are linear in z = (R's nine numbers, t). The best M makes their mean zero, so that the sum of
squares is z'Qz + 2 q'z + constant, with Q and q made of sums over the poses: R_i' R_i (x) c c' = I (x) c c', less the
mean's part. Each problem then is a 12 x 12 form, whatever the number of poses, on which Newton's method runs over
R exp(w) and t from P1's closed form (see `hand_eye`). The answer is `joint_hand_eye`'s with one target.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.hand_eye import same_orientation
from weldcell.calib.sight_model import cross_matrix
from weldcell.calib.verdict import REFUSED_CONDITION
from weldcell.cell.errors import BadInput

_TURNS = cross_matrix(np.eye(3))  # of unit vectors: the derivatives of a rotation by its rotation vector
_SMALL = 1e-13  # rad and m: a step that is rounding
_MOST_STEPS = 30
_CHUNK = 1000  # problems at a time: their forms stay in the processor's cache
_SINGULAR = REFUSED_CONDITION**-2  # relative eigenvalue of the scaled form


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEyeBatch:
    """Sights of a fixed target in the same poses, many times over."""

    T_base_flange: RigidTransform
    """Flange in the base for each sight (n transforms), common to all problems."""
    centres_camera: Float[np.ndarray, "m n 3"]
    """The target in the camera for each problem and sight (m)."""
    flange_base: Float[np.ndarray, "m n 3"] | None = None
    """The flange's places where they differ from problem to problem (m); None: those of `T_base_flange`."""
    translations: Bool[np.ndarray, "n"] | None = None
    """Which poses keep one orientation; None: the largest group that does (within 0.05 degrees)."""

    def __post_init__(self) -> None:
        count = 0 if self.T_base_flange.single else len(self.T_base_flange)
        shape = np.shape(self.centres_camera)
        if count < 4 or len(shape) != 3 or shape[1:] != (count, 3):
            raise BadInput(f"hand-eye batch: {count} poses, centres of shape {shape}, expected 4 or more and (m, n, 3)")
        if self.flange_base is not None and np.shape(self.flange_base) != shape:
            raise BadInput(f"hand-eye batch: flange_base of shape {np.shape(self.flange_base)}, expected {shape}")
        if not (np.isfinite(self.centres_camera).all() and np.isfinite(self.T_base_flange.as_matrix()).all()):
            raise BadInput("hand-eye batch: expected finite poses and centres, found NaN or infinity")


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEyeBatchResult:
    """One estimate a problem; those that are not determined are NaN."""

    R_flange_camera: Float[np.ndarray, "m 3 3"]
    translation_flange: Float[np.ndarray, "m 3"]
    """The camera's centre (m)."""
    targets_base: Float[np.ndarray, "m 3"]
    """The fixed target (m)."""
    covariances: Float[np.ndarray, "m 6 6"]
    """Rotation vector (rad, camera axes), then translation (m, flange axes); from the residuals; NaN if closed."""
    rms_m: Float[np.ndarray, "m"]
    """Root mean square length of the residuals."""


def solve(batch: HandEyeBatch, *, refine: bool = True, start: RigidTransform | None = None) -> HandEyeBatchResult:
    """The least squares estimates (with `refine`), or P1's closed form as `hand_eye` has it.

    `start` is a mount near all of them, for poses that have no translations.
    """
    group = same_orientation(batch.T_base_flange.rotation) if batch.translations is None else batch.translations
    parts = [
        _solve_part(batch, slice(k, k + _CHUNK), group, refine, start)
        for k in range(0, len(batch.centres_camera), _CHUNK)
    ]
    R, t, target, covariance, rms = (np.concatenate([part[k] for part in parts]) for k in range(5))
    return HandEyeBatchResult(
        R_flange_camera=R, translation_flange=t, targets_base=target, covariances=covariance, rms_m=rms
    )


def _solve_part(
    batch: HandEyeBatch, part: slice, group: Bool[np.ndarray, "n"], refine: bool, start: RigidTransform | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    R_base_flange, centres = batch.T_base_flange.rotation.as_matrix(), batch.centres_camera[part]
    places = batch.T_base_flange.translation[None] if batch.flange_base is None else batch.flange_base[part]
    middle = places.mean(axis=1, keepdims=True)
    Q, q = _forms(R_base_flange, centres, places - middle)
    if start is None:
        R = _rotations(batch.T_base_flange.rotation[group].mean().as_matrix(), centres[:, group], places[:, group])
    else:
        R = np.tile(start.rotation.as_matrix(), (len(centres), 1, 1))
    units = _units(centres)
    t = _translations(Q, q, R, units[:, 3:])
    covariance = np.full((len(centres), 6, 6), np.nan)
    if refine:
        R, t = _newton(Q, q, R, t, units)
    seen = (centres @ R.swapaxes(1, 2) + t[:, None])[..., None, :] @ R_base_flange.swapaxes(1, 2)
    where = seen[..., 0, :] + places
    target = where.mean(axis=1)
    squares = np.sum((where - target[:, None]) ** 2, axis=(1, 2))
    if refine:
        freedom = max(3 * centres.shape[1] - 9, 1)
        covariance = (
            _inverses(_by_mount(R).swapaxes(1, 2) @ Q @ _by_mount(R), units) * (squares / freedom)[:, None, None]
        )
    return R, t, target, covariance, np.sqrt(squares / centres.shape[1])


def _forms(
    R: Float[np.ndarray, "n 3 3"], centres: Float[np.ndarray, "m n 3"], places: Float[np.ndarray, "k n 3"]
) -> tuple[Float[np.ndarray, "m 12 12"], Float[np.ndarray, "m 12"]]:
    """Q and q; the places are counted from their mean."""
    count, poses = centres.shape[:2]
    flat = R.reshape(poses, 9)
    mean = np.zeros((count, 3, 12))
    mean[:, :, :9] = (flat.T @ centres / poses).reshape(count, 3, 9)
    mean[:, :, 9:] = R.mean(axis=0)
    Q = np.zeros((count, 12, 12))
    second, first = centres.swapaxes(1, 2) @ centres, centres.sum(axis=1)
    for axis in range(3):
        row = slice(3 * axis, 3 * axis + 3)
        Q[:, row, row] = second
        Q[:, row, 9 + axis] = Q[:, 9 + axis, row] = first
    Q[:, 9:, 9:] = poses * np.eye(3)
    Q -= poses * mean.swapaxes(1, 2) @ mean
    turned = (places[..., None, :] @ R)[..., 0, :]  # R_i' p_i
    q = np.zeros((count, 12))
    q[:, :9] = (turned.swapaxes(1, 2) @ centres).reshape(count, 9)
    q[:, 9:] = turned.sum(axis=1)
    return Q, q


def _rotations(
    R_base_flange: Float[np.ndarray, "3 3"], centres: Float[np.ndarray, "m g 3"], places: Float[np.ndarray, "k g 3"]
) -> Float[np.ndarray, "m 3 3"]:
    """P1 Eq. 13 with the determinant (see `hand_eye.rotation_between`)."""
    moves_camera = centres - centres.mean(axis=1, keepdims=True)
    moves_flange = (places.mean(axis=1, keepdims=True) - places) @ R_base_flange
    U, _, Vt = np.linalg.svd(moves_camera.swapaxes(1, 2) @ moves_flange)
    V = Vt.swapaxes(1, 2).copy()
    V[:, :, 2] *= (np.linalg.det(U) * np.linalg.det(Vt))[:, None]
    return V @ U.swapaxes(1, 2)


def _translations(
    Q: Float[np.ndarray, "m 12 12"],
    q: Float[np.ndarray, "m 12"],
    R: Float[np.ndarray, "m 3 3"],
    units: Float[np.ndarray, "m 3"],
) -> Float[np.ndarray, "m 3"]:
    right = (Q[:, 9:, :9] @ R.reshape(-1, 9, 1))[..., 0] + q[:, 9:]
    return -(_inverses(Q[:, 9:, 9:], units) @ right[..., None])[..., 0]


def _newton(
    Q: Float[np.ndarray, "m 12 12"],
    q: Float[np.ndarray, "m 12"],
    R: Float[np.ndarray, "m 3 3"],
    t: Float[np.ndarray, "m 3"],
    units: Float[np.ndarray, "m 6"],
) -> tuple[Float[np.ndarray, "m 3 3"], Float[np.ndarray, "m 3"]]:
    """The minimum near R, t. Second derivatives of R exp(w): [w]x^2 / 2 = (w w' - w'w I) / 2."""
    for _ in range(_MOST_STEPS):
        z = np.concatenate([R.reshape(-1, 9), t], axis=1)
        slope = (Q @ z[..., None])[..., 0] + q
        J = _by_mount(R)
        hessian = J.swapaxes(1, 2) @ Q @ J
        bend = slope[:, :9].reshape(-1, 3, 3).swapaxes(1, 2) @ R
        hessian[:, :3, :3] += (bend + bend.swapaxes(1, 2)) / 2
        hessian[:, :3, :3] -= np.trace(bend, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        step = -(_inverses(hessian, units) @ (J.swapaxes(1, 2) @ slope[..., None]))[..., 0]
        known = np.isfinite(step).all(axis=1)
        R = np.where(
            known[:, None, None], R @ Rotation.from_rotvec(np.where(known[:, None], step[:, :3], 0)).as_matrix(), np.nan
        )
        t = t + step[:, 3:]
        if not np.any(np.abs(step) > _SMALL):
            break
    return R, t


def _by_mount(R: Float[np.ndarray, "m 3 3"]) -> Float[np.ndarray, "m 12 6"]:
    """Derivatives of z by the mount's rotation vector and translation."""
    J = np.zeros((len(R), 12, 6))
    J[:, :9, :3] = np.moveaxis(R[:, None] @ _TURNS, 1, -1).reshape(-1, 9, 3)
    J[:, 9:, 3:] = np.eye(3)
    return J


def _units(centres: Float[np.ndarray, "m n 3"]) -> Float[np.ndarray, "m 6"]:
    """What a unit of rotation (rad) and of translation (m) moves all sights by, root of the sum of squares (m)."""
    lever = np.linalg.norm(centres, axis=(1, 2))
    return np.repeat(np.column_stack([lever, np.full_like(lever, np.sqrt(centres.shape[1]))]), 3, axis=1)


def _inverses(matrices: Float[np.ndarray, "m p p"], units: Float[np.ndarray, "m p"]) -> Float[np.ndarray, "m p p"]:
    """Inverses of symmetric matrices; NaN where one is singular with its parameters in these units."""
    scale = units[:, :, None] * units[:, None]
    scaled = np.nan_to_num(matrices / scale)
    values = np.abs(np.linalg.eigvalsh(scaled))
    singular = ~(values.min(axis=1) > _SINGULAR * values.max(axis=1))
    scaled[singular] = np.eye(matrices.shape[1])
    inverse = np.linalg.inv(scaled) / scale
    inverse[singular] = np.nan
    return inverse

"""Rigid transforms between named frames: checked construction and the few operations SciPy lacks.

`T_base_flange` maps points given in `flange` to `base`; neighbouring frames match when composing.
"""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadGeometry

_ORTHONORMAL_TOLERANCE = 1e-6  # what a matrix printed with seven digits still satisfies


def rigid(matrix: Float[np.ndarray, "*batch 4 4"]) -> RigidTransform:
    """The transform of a 4x4 matrix (m), refused unless it is finite, orthonormal and right-handed.

    SciPy's own `from_matrix` silently orthogonalises a scaled rotation and accepts NaN.
    """
    matrix = np.asarray(matrix, dtype=float)
    if matrix.shape[-2:] != (4, 4):
        raise BadGeometry(f"rigid transform: expected a 4x4 matrix, found shape {matrix.shape}")
    if not np.all(np.isfinite(matrix)):
        raise BadGeometry("rigid transform: expected finite numbers, found NaN or infinity")
    rotation = matrix[..., :3, :3]
    gram_error = np.abs(np.swapaxes(rotation, -1, -2) @ rotation - np.eye(3)).max()
    if gram_error > _ORTHONORMAL_TOLERANCE:
        raise BadGeometry(f"rigid transform: expected an orthonormal rotation, found R'R off by {gram_error:.2g}")
    if np.any(np.linalg.det(rotation) < 0):
        raise BadGeometry("rigid transform: expected a rotation, found a reflection (determinant -1)")
    if np.abs(matrix[..., 3, :] - [0, 0, 0, 1]).max() > _ORTHONORMAL_TOLERANCE:
        raise BadGeometry("rigid transform: expected the last row 0 0 0 1")
    return RigidTransform.from_matrix(matrix)


def rigid_from(rotation: Rotation, translation_m: Float[np.ndarray, "*batch 3"]) -> RigidTransform:
    """The transform with this rotation and translation (m)."""
    translation_m = np.asarray(translation_m, dtype=float)
    if not np.all(np.isfinite(translation_m)):
        raise BadGeometry("rigid transform: expected a finite translation, found NaN or infinity")
    return RigidTransform.from_components(translation_m, rotation)


def translation(translation_m: ArrayLike) -> RigidTransform:
    """The pure translation by three numbers (m)."""
    return rigid_from(Rotation.identity(), np.asarray(translation_m, dtype=float))


def axes_rotation(x: Float[np.ndarray, "3"], z: Float[np.ndarray, "3"]) -> Rotation:
    """The rotation whose columns are x (made perpendicular to z), z x x and z, all made unit."""
    z = np.asarray(z, float) / np.linalg.norm(z)
    x = np.asarray(x, float) - z * np.dot(x, z)
    x = x / np.linalg.norm(x)
    return Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))


def difference(T_a: RigidTransform, T_b: RigidTransform) -> tuple[float, float]:
    """Angle (rad) and distance (m) between two transforms that should be the same."""
    angle_rad = (T_a.rotation.inv() * T_b.rotation).magnitude()
    return float(angle_rad), float(np.linalg.norm(T_a.translation - T_b.translation))

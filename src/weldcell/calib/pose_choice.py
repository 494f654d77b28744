"""Which poses to measure from: those that leave no direction of the parameters unseen."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.calib.sight_model import ROTATION, TARGET, sight_blocks, sight_jacobian
from weldcell.cell.errors import BadInput

_TIE = 1e-9  # relative difference of information that is rounding


def choose(
    jacobians: Float[np.ndarray, "n rows p"],
    count: int,
    already: Float[np.ndarray, "m rows p"] | None = None,
) -> Int[np.ndarray, "count"]:
    """Indices of `count` candidates, in the order of their choice, that together see the parameters best.

    Greedy: each next one makes the smallest singular value of all chosen rows (and of those `already`
    measured) as large as possible. While some directions stay open whatever is chosen, the next smallest
    singular value decides, and so on. Scale the columns first: the criterion compares them. Each candidate
    is taken at most once; among equals the first.
    """
    if count > len(jacobians):
        raise BadInput(f"pose choice: {count} poses asked for, {len(jacobians)} candidates given")
    informations = np.einsum("nri,nrj->nij", jacobians, jacobians)
    total = np.zeros(informations.shape[1:])
    if already is not None:
        total = np.einsum("nri,nrj->ij", already, already)
    chosen: list[int] = []
    for _ in range(count):
        best = _best(total + informations, barred=chosen)
        chosen.append(best)
        total = total + informations[best]
    return np.array(chosen, dtype=int)


def sight_candidates(
    T_base_flange: RigidTransform,
    T_flange_camera: RigidTransform,
    centres_camera: Float[np.ndarray, "n 3"],
    lever_m: float,
) -> Float[np.ndarray, "n 3 9"]:
    """Scaled Jacobians of sights in candidate poses: rotation, translation, target (see `sight_model`).

    All columns are lengths: rotations count by what they move at `lever_m`, usually the sensor's working
    distance. For `choose`.
    """
    units_m = np.repeat([block.unit_m for block in sight_blocks(lever_m)], 3)
    return sight_jacobian(T_base_flange, T_flange_camera, centres_camera) / units_m


def translation_candidates(
    T_base_flange: RigidTransform,
    T_flange_camera: RigidTransform,
    centres_camera: Float[np.ndarray, "n 3"],
    lever_m: float,
) -> Float[np.ndarray, "n 3 6"]:
    """The same for poses of one orientation, which tell the rotation and one offset, nothing of the translation."""
    scaled = sight_candidates(T_base_flange, T_flange_camera, centres_camera, lever_m)
    return np.concatenate([scaled[..., ROTATION], scaled[..., TARGET]], axis=-1)


def _best(informations: Float[np.ndarray, "n p p"], barred: list[int]) -> int:
    """The candidate whose eigenvalues, from the smallest up, are the largest."""
    eigenvalues = np.linalg.eigvalsh(informations)
    left = np.setdiff1d(np.arange(len(informations)), barred)
    slack = _TIE * eigenvalues[left].max()
    for column in eigenvalues.T:
        left = left[column[left] >= column[left].max() - slack]
        if len(left) == 1:
            break
    return int(left[0])

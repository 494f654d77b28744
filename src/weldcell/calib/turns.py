"""Whether poses turn enough for a lever on the flange to be told from their moves.

A point v on the flange moves by (R_i - mean R) v from pose to pose. The direction that moves least is the one nearest
to a common axis of rotation; where it moves no more than the controller's angles are off, its reading is noise that
passes for a turn, and a least squares estimate along it is drawn towards zero (errors in variables) without any sign.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from weldcell.calib.verdict import Finding

SMALLEST_TURN_RAD = np.deg2rad(0.1)  # twice what still counts as one orientation (see `hand_eye`)


def least_turn(R_base_flange: Rotation) -> tuple[float, Float[np.ndarray, "3"]]:
    """Root mean square move of the flange's direction that turns least (rad), and that direction (flange axes)."""
    matrices = R_base_flange.as_matrix()
    rows = (matrices - matrices.mean(axis=0)).reshape(-1, 3)
    _, values, directions = np.linalg.svd(rows, full_matrices=False)
    return float(values[-1] / np.sqrt(len(matrices))), directions[-1]


def weigh_turns(R_base_flange: Rotation, what: str) -> list[Finding]:
    """A refusal where the poses keep one orientation, or turn about a single axis, as far as a controller can tell."""
    turn_rad, axis = least_turn(R_base_flange)
    if turn_rad >= SMALLEST_TURN_RAD:
        return []
    numbers = ", ".join(f"{value + 0.0:.2f}" for value in np.round(axis, 2))
    reason = (
        f"{what}: not determined along ({numbers}) of the flange, which turns by {np.rad2deg(turn_rad):.2g} deg rms, "
        f"expected at least {np.rad2deg(SMALLEST_TURN_RAD):.2g}: all poses share one orientation or one rotation axis"
    )
    return [Finding(verdict="refused", reason=reason)]

"""Dry friction of joints: constant while they slide, springy before.

Dahl's model (P. R. Dahl 1968, "A solid friction model", Aerospace Corporation TOR-0158): along a displacement x,
dF/dx = (F_c / z) (1 - F sign(dx) / F_c), so that friction does not depend on the speed and a joint at rest does not
creep. While x goes one way, its solution is F = s F_c + (F_0 - s F_c) exp(-|x| / z), with s the direction.
"""

import numpy as np
from jaxtyping import Float


class DryFriction:
    """Friction torques of the joints, and what they remember."""

    def __init__(self, coulomb_nm: Float[np.ndarray, "6"], presliding_rad: float) -> None:
        """`presliding_rad` (z): after a reversal the friction has turned round to 1 - 2/e of its full size."""
        self._coulomb_nm, self._presliding_rad = np.array(coulomb_nm, float), presliding_rad
        self.release()

    def release(self) -> None:
        """Nothing is stretched."""
        self.torque_nm: Float[np.ndarray, "6"] = np.zeros_like(self._coulomb_nm)
        """What a motor has to give to overcome it."""

    def turn(self, displacement_rad: Float[np.ndarray, "6"]) -> None:
        """The joints turn by this, each one way."""
        sliding_nm = np.sign(displacement_rad) * self._coulomb_nm
        left = np.exp(-np.abs(displacement_rad) / self._presliding_rad)
        self.torque_nm = sliding_nm + (self.torque_nm - sliding_nm) * left

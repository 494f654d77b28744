"""The arm as it was found to be: where its flange is, and how to send it where it should be."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.arm_model import chain
from weldcell.cell.arm import NominalArm
from weldcell.cell.frames import rigid_from

_NEWTON_STEPS = 4  # from a nominal inverse, millimetres off: 1e-5, 1e-10 m and rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class CalibratedArm:
    """A nominal arm and the errors found in it."""

    nominal: NominalArm
    errors: Float[np.ndarray, "e"]
    """See `arm_model`."""

    def flanges(self, joints_rad: Float[np.ndarray, "n k"]) -> RigidTransform:
        """T_base_flange (a stack) at n joint readings."""
        now = chain(self.nominal, joints_rad, self.errors)
        return rigid_from(Rotation.from_matrix(now.R_base_flange), now.flange_base)

    def readings(self, T_base_flange: RigidTransform, near_rad: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """Joint readings that take the flange to n poses, by Newton steps from readings that nearly do.

        `near_rad` is the nominal inverse. For six joints, away from singular postures; limits are not looked
        at: the readings change by no more than the arm's errors.
        """
        R_wanted, wanted_base = T_base_flange.rotation.as_matrix(), T_base_flange.translation
        joints_rad = np.array(near_rad, dtype=float)
        for _ in range(_NEWTON_STEPS):
            now = chain(self.nominal, joints_rad, self.errors)
            turn = Rotation.from_matrix(R_wanted @ now.R_base_flange.swapaxes(1, 2)).as_rotvec()
            miss = np.concatenate([wanted_base - now.flange_base, turn], axis=1)
            jacobian = np.concatenate([now.by_readings(now.flange_base), now.axes_base.swapaxes(1, 2)], axis=1)
            joints_rad = joints_rad + np.linalg.solve(jacobian, miss[..., None])[..., 0]
        return joints_rad

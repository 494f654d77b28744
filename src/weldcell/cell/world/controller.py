"""The robot as its controller believes it to be: forward and inverse kinematics within limits."""

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from eaik.IK_HP import HPRobot
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.arm import NominalArm
from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import rigid_from
from weldcell.cell.world.robot_error import JOINTS

_TURNS = 2 * np.pi * np.array([-1, 0, 1])  # joints whose range exceeds a turn have several readings for one angle


@dataclass(frozen=True, kw_only=True, eq=False)
class Controller:
    """Nominal kinematics of a six-axis arm as a product of exponentials, with limits and speeds."""

    axes_base: Float[np.ndarray, "6 3"]
    """Joint axes at reading zero."""
    anchors_base: Float[np.ndarray, "6 3"]
    """A point on each joint axis at reading zero, m."""
    T_base_flange_zero: RigidTransform
    """Flange at reading zero."""
    limits_rad: Float[np.ndarray, "6 2"]
    """Lower and upper limit of each joint."""
    speeds_rad_s: Float[np.ndarray, "6"]
    """Largest speed of each joint."""

    @staticmethod
    def from_model(model: mujoco.MjModel, speeds_rad_s: Float[np.ndarray, "6"]) -> "Controller":
        """The controller of the arm in a compiled model with joints `arm/joint_1`.. and site `arm/flange`."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        joints = [model.joint(f"arm/joint_{k + 1}").id for k in range(JOINTS)]
        site = model.site("arm/flange").id
        rotation = Rotation.from_matrix(data.site_xmat[site].reshape(3, 3))
        return Controller(
            axes_base=data.xaxis[joints].copy(),
            anchors_base=data.xanchor[joints].copy(),
            T_base_flange_zero=rigid_from(rotation, data.site_xpos[site].copy()),
            limits_rad=model.jnt_range[joints].copy(),
            speeds_rad_s=np.asarray(speeds_rad_s, float),
        )

    def forward(self, joints_rad: Float[np.ndarray, "*batch 6"]) -> RigidTransform:
        """T_base_flange for joint readings (product of exponentials)."""
        joints_rad = np.asarray(joints_rad, float)
        T = None
        for k in range(JOINTS):
            rotation = Rotation.from_rotvec(joints_rad[..., k, None] * self.axes_base[k])
            anchor = self.anchors_base[k]
            step = rigid_from(rotation, anchor - rotation.apply(anchor))
            T = step if T is None else T * step
        assert T is not None
        return T * self.T_base_flange_zero

    def inverse(self, T_base_flange: RigidTransform, near_rad: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """Joint readings within limits that take the flange there, the nearest to `near_rad`.

        Raises OutOfReach if there are none.
        """
        readings = self.all_inverse(T_base_flange)
        if not len(readings):
            place = ", ".join(f"{1e3 * x:.1f}" for x in T_base_flange.translation)
            raise OutOfReach(f"the arm cannot take the flange to ({place}) mm within its joint limits")
        effort = np.max(np.abs(readings - near_rad) / self.speeds_rad_s, axis=1)
        return readings[np.argmin(effort)]

    def all_inverse(self, T_base_flange: RigidTransform) -> Float[np.ndarray, "n 6"]:
        """All joint readings within limits that take the flange there."""
        T_base_last = T_base_flange.as_matrix()
        T_base_last[:3, :3] = T_base_last[:3, :3] @ self.T_base_flange_zero.rotation.inv().as_matrix()
        solutions = self._solver.IK(T_base_last)
        if not solutions.num_solutions():
            return np.empty((0, JOINTS))
        exact = solutions.Q[~np.asarray(solutions.is_LS, bool)]
        readings = [self._unwrapped(q) for q in exact]
        return np.concatenate(readings) if readings else np.empty((0, JOINTS))

    def _unwrapped(self, joints_rad: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 6"]:
        """All readings within limits that show the same joint angles."""
        low, high = self.limits_rad.T
        wrapped = np.angle(np.exp(1j * joints_rad))
        choices = [[x for x in wrapped[k] + _TURNS if low[k] <= x <= high[k]] for k in range(JOINTS)]
        return np.array(np.meshgrid(*choices)).reshape(JOINTS, -1).T

    @cached_property
    def _solver(self) -> HPRobot:
        offsets = np.diff(np.vstack([np.zeros(3), self.anchors_base, self.T_base_flange_zero.translation]), axis=0)
        return HPRobot(self.axes_base, offsets)


def nominal_arm(controller: Controller, model: mujoco.MjModel) -> NominalArm:
    """The controller's arm as plain numbers, with the masses that the compiled model hangs on it, tools included."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    links = [int(model.jnt_bodyid[model.joint(f"arm/joint_{k + 1}").id]) for k in range(JOINTS)]
    masses_kg, moments = np.zeros(JOINTS), np.zeros((JOINTS, 3))
    for body in range(1, model.nbody):
        carrier = body
        while carrier and carrier not in links:
            carrier = int(model.body_parentid[carrier])
        if carrier:
            masses_kg[links.index(carrier)] += model.body_mass[body]
            moments[links.index(carrier)] += model.body_mass[body] * data.xipos[body]
    return NominalArm(
        axes_base=controller.axes_base,
        anchors_base=controller.anchors_base,
        T_base_flange_zero=controller.T_base_flange_zero,
        link_masses_kg=masses_kg,
        link_centres_base=moments / masses_kg[:, None],
    )

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
from weldcell.cell.world.numerical_inverse import NumericalInverse, closed_form
from weldcell.cell.world.robot_error import JOINTS

_TURNS = 2 * np.pi * np.array([-1, 0, 1])  # joints whose range exceeds a turn have several readings for one angle
_NEIGHBOUR_RAD = 0.3  # a solution this near on every joint needs no comparison with those of other configurations


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
        readings = self._neighbours(T_base_flange, near_rad)
        if not len(readings):
            readings = self.all_inverse(T_base_flange)
        if not len(readings):
            place = ", ".join(f"{1e3 * x:.1f}" for x in T_base_flange.translation)
            raise OutOfReach(f"the arm cannot take the flange to ({place}) mm within its joint limits")
        effort = np.max(np.abs(readings - near_rad) / self.speeds_rad_s, axis=1)
        return readings[np.argmin(effort)]

    def all_inverse(self, T_base_flange: RigidTransform) -> Float[np.ndarray, "n 6"]:
        """All joint readings within limits that take the flange there; without a closed form, those that are found."""
        angles_rad = self._closed(T_base_flange) if self.has_closed_form else self._numerical.all(T_base_flange)
        readings = [self._unwrapped(q) for q in angles_rad]
        return np.concatenate(readings) if readings else np.empty((0, JOINTS))

    @property
    def has_closed_form(self) -> bool:
        """Whether the inverse is exact and complete (spherical wrist, three parallel axes and the like)."""
        return bool(self._solver.hasKnownDecomposition())

    def wrist_sine(self, joints_rad: Float[np.ndarray, "6"]) -> float:
        """Sine of the angle between axes 4 and 6: 0 where the wrist is stretched, whichever way joint 5 counts."""
        fifth = Rotation.from_rotvec(joints_rad[4] * self.axes_base[4])
        return float(np.linalg.norm(np.cross(self.axes_base[3], fifth.apply(self.axes_base[5]))))

    def _closed(self, T_base_flange: RigidTransform) -> Float[np.ndarray, "n 6"]:
        T_base_last = T_base_flange.as_matrix()
        T_base_last[:3, :3] = T_base_last[:3, :3] @ self.T_base_flange_zero.rotation.inv().as_matrix()
        solutions = self._solver.IK(T_base_last)
        if not solutions.num_solutions():
            return np.empty((0, JOINTS))
        return solutions.Q[~np.asarray(solutions.is_LS, bool)]

    def _neighbours(self, T_base_flange: RigidTransform, near_rad: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 6"]:
        """For an arm without a closed form, the solution close by: what paths mostly ask for, many times cheaper."""
        if self.has_closed_form:
            return np.empty((0, JOINTS))
        near_rad = np.asarray(near_rad, float)
        readings = self._numerical.near(T_base_flange, near_rad[None])
        low, high = self.limits_rad.T
        close = np.abs(readings - near_rad).max(axis=1) < _NEIGHBOUR_RAD
        return readings[close & np.all((readings >= low) & (readings <= high), axis=1)]

    def _unwrapped(self, joints_rad: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 6"]:
        """All readings within limits that show the same joint angles."""
        low, high = self.limits_rad.T
        wrapped = np.angle(np.exp(1j * joints_rad))
        choices = [[x for x in wrapped[k] + _TURNS if low[k] <= x <= high[k]] for k in range(JOINTS)]
        return np.array(np.meshgrid(*choices)).reshape(JOINTS, -1).T

    @cached_property
    def _solver(self) -> HPRobot:
        return closed_form(self.axes_base, self.anchors_base, self.T_base_flange_zero)

    @cached_property
    def _numerical(self) -> NumericalInverse:
        return NumericalInverse(
            axes_base=self.axes_base, anchors_base=self.anchors_base, T_base_flange_zero=self.T_base_flange_zero
        )


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

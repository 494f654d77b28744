"""The arm alone, as masses and joints: what the drives move, small enough to step at the servo's rate."""

import mujoco
import numpy as np
from jaxtyping import Float

from weldcell.cell.world.robot_error import JOINTS


class BareArm:
    """An arm's motion under torques at its joints, rotors included and friction apart; nothing can touch it."""

    def __init__(self, model: mujoco.MjModel, step_s: float) -> None:
        """The arm of a cell's compiled model, with all that hangs on it, to be moved in steps of `step_s`."""
        self._model = _without_shapes(model, step_s)
        self._data, self._scratch = mujoco.MjData(self._model), mujoco.MjData(self._model)

    @property
    def angles_rad(self) -> Float[np.ndarray, "6"]:
        """Joint angles now."""
        return self._data.qpos.copy()

    @property
    def rates_rad_s(self) -> Float[np.ndarray, "6"]:
        """Their difference over the last step: the rates in its middle."""
        return self._data.qvel.copy()

    def put(self, angles_rad: Float[np.ndarray, "6"]) -> None:
        """Puts the arm at rest at these angles."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = angles_rad

    def step(self, torque_nm: Float[np.ndarray, "6"]) -> None:
        """Moves on by a step under these torques."""
        self._data.qfrc_applied[:] = torque_nm
        mujoco.mj_step(self._model, self._data)

    def torque_nm(
        self,
        angles_rad: Float[np.ndarray, "6"],
        rates_rad_s: Float[np.ndarray, "6"],
        accelerations_rad_s2: Float[np.ndarray, "6"],
    ) -> Float[np.ndarray, "6"]:
        """What a motion takes at the joints (inverse dynamics)."""
        data = self._scratch
        data.qpos[:], data.qvel[:], data.qacc[:] = angles_rad, rates_rad_s, accelerations_rad_s2
        mujoco.mj_inverse(self._model, data)
        return data.qfrc_inverse.copy()

    def inertias_kgm2(self, angles_rad: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """Inertia that each joint's motor feels while the others are held."""
        still = np.zeros(JOINTS)
        weight_nm = self.torque_nm(angles_rad, still, still)
        return np.diag([self.torque_nm(angles_rad, still, one) for one in np.eye(JOINTS)]) - weight_nm


def _without_shapes(model: mujoco.MjModel, step_s: float) -> mujoco.MjModel:
    """The bodies from the base on, with their masses, and the six joints with their rotors."""
    spec = mujoco.MjSpec()
    spec.option.timestep = step_s
    spec.option.gravity = model.opt.gravity
    base = model.body("arm/base").id
    bodies = {base: spec.worldbody.add_body(name="base", pos=model.body_pos[base], quat=model.body_quat[base])}
    for k in range(base + 1, model.nbody):
        parent = bodies.get(int(model.body_parentid[k]))
        if parent is not None:
            bodies[k] = _add_body(parent, model, k)
    for k in range(JOINTS):
        joint = model.joint(f"arm/joint_{k + 1}")
        bodies[int(model.jnt_bodyid[joint.id])].add_joint(
            name=f"joint_{k + 1}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            pos=joint.pos,
            axis=joint.axis,
            armature=model.dof_armature[joint.dofadr[0]],
        )
    return spec.compile()


def _add_body(parent: mujoco.MjsBody, model: mujoco.MjModel, k: int) -> mujoco.MjsBody:
    return parent.add_body(
        name=model.body(k).name,
        pos=model.body_pos[k],
        quat=model.body_quat[k],
        mass=model.body_mass[k],
        ipos=model.body_ipos[k],
        iquat=model.body_iquat[k],
        inertia=model.body_inertia[k],
        explicitinertial=True,
    )

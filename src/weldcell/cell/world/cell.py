"""The standing cell: the actual robot with its sensor and torch, and the parts on the table."""

from collections.abc import Mapping

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import UnknownFrame
from weldcell.cell.frames import rigid_from
from weldcell.cell.world.collisions import Collisions
from weldcell.cell.world.robot_error import JOINTS, RobotError

CLEARANCE_M = 0.008  # poses and paths keep at least this far from parts: more than a robot's and a part's misplacement
_SITE_OWNERS = {"flange": "arm", "camera": "sensor", "torch": "torch"}
_WORKPIECES = ("plate", "boss")  # parts whose grooves and corners the torch may enter
_DEFLECTION_PASSES = 2  # the load barely changes by deflecting: the second pass moves the tip by less than 1e-7 m


class Cell:
    """A compiled scene and the arm in it; `take` and `place` change it, everything else reads it."""

    def __init__(self, model: mujoco.MjModel, error: RobotError, bodies: Mapping[str, str]) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.error = error
        self._joints = np.array([model.joint(f"arm/joint_{k + 1}").qposadr[0] for k in range(JOINTS)])
        self._dofs = np.array([model.joint(f"arm/joint_{k + 1}").dofadr[0] for k in range(JOINTS)])
        self._sites = {name: model.site(f"{owner}/{name}").id for name, owner in _SITE_OWNERS.items()}
        self._parts = {part: int(model.body(body).mocapid[0]) for part, body in bodies.items()}
        self._collisions = Collisions(model, [body for part, body in bodies.items() if part in _WORKPIECES])
        self.take(np.zeros(JOINTS))

    @property
    def parts(self) -> list[str]:
        """Names of the parts that can be placed."""
        return list(self._parts)

    def take(self, joints_rad: Float[np.ndarray, "6"], rng: np.random.Generator | None = None) -> None:
        """Moves the arm to joint readings: zeros, deflection under gravity and (with `rng`) repeatability act."""
        angles = np.asarray(joints_rad, float) + self.error.zero_rad
        if rng is not None:
            angles = angles + rng.normal(size=JOINTS) * self.error.repeatability_rad
        deflection = np.zeros(JOINTS)
        if self.error.compliance_rad_per_nm.any():
            for _ in range(_DEFLECTION_PASSES):
                deflection = -self.error.compliance_rad_per_nm * self._gravity_torque_nm(angles + deflection)
        self.data.qpos[self._joints] = angles + deflection
        self.update()

    def place(self, part: str, T_base_part: RigidTransform) -> None:
        """Puts a part somewhere else."""
        if part not in self._parts:
            raise UnknownFrame(part, self.parts)
        self.data.mocap_pos[self._parts[part]] = T_base_part.translation
        self.data.mocap_quat[self._parts[part]] = T_base_part.rotation.as_quat(scalar_first=True)
        self.update()

    def T_base_part(self, part: str) -> RigidTransform:
        """Where a part stands."""
        if part not in self._parts:
            raise UnknownFrame(part, self.parts)
        k = self._parts[part]
        return rigid_from(
            Rotation.from_quat(self.data.mocap_quat[k].copy(), scalar_first=True), self.data.mocap_pos[k].copy()
        )

    def T_base(self, frame: str) -> RigidTransform:
        """The actual pose of `flange`, `camera` or `torch` in the base."""
        if frame not in self._sites:
            raise UnknownFrame(frame, list(self._sites))
        k = self._sites[frame]
        return rigid_from(Rotation.from_matrix(self.data.site_xmat[k].reshape(3, 3)), self.data.site_xpos[k].copy())

    @property
    def T_flange_camera(self) -> RigidTransform:
        """The actual sensor mount."""
        return self.T_base("flange").inv() * self.T_base("camera")

    @property
    def tip_flange(self) -> Float[np.ndarray, "3"]:
        """The actual torch tip on the flange, m."""
        return self.T_base("flange").inv().apply(self.tip_base)

    @property
    def tip_base(self) -> Float[np.ndarray, "3"]:
        """The actual torch tip, m."""
        return self.data.site_xpos[self._sites["torch"]].copy()

    def update(self) -> None:
        """Brings all derived poses up to date with joints and parts."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)

    def collides(self, joints_rad: Float[np.ndarray, "6"], work_clearance_m: float | None = None) -> bool:
        """Whether arm, torch or head come within the clearance of anything else, or the tools of the arm.

        At work the torch must come closer to the workpiece than in travel: `work_clearance_m` is for that, between
        real surfaces. Wire and tip never count. Raises BadGeometry if it is larger than the usual clearance.
        """
        self.take(joints_rad)
        return self._collisions.any(self.data, work_clearance_m)

    def _gravity_torque_nm(self, angles_rad: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """The torque that holds each joint against gravity, by MuJoCo's recursive Newton-Euler at rest."""
        self.data.qpos[self._joints] = angles_rad
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        self.data.qvel[:] = 0
        mujoco.mj_comVel(self.model, self.data)
        torque = np.zeros(self.model.nv)
        mujoco.mj_rne(self.model, self.data, 0, torque)
        return torque[self._dofs]

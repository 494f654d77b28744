"""Kinematics of an arm that is not built as drawn: where its flange really goes for given joint readings.

A product of exponentials with an error between each link and the next. At reading zero all link frames are
taken parallel to the base, link k's origin at its joint's anchor a_k. With W_k = (R_k, t_k) the transform
of everything before joint k,
    R_k+1 = R_k exp(twist_k) exp(axis_k angle_k),   t_k+1 = R_k (a_k + offset_k) + t_k - R_k+1 a_k,
    angle_k = reading_k + zero_k - compliance_k torque_k,
torque_k being what joint k must hold against gravity, of the nominal masses in the nominal posture (the
errors change it by a thousandth). It says more than it must (a zero is a twist about the joint's axis, the
first and the last link's errors move base and tools): with priors that does no harm, and no choice of
independent parameters has to be made where neighbouring axes are parallel.

Errors are one row of 8 k numbers: offsets (3 k, m), twists (3 k, rad), zeros (k, rad), compliances (k, rad/Nm).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from weldcell.calib.sight_model import cross_matrix, right_jacobian
from weldcell.cell.arm import NominalArm

_GRAVITY_M_S2 = 9.81  # along -z of the base


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmSlices:
    """Where each kind of error stands in the row."""

    offsets: slice
    twists: slice
    zeros: slice
    compliances: slice
    size: int

    @staticmethod
    def of(joints: int) -> "ArmSlices":
        """For an arm of so many joints."""
        return ArmSlices(
            offsets=slice(0, 3 * joints),
            twists=slice(3 * joints, 6 * joints),
            zeros=slice(6 * joints, 7 * joints),
            compliances=slice(7 * joints, 8 * joints),
            size=8 * joints,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """An arm in n postures, with what its derivatives need."""

    R_base_flange: Float[np.ndarray, "n 3 3"]
    flange_base: Float[np.ndarray, "n 3"]
    """The flange's origin (m)."""
    R_base_link: Float[np.ndarray, "n k 3 3"]
    """Turn of each link's error (before its twist and joint)."""
    origins_base: Float[np.ndarray, "n k 3"]
    """A point on each joint's axis (m)."""
    axes_base: Float[np.ndarray, "n k 3"]
    torques_nm: Float[np.ndarray, "n k"]
    """Held by each joint against gravity."""
    twists_rad: Float[np.ndarray, "k 3"]

    def points_base(self, points_flange: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Where points fixed to the flange are, one in each posture (m)."""
        return np.einsum("nij,nj->ni", self.R_base_flange, points_flange) + self.flange_base

    def by_errors(self, points_base: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 e"]:
        """Derivatives of points that the flange carries by the 8 k errors."""
        count, joints = self.origins_base.shape[:2]
        levers = points_base[:, None] - self.origins_base
        left = np.array([right_jacobian(-twist) for twist in self.twists_rad])
        by_twists = -cross_matrix(levers) @ self.R_base_link @ left
        by_zeros = np.cross(self.axes_base, levers).swapaxes(1, 2)
        return np.concatenate(
            [
                self.R_base_link.swapaxes(1, 2).reshape(count, 3, 3 * joints),
                by_twists.swapaxes(1, 2).reshape(count, 3, 3 * joints),
                by_zeros,
                -by_zeros * self.torques_nm[:, None],
            ],
            axis=-1,
        )

    def by_readings(self, points_base: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 k"]:
        """Derivatives of points that the flange carries by the joint readings (gravity's change left out)."""
        return np.cross(self.axes_base, points_base[:, None] - self.origins_base).swapaxes(1, 2)


def chain(
    arm: NominalArm,
    joints_rad: Float[np.ndarray, "n k"],
    errors: Float[np.ndarray, "e"],
    torques_nm: Float[np.ndarray, "n k"] | None = None,
) -> Chain:
    """The arm with these errors at these readings; torques where they are known already."""
    if torques_nm is None:
        torques_nm = gravity_torques_nm(arm, joints_rad)
    return _chain(arm, joints_rad, errors, torques_nm)


def gravity_torques_nm(arm: NominalArm, joints_rad: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """What each joint of the nominal arm holds against gravity, positive in the joint's own sense."""
    nominal = _chain(arm, joints_rad, np.zeros(8 * arm.joints), np.zeros_like(joints_rad))
    # Body k moves with everything up to joint k: the link frame before joint k + 1, for the last one the flange's.
    R_zero = arm.T_base_flange_zero.rotation.as_matrix()
    turned = np.concatenate([nominal.R_base_link[:, 1:], (nominal.R_base_flange @ R_zero.T)[:, None]], axis=1)
    held = np.concatenate([nominal.origins_base[:, 1:], nominal.flange_base[:, None]], axis=1)
    known = np.vstack([arm.anchors_base[1:], arm.T_base_flange_zero.translation])
    centres_base = np.einsum("nkij,kj->nki", turned, arm.link_centres_base - known) + held
    masses = np.cumsum(arm.link_masses_kg[::-1])[::-1]
    moments = np.cumsum((arm.link_masses_kg[:, None] * centres_base)[:, ::-1], axis=1)[:, ::-1]
    levers = moments - masses[:, None] * nominal.origins_base
    return _GRAVITY_M_S2 * np.cross(nominal.axes_base, levers)[..., 2]


def _chain(
    arm: NominalArm,
    joints_rad: Float[np.ndarray, "n k"],
    errors: Float[np.ndarray, "e"],
    torques_nm: Float[np.ndarray, "n k"],
) -> Chain:
    slices = ArmSlices.of(arm.joints)
    offsets_m, twists_rad = errors[slices.offsets].reshape(-1, 3), errors[slices.twists].reshape(-1, 3)
    angles = joints_rad + errors[slices.zeros] - errors[slices.compliances] * torques_nm
    R_twists = Rotation.from_rotvec(twists_rad).as_matrix()
    crosses, count = cross_matrix(arm.axes_base), len(joints_rad)
    R, t = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
    links, origins, axes = [], [], []
    for k in range(arm.joints):
        links.append(R)
        origins.append(R @ (arm.anchors_base[k] + offsets_m[k]) + t)
        R = R @ R_twists[k]
        axes.append(R @ arm.axes_base[k])
        R = R @ _turns(crosses[k], angles[:, k])
        t = origins[-1] - R @ arm.anchors_base[k]
    zero = arm.T_base_flange_zero
    return Chain(
        R_base_flange=R @ zero.rotation.as_matrix(),
        flange_base=R @ zero.translation + t,
        R_base_link=np.stack(links, axis=1),
        origins_base=np.stack(origins, axis=1),
        axes_base=np.stack(axes, axis=1),
        torques_nm=torques_nm,
        twists_rad=twists_rad,
    )


def _turns(cross: Float[np.ndarray, "3 3"], angles: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3 3"]:
    """Rotation matrices about one axis, given as its cross product's matrix (Rodrigues)."""
    sin, cos = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + sin * cross + (1 - cos) * cross @ cross

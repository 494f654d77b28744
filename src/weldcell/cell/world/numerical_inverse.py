"""Inverse kinematics of any six-axis arm by Newton's method from many starts at once.

For arms without a closed form, such as those with an offset wrist. The starts are the closed solutions of a related arm
whose wrist axes are made to meet in one point (most of its branches lead to one of the arm's own, if the offset is
small against the reach), and evenly spread postures for what those miss. A general six-axis arm has up to 16 solutions
(Raghavan and Roth 1993); the share that is found is measured in the tests.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from eaik.IK_HP import HPRobot
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import qmc

_STEPS = 60
_EXACT = 1e-11  # metres and radians together: rounding leaves 1e-15 for each joint
_LONGEST_STEP_RAD = 0.4
_STARTS = 96
_SAME_RAD = 1e-6
_SHAKEN_RAD = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class NumericalInverse:
    """Finds the joint angles of a flange pose; angles are modulo a turn, limits do not matter here."""

    axes_base: Float[np.ndarray, "6 3"]
    """Joint axes at reading zero, unit."""
    anchors_base: Float[np.ndarray, "6 3"]
    """A point on each joint axis at reading zero, m."""
    T_base_flange_zero: RigidTransform
    """Flange at reading zero."""

    def all(self, T_base_flange: RigidTransform) -> Float[np.ndarray, "n 6"]:
        """The solutions that are found, each once, in -pi to pi."""
        related = self._related(T_base_flange)
        rng = np.random.default_rng(0)
        shaken = [related + rng.uniform(-_SHAKEN_RAD, _SHAKEN_RAD, related.shape) for _ in range(2)]
        return _distinct(self.near(T_base_flange, np.vstack([related, *shaken, self._spread])))

    def near(self, T_base_flange: RigidTransform, starts_rad: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "k 6"]:
        """The solutions that Newton's method reaches from these starts; those that reach none are left out."""
        target = T_base_flange.as_matrix()
        angles_rad = np.array(starts_rad, float)
        found: list[Float[np.ndarray, "k 6"]] = []
        for _ in range(_STEPS):
            error, jacobian = self._error(angles_rad, target)
            done = np.abs(error).max(axis=1) < _EXACT
            found.append(angles_rad[done])
            angles_rad, error, jacobian = angles_rad[~done], error[~done], jacobian[~done]
            if not len(angles_rad):
                break
            angles_rad = angles_rad + _newton_step(error, jacobian)
        return np.concatenate(found)

    def jacobian(self, angles_rad: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 6 6"]:
        """Flange's velocity (m/s in the base, then rad/s) for each joint's rate, a column a joint."""
        return self._error(np.asarray(angles_rad, float), self.T_base_flange_zero.as_matrix())[1]

    def _error(
        self, angles_rad: Float[np.ndarray, "n 6"], target: Float[np.ndarray, "4 4"]
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"]]:
        """What is left to go (m, then a rotation vector in the base) and the Jacobian, by a product of exponentials."""
        turn = np.broadcast_to(np.eye(3), (len(angles_rad), 3, 3))
        shift = np.zeros((len(angles_rad), 3))
        axes, places = [], []
        for k in range(6):
            axis, anchor = turn @ self.axes_base[k], turn @ self.anchors_base[k] + shift
            axes.append(axis)
            places.append(anchor)
            turn = turn @ self._rotations(k, angles_rad[:, k])
            shift = anchor - turn @ self.anchors_base[k]
        zero = self.T_base_flange_zero.as_matrix()
        tip = turn @ zero[:3, 3] + shift
        left = Rotation.from_matrix(target[:3, :3] @ np.swapaxes(turn @ zero[:3, :3], 1, 2)).as_rotvec()
        columns = [
            np.concatenate([np.cross(axis, tip - place), axis], axis=1)
            for axis, place in zip(axes, places, strict=True)
        ]
        return np.concatenate([target[:3, 3] - tip, left], axis=1), np.stack(columns, axis=2)

    def _rotations(self, joint: int, angles_rad: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3 3"]:
        """Rodrigues' formula."""
        x, y, z = self.axes_base[joint]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        sine, cosine = np.sin(angles_rad)[:, None, None], np.cos(angles_rad)[:, None, None]
        return np.eye(3) + sine * cross + (1 - cosine) * (cross @ cross)

    def _related(self, T_base_flange: RigidTransform) -> Float[np.ndarray, "n 6"]:
        """Closed solutions of the related arm, least squares among them; none if it has no closed form either."""
        if not self._related_arm.hasKnownDecomposition():
            return np.empty((0, 6))
        target = T_base_flange.as_matrix()
        target[:3, :3] = target[:3, :3] @ self.T_base_flange_zero.rotation.inv().as_matrix()
        solutions = self._related_arm.IK(target)
        return np.array(solutions.Q).reshape(-1, 6) if solutions.num_solutions() else np.empty((0, 6))

    @cached_property
    def _related_arm(self) -> HPRobot:
        """The arm with its last three axes through the point nearest to all of them."""
        across = np.eye(3) - self.axes_base[3:, :, None] * self.axes_base[3:, None, :]
        centre = np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, self.anchors_base[3:]), rcond=None)[
            0
        ]
        anchors = np.vstack([self.anchors_base[:3], np.tile(centre, (3, 1))])
        return closed_form(self.axes_base, anchors, self.T_base_flange_zero)

    @cached_property
    def _spread(self) -> Float[np.ndarray, "n 6"]:
        return np.pi * (2 * qmc.Halton(6, rng=np.random.default_rng(0)).random(_STARTS) - 1)


def closed_form(
    axes_base: Float[np.ndarray, "6 3"], anchors_base: Float[np.ndarray, "6 3"], T_base_flange_zero: RigidTransform
) -> HPRobot:
    """EAIK's solver of an arm; ask it whether it has a decomposition."""
    offsets = np.diff(np.vstack([np.zeros(3), anchors_base, T_base_flange_zero.translation]), axis=0)
    return HPRobot(axes_base, offsets)


def _newton_step(error: Float[np.ndarray, "n 6"], jacobian: Float[np.ndarray, "n 6 6"]) -> Float[np.ndarray, "n 6"]:
    """Damped least squares (Nakamura and Hanafusa 1986): the damping vanishes with the error; steps are bounded."""
    damping = np.minimum(1e-2, np.einsum("ni,ni->n", error, error))
    square = jacobian @ np.swapaxes(jacobian, 1, 2) + (damping[:, None, None] + 1e-14) * np.eye(6)
    step = np.einsum("nij,ni->nj", jacobian, np.linalg.solve(square, error[..., None])[..., 0])
    longest = np.abs(step).max(axis=1, keepdims=True)
    return step * np.minimum(1, _LONGEST_STEP_RAD / np.maximum(longest, 1e-300))


def _distinct(angles_rad: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "k 6"]:
    """Each set of angles once, in -pi to pi."""
    wrapped = np.angle(np.exp(1j * angles_rad))
    kept: list[Float[np.ndarray, "6"]] = []
    for angles in wrapped:
        same: Bool[np.ndarray, "k"] = np.array([_turned(angles - other) < _SAME_RAD for other in kept], bool)
        if not same.any():
            kept.append(angles)
    return np.array(kept).reshape(-1, 6)


def _turned(difference_rad: Float[np.ndarray, "6"]) -> float:
    return float(np.abs(np.angle(np.exp(1j * difference_rad))).max())

"""The residuals of the joint estimate, with their derivatives and their noise.

Unknowns stand in one row: camera (6, the perturbation of `sight_model`), tip (3), targets (3 g), arm (8 k,
see `arm_model`), sensor (6, see `sensor_errors`).
    sight:    h(T_cf T_fb M) - observed - by_sensor s        (h: the identity, or a sphere's section)
    touch:    |T_bf t - M| - (R_sphere + r_tip)
    distance: |M_i - M_j| - D
The robot's noise for each pose: all its joints miss a little at every approach, so that a sight errs by
what the miss moves at the target, and a touch by what it moves along the line of contact. However many
points a profile has, this part of the error does not average out.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from weldcell.calib.arm_model import ArmSlices, chain, gravity_torques_nm
from weldcell.calib.joint_problem import MAIN_JOINTS, SENSOR_SIZE, WRIST_RATIO, JointProblem, Sizes
from weldcell.calib.sensor_errors import SENSOR_SIGMA
from weldcell.calib.sight_model import cross_matrix

MOUNT, TIP = slice(0, 6), slice(6, 9)
_ANYWHERE = 3.0  # rad and m: camera and targets are in the room; keeps directions finite that the data leave open


@dataclass(frozen=True, kw_only=True, eq=False)
class JointState:
    """A guess of all unknowns."""

    R_flange_camera: Float[np.ndarray, "3 3"]
    camera_flange: Float[np.ndarray, "3"]
    tip_flange: Float[np.ndarray, "3"]
    targets_base: Float[np.ndarray, "g 3"]
    errors: Float[np.ndarray, "e"]
    sensor: Float[np.ndarray, "6"]

    def moved(self, step: Float[np.ndarray, "p"], columns: "Columns") -> "JointState":
        """The guess after a step in the row of unknowns."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        return JointState(
            R_flange_camera=self.R_flange_camera @ turn,
            camera_flange=self.camera_flange + step[3:6],
            tip_flange=self.tip_flange + step[TIP],
            targets_base=self.targets_base + step[columns.targets].reshape(-1, 3),
            errors=self.errors + step[columns.arm],
            sensor=self.sensor + step[columns.sensor],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """Where unknowns stand in their row, and which of them are free."""

    targets: slice
    arm: slice
    sensor: slice
    free: Bool[np.ndarray, "p"]
    """The others keep their nominal value."""

    @staticmethod
    def of(problem: JointProblem) -> "Columns":
        """For the targets, the arm and the switches of a problem."""
        arm = ArmSlices.of(problem.arm.joints)
        first = TIP.stop + 3 * problem.targets
        size = first + arm.size + SENSOR_SIZE
        free = np.zeros(size, dtype=bool)
        free[: TIP.start] = free[TIP.stop : first] = True
        free[TIP] = "tip" in problem.estimate and problem.touches is not None
        for name in ("offsets", "twists", "zeros", "compliances"):
            places: slice = getattr(arm, name)
            free[first + places.start : first + places.stop] = name in problem.estimate
        free[first + arm.size :] = "sensor" in problem.estimate and problem.sights.by_sensor is not None
        return Columns(
            targets=slice(TIP.stop, first),
            arm=slice(first, first + arm.size),
            sensor=slice(first + arm.size, size),
            free=free,
        )

    def prior_sigma(self, problem: JointProblem, sizes: Sizes) -> Float[np.ndarray, "p"]:
        """How far each unknown may be from its nominal value, or from where the search began, one sigma."""
        joints = problem.arm.joints
        wrist = np.where(np.arange(joints) < MAIN_JOINTS, 1.0, WRIST_RATIO)
        sigma = np.full(len(self.free), _ANYWHERE)
        sigma[TIP] = problem.tip_sigma_m
        sigma[self.arm] = np.concatenate(
            [
                np.full(3 * joints, sizes.offset_m),
                np.full(3 * joints, sizes.twist_rad),
                np.full(joints, sizes.zero_rad),
                sizes.compliance_rad_per_nm * wrist,
            ]
        )
        sigma[self.sensor] = sizes.sensor_ratio * SENSOR_SIGMA
        return sigma


@dataclass(frozen=True, kw_only=True, eq=False)
class Observations:
    """Residuals of one kind at one guess: n observations of c components."""

    residuals: Float[np.ndarray, "n c"]
    """Predicted less observed (m)."""
    jacobian: Float[np.ndarray, "n c p"]
    covariances: Float[np.ndarray, "n c c"]
    """Noise that is known beforehand (m^2)."""
    by_readings: Float[np.ndarray, "n c k"]
    """What a miss of the joints does."""
    sighted: bool
    """Whether the sensor's unknown noise comes on top."""

    def only(self, kept: Bool[np.ndarray, "n"]) -> "Observations":
        """Those of them."""
        return replace(
            self,
            residuals=self.residuals[kept],
            jacobian=self.jacobian[kept],
            covariances=self.covariances[kept],
            by_readings=self.by_readings[kept],
        )

    def noise(self, sizes: Sizes) -> Float[np.ndarray, "n c c"]:
        """Covariance of each observation (m^2)."""
        noise = self.covariances + sizes.joint_noise_rad**2 * self.by_readings @ self.by_readings.swapaxes(1, 2)
        return noise + sizes.sight_noise_m**2 * np.eye(noise.shape[1]) if self.sighted else noise


class JointModel:
    """What turns a guess into observations; evaluates once what no guess changes."""

    columns: Columns
    start: JointState
    """The first hand-eye solution, a nominal arm, and targets where most sights see them."""

    def __init__(self, problem: JointProblem) -> None:
        self._problem = problem
        self.columns = Columns.of(problem)
        self.start = _start(problem)
        self._sight_torques = gravity_torques_nm(problem.arm, problem.sights.joints_rad)
        if problem.touches is not None:
            self._touch_torques = gravity_torques_nm(problem.arm, problem.touches.joints_rad)

    def observations(self, state: JointState) -> list[Observations]:
        """Sights, then touches and distances where there are any."""
        found = [self._sights(state)]
        if self._problem.touches is not None:
            found.append(self._touches(state))
        if self._problem.distances:
            found.append(self._distances(state))
        return found

    def believed(self, state: JointState) -> Float[np.ndarray, "p"]:
        """How far the guess is from what is believed beforehand."""
        offset = np.zeros(len(self.columns.free))
        turn = self.start.R_flange_camera.T @ state.R_flange_camera
        offset[0:3] = Rotation.from_matrix(turn).as_rotvec()
        offset[3:6] = state.camera_flange - self.start.camera_flange
        offset[self.columns.targets] = (state.targets_base - self.start.targets_base).ravel()
        offset[TIP] = state.tip_flange - self._problem.tip_flange
        offset[self.columns.arm] = state.errors
        offset[self.columns.sensor] = state.sensor
        return offset

    def _sights(self, state: JointState) -> Observations:
        sights, columns = self._problem.sights, self.columns
        arm = chain(self._problem.arm, sights.joints_rad, state.errors, self._sight_torques)
        targets_base = state.targets_base[sights.targets]
        R_camera_base = (arm.R_base_flange @ state.R_flange_camera).swapaxes(1, 2)
        targets_flange = np.einsum("nji,nj->ni", arm.R_base_flange, targets_base - arm.flange_base)
        targets_camera = (targets_flange - state.camera_flange) @ state.R_flange_camera
        predicted, by_camera = sights.predicted(targets_camera)
        by_base = by_camera @ R_camera_base
        count = len(predicted)
        jacobian = np.zeros((count, 3, len(columns.free)))
        jacobian[..., 0:3] = by_camera @ cross_matrix(targets_camera)
        jacobian[..., 3:6] = -by_camera @ state.R_flange_camera.T
        by_targets = np.zeros((count, 3, len(state.targets_base), 3))
        by_targets[np.arange(count), :, sights.targets] = by_base
        jacobian[..., columns.targets] = by_targets.reshape(count, 3, -1)
        # an arm that carries the camera somewhere else sees the target moved the other way
        jacobian[..., columns.arm] = -by_base @ arm.by_errors(targets_base)
        residuals = predicted - sights.observed
        if sights.by_sensor is not None:
            residuals = residuals - sights.by_sensor @ state.sensor
            jacobian[..., columns.sensor] = -sights.by_sensor
        return Observations(
            residuals=residuals,
            jacobian=jacobian,
            covariances=sights.covariances,
            by_readings=by_base @ arm.by_readings(targets_base),
            sighted=True,
        )

    def _touches(self, state: JointState) -> Observations:
        touches, columns = self._problem.touches, self.columns
        assert touches is not None
        count = len(touches.joints_rad)
        arm = chain(self._problem.arm, touches.joints_rad, state.errors, self._touch_torques)
        tips_base = arm.points_base(np.broadcast_to(state.tip_flange, (count, 3)))
        offsets = tips_base - state.targets_base[touches.targets]
        distances_m = np.linalg.norm(offsets, axis=1)
        outward = (offsets / np.maximum(distances_m, 1e-12)[:, None])[:, None]
        jacobian = np.zeros((count, 1, len(columns.free)))
        jacobian[..., TIP] = outward @ arm.R_base_flange
        by_targets = np.zeros((count, 1, len(state.targets_base), 3))
        by_targets[np.arange(count), :, touches.targets] = -outward
        jacobian[..., columns.targets] = by_targets.reshape(count, 1, -1)
        jacobian[..., columns.arm] = outward @ arm.by_errors(tips_base)
        return Observations(
            residuals=(distances_m - touches.sums_m)[:, None],
            jacobian=jacobian,
            covariances=np.full((count, 1, 1), touches.sigma_m**2),
            by_readings=outward @ arm.by_readings(tips_base),
            sighted=False,
        )

    def _distances(self, state: JointState) -> Observations:
        known, columns = self._problem.distances, self.columns
        rows = np.arange(len(known))
        first, second = np.array([each.first for each in known]), np.array([each.second for each in known])
        offsets = state.targets_base[first] - state.targets_base[second]
        distances_m = np.linalg.norm(offsets, axis=1)
        outward = offsets / np.maximum(distances_m, 1e-12)[:, None]
        by_targets = np.zeros((len(known), 1, len(state.targets_base), 3))
        by_targets[rows, 0, first] += outward
        by_targets[rows, 0, second] -= outward
        jacobian = np.zeros((len(known), 1, len(columns.free)))
        jacobian[..., columns.targets] = by_targets.reshape(len(known), 1, -1)
        return Observations(
            residuals=(distances_m - np.array([each.distance_m for each in known]))[:, None],
            jacobian=jacobian,
            covariances=np.array([each.sigma_m**2 for each in known])[:, None, None],
            by_readings=np.zeros((len(known), 1, self._problem.arm.joints)),
            sighted=False,
        )


def _start(problem: JointProblem) -> JointState:
    sights = problem.sights
    size = ArmSlices.of(problem.arm.joints).size
    nominal = chain(problem.arm, sights.joints_rad, np.zeros(size))
    seen_base = nominal.points_base(problem.T_flange_camera.apply(sights.lifted()))
    targets = [np.median(seen_base[sights.targets == target], axis=0) for target in range(problem.targets)]
    return JointState(
        R_flange_camera=problem.T_flange_camera.rotation.as_matrix(),
        camera_flange=problem.T_flange_camera.translation,
        tip_flange=np.array(problem.tip_flange, dtype=float),
        targets_base=np.array(targets),
        errors=np.zeros(size),
        sensor=np.zeros(SENSOR_SIZE),
    )

"""One estimate of everything: camera, targets, torch tip, the arm's own errors and the sensor's.

P2's compensation aligns the sensor with the torch through the robot as it is, which is right near the
sphere only. Here the robot's errors are estimated with the rest, from the same sights and touches: links
that are shifted (3 each) and turned (3 each), joint zeros, compliance under gravity. They are many more than
the data determine, and that is no harm: each has a belief about its size (a prior), the sizes are found from
the data (`evidence`), and what torch and sensor do together depends on the determined directions alone.

The estimate is of use only together with its arm: a point is measured through `arm.flanges(readings)`,
and the torch is sent there with `arm.readings(...)`.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.arm_model import chain
from weldcell.calib.calibrated_arm import CalibratedArm
from weldcell.calib.evidence import adapted_sizes
from weldcell.calib.joint_fit import Weights, Whitened, fit, gate_weights, whitened, whitening
from weldcell.calib.joint_problem import JointProblem, Sizes
from weldcell.calib.joint_rows import MOUNT, TIP, Columns, JointModel, JointState, Observations
from weldcell.calib.sight_model import TARGET, cross_matrix, jacobian_of, lever_m, sight_blocks
from weldcell.calib.verdict import (
    REFUSED_CONDITION,
    Block,
    Finding,
    Judged,
    Observability,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
    weigh_residual,
    weigh_spare,
)
from weldcell.cell.frames import rigid_from

DOUBTFUL_RMS_M = 1e-3  # with the robot's errors estimated, what remains is noise
REFUSED_RMS_M = 10e-3
_ROUNDS = 2  # of sizes and estimate: the second changes both by per cents
_MOST_LEFT_OUT = 0.5  # of the observations: beyond it no one knows which are the sound ones
_INFLATE_SIGMAS = 3.0  # the residuals' sum of squares is larger than promised only beyond this


@dataclass(frozen=True, kw_only=True, eq=False)
class JointResult(Judged):
    """Everything that was estimated.

    The condition number is that of camera, tip and targets, scaled, with the other unknowns integrated out.
    """

    T_flange_camera: RigidTransform
    tip_flange: Float[np.ndarray, "3"]
    """The torch tip (m); the nominal one where it is not estimated."""
    targets_base: Float[np.ndarray, "g 3"]
    """The targets (m)."""
    arm: CalibratedArm
    """The arm with its errors."""
    sensor: Float[np.ndarray, "6"]
    """Errors of camera and light plane (see `sensor_errors`)."""
    sizes: Sizes
    """How large errors and noise were found to be."""
    covariance_all: Float[np.ndarray, "p p"]
    """Of all unknowns in the order of `joint_rows`; zero for what is not estimated."""
    columns: Columns
    """Where they stand."""
    sight_residual_m: Float[np.ndarray, "n"]
    """How far each sight is off, in what the sensor measures (place, or section of the sphere)."""
    touch_residual_m: Float[np.ndarray, "m"]
    """Distance of tip and centre less the radius sum, for each touch."""
    sight_outliers: Bool[np.ndarray, "n"]
    touch_outliers: Bool[np.ndarray, "m"]
    """Observations that were left out."""
    rms_m: float
    """Root mean square of the kept sights' residuals."""
    leave_one_out_rms_m: float
    """The same, each sight compared with what the estimate without it predicts."""
    converged: bool

    @property
    def covariance(self) -> Float[np.ndarray, "6 6"]:
        """Of the camera: rotation vector (rad, camera axes), then translation (m, flange axes).

        It contains what the arm's last link may be off (its prior): for what the torch will miss by see
        `miss_covariances`.
        """
        return self.covariance_all[MOUNT, MOUNT]

    @property
    def tip_covariance(self) -> Float[np.ndarray, "3 3"]:
        """Of the tip (m^2, flange axes)."""
        return self.covariance_all[TIP, TIP]

    def miss_covariances(
        self,
        view_rad: Float[np.ndarray, "n k"],
        points_camera: Float[np.ndarray, "n 3"],
        send_rad: Float[np.ndarray, "n k"],
        by_sensor: Float[np.ndarray, "n 3 6"] | None = None,
    ) -> Float[np.ndarray, "n 3 3"]:
        """Covariance (m^2, base) of tip less point when the torch is sent with readings to points seen with others.

        Of the calibration alone: noise of the sensor and of both approaches comes on top. Where the sensor's errors
        were estimated, `by_sensor` says how the points move with them (`sensor_errors.points_by_sensor`).
        """
        R_flange_camera = self.T_flange_camera.rotation.as_matrix()
        view, send = (chain(self.arm.nominal, joints, self.arm.errors) for joints in (view_rad, send_rad))
        seen_base = view.points_base(self.T_flange_camera.apply(points_camera))
        tips_base = send.points_base(np.broadcast_to(self.tip_flange, points_camera.shape))
        by_all = np.zeros((len(view_rad), 3, len(self.covariance_all)))
        by_all[..., 0:3] = view.R_base_flange @ R_flange_camera @ cross_matrix(points_camera)
        by_all[..., 3:6] = -view.R_base_flange
        by_all[..., TIP] = send.R_base_flange
        by_all[..., self.columns.arm] = send.by_errors(tips_base) - view.by_errors(seen_base)
        if by_sensor is not None:
            by_all[..., self.columns.sensor] = -view.R_base_flange @ R_flange_camera @ by_sensor
        return by_all @ self.covariance_all @ by_all.swapaxes(1, 2)


def solve(problem: JointProblem) -> JointResult:
    """The most likely unknowns for sizes that are found with them; what does not fit is left out."""
    model = JointModel(problem)
    state, sizes = model.start, problem.sizes
    if problem.robust:
        state, _ = fit(problem, model, state, sizes, None)
    weights = _kept(problem, model, state, sizes)
    seen = _observed(problem, model.columns, state, weights)
    adapt = problem.adapt and seen.condition_number <= REFUSED_CONDITION
    for _ in range(_ROUNDS):
        state, _ = fit(problem, model, state, sizes, weights)
        if adapt:
            sizes = adapted_sizes(problem, model, state, sizes, weights)
        weights = _kept(problem, model, state, sizes)
    state, converged = fit(problem, model, state, sizes, weights)
    return _judged(problem, model, state, sizes, weights, converged)


def _kept(problem: JointProblem, model: JointModel, state: JointState, sizes: Sizes) -> Weights:
    """1 for the observations that count, 0 for the others."""
    seen = model.observations(state)
    return gate_weights(seen, sizes) if problem.robust else [np.ones(len(each.residuals)) for each in seen]


def _judged(
    problem: JointProblem, model: JointModel, state: JointState, sizes: Sizes, weights: Weights, converged: bool
) -> JointResult:
    seen, columns = model.observations(state), model.columns
    prior_sigma = columns.prior_sigma(problem, sizes)
    rows = whitened(model, state, seen, whitening(seen, sizes), prior_sigma, weights)
    sight_residual_m = np.linalg.norm(seen[0].residuals, axis=1)
    touch_residual_m, touch_weights = np.empty(0), np.empty(0)
    if problem.touches is not None:
        touch_residual_m, touch_weights = seen[1].residuals[:, 0], weights[1]
    kept = weights[0] > 0
    rms_m = float(np.sqrt(np.mean(sight_residual_m[kept] ** 2))) if kept.any() else np.inf
    observability = _observed(problem, columns, state, weights)
    covariance = np.full((len(columns.free), len(columns.free)), np.inf)
    if observability.condition_number <= REFUSED_CONDITION:
        covariance = _inflation(rows, weights, seen) * _covariance(rows, columns)
    findings = weigh_condition(observability, "joint estimate")
    findings += weigh_convergence(converged, "the estimate still moves")
    findings += weigh_residual(rms_m, "joint estimate", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_spare(_count(weights, seen), 6 + 3 * problem.targets)
    findings += _weigh_left_out(~kept, "sight", sight_residual_m)
    findings += _weigh_left_out(touch_weights == 0, "touch", np.abs(touch_residual_m))
    verdict, reasons = judge(findings)
    return JointResult(
        T_flange_camera=rigid_from(Rotation.from_matrix(state.R_flange_camera), state.camera_flange),
        tip_flange=state.tip_flange,
        targets_base=state.targets_base,
        arm=CalibratedArm(nominal=problem.arm, errors=state.errors),
        sensor=state.sensor,
        sizes=sizes,
        covariance_all=covariance,
        columns=columns,
        sight_residual_m=sight_residual_m,
        touch_residual_m=touch_residual_m,
        sight_outliers=~kept,
        touch_outliers=touch_weights == 0,
        rms_m=rms_m,
        leave_one_out_rms_m=_leave_one_out_rms_m(seen[0].only(kept), sizes, covariance),
        condition_number=observability.condition_number,
        observability=observability.weak_directions,
        converged=converged,
        verdict=verdict,
        reasons=reasons,
    )


def _observed(problem: JointProblem, columns: Columns, state: JointState, weights: Weights) -> Observability:
    """What the data tell of camera, tip and targets, the arm being as it is.

    Only these are judged: of the arm and the sensor something is believed, so that no direction of theirs is open.
    Sights count as places, as in the other calibrations; how well a section shows them is the covariance's matter.
    """
    sights, judged = problem.sights, columns.free & (np.arange(len(columns.free)) < columns.targets.stop)
    R_base_flange = chain(problem.arm, sights.joints_rad, state.errors).R_base_flange
    by_all = jacobian_of(R_base_flange, state.R_flange_camera, sights.lifted())
    by_sights = np.zeros((len(by_all), 3, len(columns.free)))
    by_sights[..., MOUNT] = by_all[..., :6]
    by_targets = np.zeros((len(by_all), 3, problem.targets, 3))
    by_targets[np.arange(len(by_all)), :, sights.targets] = by_all[..., TARGET]
    by_sights[..., columns.targets] = by_targets.reshape(len(by_all), 3, -1)
    others = [each.jacobian for each in JointModel(problem).observations(state)[1:]]
    rows = [
        each[weight > 0].reshape(-1, len(judged)) for each, weight in zip([by_sights, *others], weights, strict=True)
    ]
    return observe(np.concatenate(rows)[:, judged], _blocks(problem, columns))


def _blocks(problem: JointProblem, columns: Columns) -> list[Block]:
    """Names of camera, tip and targets; a rotation counts by what it moves at the mean sight distance."""
    rotation, translation, _ = sight_blocks(lever_m(problem.sights.lifted()))
    tip = [Block(name="the tip along", frame="flange")] if columns.free[TIP].all() else []
    names = ["target along"] if problem.targets == 1 else [f"target {k} along" for k in range(problem.targets)]
    return [rotation, translation, *tip, *(Block(name=name, frame="base") for name in names)]


def _covariance(rows: Whitened, columns: Columns) -> Float[np.ndarray, "p p"]:
    """Of all unknowns; no direction is open, for something is believed about each."""
    scale = np.maximum(np.linalg.norm(rows.jacobian, axis=0), 1e-300)
    _, values, directions = np.linalg.svd(rows.jacobian / scale, full_matrices=False)
    halves = directions / values[:, None] / scale
    covariance = np.zeros((len(columns.free), len(columns.free)))
    covariance[np.ix_(columns.free, columns.free)] = halves.T @ halves
    return covariance


def _inflation(rows: Whitened, weights: Weights, seen: list[Observations]) -> float:
    """Variance of the residuals over the promised one, where it is more than chance; else 1."""
    believed = len(rows.residuals) - sum(each.residuals.size for each in seen)
    freedom = _count(weights, seen) + believed - rows.jacobian.shape[1]
    if freedom <= 0 or rows.cost < freedom + _INFLATE_SIGMAS * np.sqrt(2 * freedom):
        return 1.0
    return rows.cost / freedom


def _count(weights: Weights, seen: list[Observations]) -> int:
    """How many equations were kept."""
    return sum(int(weight.sum()) * each.residuals.shape[1] for weight, each in zip(weights, seen, strict=True))


def _leave_one_out_rms_m(sights: Observations, sizes: Sizes, covariance: Float[np.ndarray, "p p"]) -> float:
    """Of residuals against the estimate without the sight itself: N (N - J C J')^-1 e, exact for a linear model."""
    if not len(sights.residuals) or not np.isfinite(covariance).all():
        return np.inf
    noise = sights.noise(sizes)
    explained = sights.jacobian @ covariance @ sights.jacobian.swapaxes(1, 2)
    alone = noise @ np.linalg.solve(noise - explained, sights.residuals[..., None])
    return float(np.sqrt(np.mean(np.sum(alone[..., 0] ** 2, axis=1))))


def _weigh_left_out(
    outliers: Bool[np.ndarray, "n"], what: Literal["sight", "touch"], residual_m: Float[np.ndarray, "n"]
) -> list[Finding]:
    """A doubt for each observation that was left out, and a refusal where they are too many."""
    findings = [
        Finding(
            verdict="doubtful",
            reason=f"{what} {index} (counted from 0) misses by {residual_m[index] * 1e3:.3g} mm and was left out",
        )
        for index in np.flatnonzero(outliers)
    ]
    if len(outliers) and np.mean(outliers) > _MOST_LEFT_OUT:
        reason = f"{outliers.sum()} of {len(outliers)} observations ({what}) do not fit with the others"
        findings.append(Finding(verdict="refused", reason=reason))
    return findings

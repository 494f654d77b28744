"""How much later (or earlier) a picture was taken than its stamp says, on the controller's clock.

The robot moves while the sensor watches a fixed target. A picture stamped s was taken at s + dt of the controller's
clock, where the flange was at T_bf(s + dt), interpolated between the reported poses by cubic splines. With the right dt
all pictures put the target in one place: T_bf(s + dt) T_fc M_c = M_b. At 10 mm/s, 10 ms move the target by 0.1 mm.

dt and the target are estimated together, and the mount as well if asked to. At constant velocity dt cannot be told
from a shift of the target: the robot must go to and fro, or turn.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform, RotationSpline

from weldcell.calib.least_squares import Fit, Model, fit
from weldcell.calib.sight_model import jacobian_of, lever_m, perturbed, right_jacobian, sight_blocks
from weldcell.calib.verdict import (
    Block,
    Finding,
    Judged,
    Observability,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
    weigh_outliers,
    weigh_residual,
    weigh_spare,
)
from weldcell.cell.errors import BadInput

DOUBTFUL_RMS_M = 1e-3
REFUSED_RMS_M = 10e-3
_SPEED_M_S = 0.05  # a second counts by what it moves at this speed
_LEAST_TRAVEL_M = 2e-3  # rms: below, noise of the reported poses passes for motion
_FEWEST_POSES, _FEWEST_PICTURES = 4, 5
_GRID = 61  # offsets tried for the start
_STEP_S = 1e-5  # for the derivative by time
_ROUNDS = 3  # each starts its perturbation anew from zero
_TIME, _PLACE = 0, slice(1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeOffsetProblem:
    """A recording of a moving robot, and what its sensor saw of a fixed target."""

    pose_times_s: Float[np.ndarray, "n"]
    """When each pose was reported, on the controller's clock; rising."""
    T_base_flange: RigidTransform
    """Flange in the base at these times (n transforms)."""
    picture_times_s: Float[np.ndarray, "k"]
    """The pictures' stamps."""
    centres_camera: Float[np.ndarray, "k 3"]
    """The target in the camera for each picture (m)."""
    T_flange_camera: RigidTransform
    """The mount; the start if it is estimated."""
    estimate_mount: bool = False
    """Estimate the mount as well; it then needs turns about two axes, as hand-eye does."""
    sigma_m: float = 1e-4
    """Standard deviation of a sight in the base, each axis: sensor and robot."""
    largest_offset_s: float = 0.3
    """Offsets up to this are looked for. The poses must begin that much before the pictures and end that much after;
    other pictures are left out."""

    def __post_init__(self) -> None:
        times = self.pose_times_s
        if self.T_base_flange.single or np.shape(times) != (len(self.T_base_flange),) or len(times) < _FEWEST_POSES:
            raise BadInput(f"time offset: expected a time for each pose, {_FEWEST_POSES} or more")
        if not (np.all(np.isfinite(times)) and np.all(np.diff(times) > 0)):
            raise BadInput("time offset: expected rising pose times, found repeated, falling or NaN ones")
        if np.shape(self.centres_camera) != (len(self.picture_times_s), 3):
            raise BadInput(
                f"time offset: {len(self.picture_times_s)} pictures, centres {np.shape(self.centres_camera)}"
            )
        if not (np.all(np.isfinite(self.picture_times_s)) and np.all(np.isfinite(self.centres_camera))):
            raise BadInput("time offset: expected finite picture times and centres, found NaN or infinity")
        if not (0 < self.sigma_m < np.inf and 0 < self.largest_offset_s < np.inf):
            raise BadInput("time offset: expected sigma_m and largest_offset_s above 0")
        if np.sum(self.covered) < _FEWEST_PICTURES:
            raise BadInput(
                f"time offset: {np.sum(self.covered)} stamps lie {self.largest_offset_s:g} s or more inside the poses' "
                f"times ({times[0]:.6g} to {times[-1]:.6g} s), expected at least {_FEWEST_PICTURES}"
            )

    @property
    def covered(self) -> Bool[np.ndarray, "k"]:
        """The pictures whose time lies within the poses' whatever the offset is."""
        slack_s = self.largest_offset_s + _STEP_S
        inside = (self.picture_times_s >= self.pose_times_s[0] + slack_s) & (
            self.picture_times_s <= self.pose_times_s[-1] - slack_s
        )
        return np.asarray(inside)


@dataclass(frozen=True, kw_only=True, eq=False)
class TimeOffsetResult(Judged):
    """The offset.

    In the condition number a second counts by what it moves at 50 mm/s.
    """

    offset_s: float
    """Add it to a picture's stamp to get the controller's time."""
    sigma_s: float
    """Its standard deviation; infinite if it is open."""
    T_flange_camera: RigidTransform
    target_base: Float[np.ndarray, "3"]
    """The fixed target (m)."""
    covariance: Float[np.ndarray, "p p"]
    """Offset (s), target (m, base axes), then the mount as in `sight_model` if it was estimated."""
    residuals_base: Float[np.ndarray, "m 3"]
    """Where each picture that counts puts the target, less `target_base` (m)."""
    rms_m: float
    """Root mean square length of the residuals."""
    converged: bool


def solve(problem: TimeOffsetProblem) -> TimeOffsetResult:
    """The offset near the best of a grid, by Levenberg-Marquardt."""
    scene = _Scene(problem)
    offset_s, T_flange_camera = scene.best_of_grid(), problem.T_flange_camera
    for _ in range(_ROUNDS if problem.estimate_mount else 1):
        target = scene.places(offset_s, T_flange_camera).mean(axis=0)
        start = np.concatenate([[offset_s], target, np.zeros(6 if problem.estimate_mount else 0)])
        found = fit(scene.model(T_flange_camera), start)
        offset_s = float(np.clip(found.parameters[_TIME], -problem.largest_offset_s, problem.largest_offset_s))
        if problem.estimate_mount:
            T_flange_camera = perturbed(T_flange_camera, found.parameters[4:])
    return _judged(problem, scene, T_flange_camera, found)


def _judged(
    problem: TimeOffsetProblem, scene: "_Scene", T_flange_camera: RigidTransform, found: Fit
) -> TimeOffsetResult:
    offset_s, target_base = float(found.parameters[_TIME]), found.parameters[_PLACE]
    residuals = found.residuals * problem.sigma_m
    residual_m = np.linalg.norm(residuals, axis=1)
    rms_m = float(np.sqrt(np.mean(residual_m**2)))
    seen = _observe(problem, found)
    covariance = found.covariance if seen.rank == len(found.parameters) else np.full_like(found.covariance, np.inf)
    findings = weigh_condition(seen, "time offset") + weigh_convergence(found.converged, found.message)
    findings += weigh_residual(rms_m, "time offset", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_outliers(residual_m, "picture") + weigh_spare(residuals.size, len(found.parameters))
    findings += _weigh_motion(problem, scene.travel_m(), offset_s)
    verdict, reasons = judge(findings)
    return TimeOffsetResult(
        offset_s=offset_s,
        sigma_s=float(np.sqrt(covariance[_TIME, _TIME])),
        T_flange_camera=T_flange_camera,
        target_base=target_base,
        covariance=covariance,
        residuals_base=residuals,
        rms_m=rms_m,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        converged=found.converged,
        verdict=verdict,
        reasons=reasons,
    )


def _weigh_motion(problem: TimeOffsetProblem, travel_m: float, offset_s: float) -> list[Finding]:
    findings = []
    if travel_m < _LEAST_TRAVEL_M:
        reason = (
            f"time offset: the robot moves the sensor by {travel_m * 1e3:.2g} mm rms while it looks, expected at least "
            f"{_LEAST_TRAVEL_M * 1e3:g} mm: it stood still"
        )
        findings.append(Finding(verdict="refused", reason=reason))
    if abs(offset_s) >= 0.99 * problem.largest_offset_s:
        reason = f"time offset: {offset_s:.3g} s is at the end of the range searched, {problem.largest_offset_s:g} s"
        findings.append(Finding(verdict="refused", reason=reason))
    return findings


def _observe(problem: TimeOffsetProblem, found: Fit) -> Observability:
    blocks = [
        Block(name="time offset by", frame="clock", unit_m=_SPEED_M_S, size=1),
        Block(name="the target along", frame="base"),
    ]
    if problem.estimate_mount:
        blocks += sight_blocks(lever_m(problem.centres_camera))[:2]
    return observe(found.jacobian.reshape(-1, found.jacobian.shape[-1]) * problem.sigma_m, blocks)


class _Scene:
    """The motion as a function of time, and the pictures that it covers."""

    def __init__(self, problem: TimeOffsetProblem) -> None:
        self._problem = problem
        self._stamps_s = problem.picture_times_s[problem.covered]
        self._centres = problem.centres_camera[problem.covered]
        self._place = CubicSpline(problem.pose_times_s, problem.T_base_flange.translation)
        self._turn = RotationSpline(problem.pose_times_s, problem.T_base_flange.rotation)

    def best_of_grid(self) -> float:
        """The offset on a grid for which the pictures agree best."""
        largest_s = self._problem.largest_offset_s
        grid = np.linspace(-largest_s, largest_s, _GRID)
        spreads = [np.var(self.places(offset_s, self._problem.T_flange_camera), axis=0).sum() for offset_s in grid]
        return float(grid[int(np.argmin(spreads))])

    def places(self, offset_s: float, T_flange_camera: RigidTransform) -> Float[np.ndarray, "m 3"]:
        """Where each picture puts the target (m, base)."""
        return self._at(offset_s, T_flange_camera.apply(self._centres))

    def travel_m(self) -> float:
        """Root mean square distance of a point on the flange's sensor from its mean place."""
        middle = self._problem.T_flange_camera.apply(self._centres.mean(axis=0))
        places = self._at(0.0, np.tile(middle, (len(self._centres), 1)))
        return float(np.sqrt(np.sum(np.var(places, axis=0))))

    def model(self, T_start: RigidTransform) -> Model:
        """Residuals in sigmas by offset, target and a small move of the mount, with derivatives."""
        sigma_m, largest_s = self._problem.sigma_m, self._problem.largest_offset_s

        def model(parameters: Float[np.ndarray, "p"]) -> tuple[np.ndarray, np.ndarray]:
            offset_s = float(np.clip(parameters[_TIME], -largest_s, largest_s))
            mount = perturbed(T_start, parameters[4:]) if len(parameters) > 4 else T_start
            seen_flange = mount.apply(self._centres)
            faster = self._at(offset_s + _STEP_S, seen_flange) - self._at(offset_s - _STEP_S, seen_flange)
            jacobian = np.zeros((len(seen_flange), 3, len(parameters)))
            jacobian[..., _TIME] = faster / (2 * _STEP_S)
            jacobian[..., _PLACE] = -np.eye(3)
            if len(parameters) > 4:
                R_base_flange = self._turn(self._stamps_s + offset_s).as_matrix()
                jacobian[..., 4:] = jacobian_of(R_base_flange, mount.rotation.as_matrix(), self._centres)[..., :6]
                jacobian[..., 4:7] = jacobian[..., 4:7] @ right_jacobian(parameters[4:7])
            residuals = self._at(offset_s, seen_flange) - parameters[_PLACE]
            return residuals / sigma_m, jacobian / sigma_m

        return model

    def _at(self, offset_s: float, points_flange: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        times_s = self._stamps_s + offset_s
        return np.asarray(self._turn(times_s).apply(points_flange) + self._place(times_s))

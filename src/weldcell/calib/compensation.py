"""Compensation by a target whose place the torch itself has told: paper P2's last step.

Minimises sum |T_bf T_fc M_c - M_b|^2 over T_fc from the first hand-eye solution, with M_b from touches.
This aligns the sensor with the torch through the robot as it is: it takes up tool errors and the robot's
errors near the target, and says nothing of places far from it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib.hand_eye import check_sights
from weldcell.calib.least_squares import Fit, Model, fit
from weldcell.calib.sight_model import (
    lever_m,
    mount_model,
    perturbed,
    sight_blocks,
    sight_covariances_base,
    sight_jacobian,
    targets_base,
)
from weldcell.calib.verdict import (
    Judged,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
    weigh_outliers,
    weigh_residual,
    weigh_spare,
)
from weldcell.cell.errors import BadInput

DOUBTFUL_RMS_M = 3e-3
REFUSED_RMS_M = 20e-3
_ROUNDS = 2  # the second starts its perturbation anew from zero, where the covariance is defined


@dataclass(frozen=True, kw_only=True, eq=False)
class CompensationProblem:
    """Sights of a target whose place in the base is known."""

    T_base_flange: RigidTransform
    """Flange in the base for each sight, as the controller reported it (n transforms)."""
    centres_camera: Float[np.ndarray, "n 3"]
    """The target in the camera for each sight (m)."""
    centre_base: Float[np.ndarray, "3"]
    """The target in the base (m), from touches."""
    T_flange_camera: RigidTransform
    """The first solution."""
    covariances_camera: Float[np.ndarray, "n 3 3"] | None = None
    """Of the centres (m^2); none: the robot's error alone weighs."""
    pose_sigma_m: float = 1e-4
    """The robot's error for a single pose, each axis; added in quadrature. It keeps many points of one
    profile from outvoting the robot."""
    centre_covariance_base: Float[np.ndarray, "3 3"] | None = None
    """Of `centre_base` (m^2): common to all sights, so it goes into the covariance, not the weights."""
    robust: bool = True
    """Let sights that miss by more than three sigmas pull with constant force only."""

    def __post_init__(self) -> None:
        check_sights(
            "compensation", self.T_base_flange, self.centres_camera, self.covariances_camera, self.pose_sigma_m
        )
        if np.shape(self.centre_base) != (3,) or not np.all(np.isfinite(self.centre_base)):
            raise BadInput(f"compensation: centre_base is {self.centre_base}, expected 3 finite numbers")


@dataclass(frozen=True, kw_only=True, eq=False)
class CompensationResult(Judged):
    """The compensated camera on the flange.

    In the condition number rotations count by what they move at the mean sight distance.
    """

    T_flange_camera: RigidTransform
    covariance: Float[np.ndarray, "6 6"]
    """Rotation vector (rad, camera axes), then translation (m, flange axes); infinite if a direction is open."""
    residuals_base: Float[np.ndarray, "n 3"]
    """Where each sight puts the target, less `centre_base` (m), after compensation."""
    residual_before_m: Float[np.ndarray, "n"]
    """Length of each residual with the first solution."""
    residual_m: Float[np.ndarray, "n"]
    """Length of each residual after compensation."""
    rms_before_m: float
    rms_m: float
    """Root mean square length of the residuals."""
    weights: Float[np.ndarray, "n"]
    """1 for a sight that fits, towards 0 for one that does not."""
    converged: bool


def solve(problem: CompensationProblem) -> CompensationResult:
    """The camera on the flange by Levenberg-Marquardt over a rotation of the camera and a translation."""
    T_flange_camera, found = problem.T_flange_camera, None
    before = targets_base(problem.T_base_flange, T_flange_camera, problem.centres_camera) - problem.centre_base
    if before.size >= 6:
        whitening = _whitening(problem)
        for _ in range(_ROUNDS):
            found = fit(_model(problem, T_flange_camera, whitening), np.zeros(6), robust=problem.robust)
            T_flange_camera = perturbed(T_flange_camera, found.parameters)
    return _judged(problem, T_flange_camera, found, before)


def _judged(
    problem: CompensationProblem, T_flange_camera: RigidTransform, found: Fit | None, before: Float[np.ndarray, "n 3"]
) -> CompensationResult:
    after = targets_base(problem.T_base_flange, T_flange_camera, problem.centres_camera) - problem.centre_base
    residual_before_m, residual_m = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    jacobian = sight_jacobian(problem.T_base_flange, T_flange_camera, problem.centres_camera)[..., :6]
    seen = observe(jacobian.reshape(-1, 6), sight_blocks(lever_m(problem.centres_camera))[:2])
    rms_m = float(np.sqrt(np.mean(residual_m**2)))
    findings = weigh_spare(after.size, 6) + weigh_condition(seen, "compensation")
    findings += weigh_residual(rms_m, "compensation", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_outliers(residual_m, "sight")
    if found is not None:
        findings += weigh_convergence(found.converged, found.message)
    verdict, reasons = judge(findings)
    return CompensationResult(
        T_flange_camera=T_flange_camera,
        covariance=np.full((6, 6), np.inf) if found is None else _covariance(problem, found),
        residuals_base=after,
        residual_before_m=residual_before_m,
        residual_m=residual_m,
        rms_before_m=float(np.sqrt(np.mean(residual_before_m**2))),
        rms_m=rms_m,
        weights=np.ones(len(after)) if found is None else found.weights,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        converged=found is not None and found.converged,
        verdict=verdict,
        reasons=reasons,
    )


def _model(problem: CompensationProblem, T_start: RigidTransform, whitening: Float[np.ndarray, "n 3 3"]) -> Model:
    """Whitened residuals, and their derivatives by a perturbation of `T_start`."""
    sights = mount_model(problem.T_base_flange, T_start, problem.centres_camera)

    def model(parameters: Float[np.ndarray, "6"]) -> tuple[np.ndarray, np.ndarray]:
        seen_base, by_mount = sights(parameters)
        return np.einsum("nij,nj->ni", whitening, seen_base - problem.centre_base), whitening @ by_mount

    return model


def _whitening(problem: CompensationProblem) -> Float[np.ndarray, "n 3 3"]:
    """For each sight the matrix that turns its residual (base axes, m) into sigmas, by the first solution."""
    covariances = sight_covariances_base(
        problem.T_base_flange, problem.T_flange_camera, problem.covariances_camera, problem.pose_sigma_m
    )
    return np.linalg.inv(np.linalg.cholesky(covariances))


def _covariance(problem: CompensationProblem, found: Fit) -> Float[np.ndarray, "6 6"]:
    """The fit's, and what an error of the target's place does to all sights alike."""
    if problem.centre_covariance_base is None or not np.all(np.isfinite(found.covariance)):
        return found.covariance
    weighted = found.weights[:, None, None] * found.jacobian.swapaxes(1, 2) @ _whitening(problem)
    gain = found.covariance / found.inflation @ weighted.sum(axis=0)
    return found.covariance + gain @ problem.centre_covariance_base @ gain.T

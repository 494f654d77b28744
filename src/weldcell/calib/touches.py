"""The sphere's centre in the base, and the torch's tip on the flange, from touches of tip and sphere.

At a touch the tip's centre T_bf t is one radius sum from the sphere's centre: |T_bf t - M| = R_sphere + r_tip.
Paper P2 knows the tip and fits the centre alone; the tip can be estimated as well where the touches vary
the flange's orientation.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib.consensus import WRONG_SHARE
from weldcell.calib.least_squares import Fit, Model, fit, robust_spread
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
REFUSED_RMS_M = 5e-3  # a quarter of the usual sphere's radius
_GATE_SIGMAS = 3.5
_TRIMMINGS = 8  # gross touches pull the first fits, whose spread hides some of them
_TIP_OFF_M = 20e-3  # more is another torch, or another unit


@dataclass(frozen=True, kw_only=True, eq=False)
class TouchProblem:
    """Touches of one fixed sphere."""

    T_base_flange: RigidTransform
    """Flange in the base at each touch, as the controller reported it (n transforms)."""
    tip_flange: Float[np.ndarray, "3"]
    """Nominal centre of the tip's rounding (m); the start if it is estimated."""
    radius_m: float
    """Radius of the sphere."""
    tip_radius_m: float = 0.0
    """Radius of the rounded tip."""
    estimate_tip: bool = True
    """Estimate the tip as well; false is P2 to the letter."""
    sigma_m: float | Float[np.ndarray, "n"] = 1e-4
    """Standard deviation of each touch's distance: robot repeatability and touch switch."""
    robust: bool = True
    """Let touches that miss by more than three sigmas pull with constant force only, and leave gross ones out."""

    def __post_init__(self) -> None:
        if self.T_base_flange.single or not np.isfinite(self.T_base_flange.as_matrix()).all():
            raise BadInput("touches: expected a stack of finite flange poses")
        if np.shape(self.tip_flange) != (3,) or not np.all(np.isfinite(self.tip_flange)):
            raise BadInput(f"touches: tip_flange is {self.tip_flange}, expected 3 finite numbers")
        if not (np.isfinite(self.radius_m) and self.radius_m > 0 and 0 <= self.tip_radius_m < np.inf):
            raise BadInput(f"touches: radius_m {self.radius_m}, tip_radius_m {self.tip_radius_m}: expected lengths")
        sigma_m = np.asarray(self.sigma_m, dtype=float)
        if sigma_m.shape not in ((), (len(self.T_base_flange),)) or not np.all(sigma_m > 0):
            raise BadInput("touches: sigma_m must be one length above 0, or one a touch")


@dataclass(frozen=True, kw_only=True, eq=False)
class TouchResult(Judged):
    """Sphere and tip; all parameters are lengths."""

    centre_base: Float[np.ndarray, "3"]
    """The sphere's centre (m)."""
    tip_flange: Float[np.ndarray, "3"]
    """The tip (m): estimated, or the nominal one."""
    covariance: Float[np.ndarray, "6 6"]
    """Centre (m^2, base axes), then tip (flange axes; zero where taken as known); infinite if one is open."""
    residual_m: Float[np.ndarray, "n"]
    """Distance of tip and centre less the radius sum, for each touch."""
    sound: Bool[np.ndarray, "n"]
    """The touches that the estimate rests on; the others are outliers."""
    rms_m: float
    """Root mean square of the sound touches' residuals."""
    converged: bool


def solve(problem: TouchProblem) -> TouchResult:
    """Centre (and tip) by Levenberg-Marquardt from the linear sphere fit with the nominal tip."""
    free = 6 if problem.estimate_tip else 3
    count = len(problem.T_base_flange)
    start = np.concatenate([_linear_centre(problem), problem.tip_flange])[:free]
    if count < free:
        return _judged(problem, start, None, np.ones(count, dtype=bool))
    found = fit(_model(problem), start, robust=problem.robust)
    sound = np.ones(count, dtype=bool)
    for _ in range(_TRIMMINGS if problem.robust else 0):
        near = _near(problem, found)
        if np.array_equal(near, sound) or np.sum(near) < max(free, (1 - WRONG_SHARE) * count - 1):
            break
        sound = near
        found = fit(_model(_only(problem, sound)), found.parameters)
    return _judged(problem, found.parameters, found, sound)


def _near(problem: TouchProblem, found: Fit) -> Bool[np.ndarray, "n"]:
    """The touches within a few times what the fit's own usually miss by."""
    spread = max(1.0, robust_spread(found.residuals, unknowns=len(found.parameters)))
    residuals, _ = _model(problem)(found.parameters)
    return np.asarray(np.abs(residuals[:, 0]) < _GATE_SIGMAS * spread)


def _only(problem: TouchProblem, sound: Bool[np.ndarray, "n"]) -> TouchProblem:
    sigma_m = np.broadcast_to(problem.sigma_m, len(sound))[sound]
    return replace(problem, T_base_flange=problem.T_base_flange[sound], sigma_m=sigma_m)


def _judged(
    problem: TouchProblem, parameters: Float[np.ndarray, "free"], found: Fit | None, sound: Bool[np.ndarray, "n"]
) -> TouchResult:
    free, sigma_m = len(parameters), np.broadcast_to(problem.sigma_m, len(problem.T_base_flange))
    residuals, jacobian = _model(problem)(parameters)
    residual_m = residuals[:, 0] * sigma_m
    rms_m = float(np.sqrt(np.mean(residual_m[sound] ** 2)))
    seen = observe((jacobian[:, 0] * sigma_m[:, None])[sound], _blocks(problem))
    covariance = np.zeros((6, 6))
    covariance[:free, :free] = np.inf if found is None else found.covariance
    tip_flange = parameters[3:] if problem.estimate_tip else np.array(problem.tip_flange, dtype=float)
    findings = _findings(found, seen, residual_m, sound, rms_m, free) + _weigh_tip(problem, tip_flange)
    verdict, reasons = judge(findings)
    return TouchResult(
        centre_base=parameters[:3],
        tip_flange=tip_flange,
        covariance=covariance,
        residual_m=residual_m,
        sound=sound,
        rms_m=rms_m,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        converged=found is not None and found.converged,
        verdict=verdict,
        reasons=reasons,
    )


def _findings(
    found: Fit | None,
    seen: Observability,
    residual_m: Float[np.ndarray, "n"],
    sound: Bool[np.ndarray, "n"],
    rms_m: float,
    free: int,
) -> list[Finding]:
    findings = weigh_spare(int(np.sum(sound)), free) + weigh_condition(seen, "touches")
    if found is None:
        return findings
    findings += weigh_convergence(found.converged, found.message)
    findings += weigh_residual(rms_m, "touches", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    return (
        findings
        + [
            Finding(
                verdict="doubtful",
                reason=f"touch {k} (counted from 0) misses by {abs(residual_m[k]) * 1e3:.3g} mm, left out",
            )
            for k in np.flatnonzero(~sound)
        ]
        + weigh_outliers(np.where(sound, np.abs(residual_m), 0.0), "touch")
    )


def _weigh_tip(problem: TouchProblem, tip_flange: Float[np.ndarray, "3"]) -> list[Finding]:
    distance_m = float(np.linalg.norm(tip_flange - problem.tip_flange))
    if distance_m <= _TIP_OFF_M:
        return []
    reason = f"the tip lies {distance_m * 1e3:.3g} mm from its nominal place, expected within {_TIP_OFF_M * 1e3:.3g} mm"
    return [Finding(verdict="doubtful", reason=reason)]


def _model(problem: TouchProblem) -> Model:
    """Distances less the radius sum, in sigmas, with derivatives by centre and tip."""
    R_base_flange = problem.T_base_flange.rotation.as_matrix()
    flange_base = problem.T_base_flange.translation
    sigma_m = np.broadcast_to(problem.sigma_m, len(flange_base))[:, None]
    sum_m = problem.radius_m + problem.tip_radius_m

    def model(parameters: Float[np.ndarray, "free"]) -> tuple[np.ndarray, np.ndarray]:
        tip_flange = parameters[3:] if len(parameters) == 6 else problem.tip_flange
        offsets = R_base_flange @ tip_flange + flange_base - parameters[:3]
        distances_m = np.linalg.norm(offsets, axis=1, keepdims=True)
        outward = offsets / np.maximum(distances_m, 1e-12)
        by_tip = np.einsum("ni,nij->nj", outward, R_base_flange)
        jacobian = np.concatenate([-outward, by_tip], axis=1)[:, : len(parameters)]
        return (distances_m - sum_m) / sigma_m, (jacobian / sigma_m)[:, None]

    return model


def _linear_centre(problem: TouchProblem) -> Float[np.ndarray, "3"]:
    """Centre of the sphere of any radius through the nominal tips: |p|^2 = 2 M.p + k, about their mean."""
    tips_base = problem.T_base_flange.apply(problem.tip_flange)
    middle = tips_base.mean(axis=0)
    local = tips_base - middle
    design = np.column_stack([2 * local, np.full(len(local), problem.radius_m)])
    return middle + np.linalg.lstsq(design, np.sum(local**2, axis=1), rcond=1e-6)[0][:3]


def _blocks(problem: TouchProblem) -> list[Block]:
    centre = Block(name="the sphere's centre along", frame="base")
    return [centre, Block(name="the tip along", frame="flange")] if problem.estimate_tip else [centre]

"""The torch's tip on the flange from poses in which it touches one fixed point (the four-point method of controllers).

R_i t + p_i = M for every flange pose (R_i, p_i), linear in the tip t and the point M. Rows that do not agree with the
others are found by consensus (least trimmed squares) and left out; the rest give t and M by linear least squares. The
poses must turn about two axes at least: along a single one the tip stays open.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.calib.consensus import WRONG_SHARE, Misses, agreeing, most_wrong
from weldcell.calib.turns import weigh_turns
from weldcell.calib.verdict import (
    Block,
    Finding,
    Judged,
    Observability,
    Verdict,
    judge,
    observe,
    weigh_condition,
    weigh_residual,
    weigh_spare,
)
from weldcell.cell.errors import BadInput

FEWEST_POSES = 4
DOUBTFUL_RMS_M = 2e-3  # a point is touched by eye to some tenths of a millimetre
REFUSED_RMS_M = 20e-3
_USUAL_TIP_M, _LARGEST_TIP_M = 0.8, 2.0  # from the flange
_RIDGE = 1e-12  # keeps subsets that turn about one axis solvable


@dataclass(frozen=True, kw_only=True, eq=False)
class PivotProblem:
    """Poses in which the tip is at one fixed point."""

    T_base_flange: RigidTransform
    """Flange in the base at each touch, as the controller reported it (n transforms)."""

    def __post_init__(self) -> None:
        if self.T_base_flange.single or not np.isfinite(self.T_base_flange.as_matrix()).all():
            raise BadInput("pivot: expected a stack of finite flange poses")


@dataclass(frozen=True, kw_only=True, eq=False)
class PivotResult(Judged):
    """The tip.

    The condition number is that of the sound poses' Jacobian; all parameters are lengths.
    """

    tip_flange: Float[np.ndarray, "3"]
    """The tip (m)."""
    point_base: Float[np.ndarray, "3"]
    """The point that it touched (m)."""
    sound: Bool[np.ndarray, "n"]
    """The poses that the estimate rests on; the others are outliers."""
    covariance: Float[np.ndarray, "6 6"]
    """Tip (m^2, flange axes), then point (base axes), from the residuals; infinite if a direction is open."""
    residuals_base: Float[np.ndarray, "n 3"]
    """Where each pose puts the tip, less `point_base` (m)."""
    rms_m: float
    """Root mean square length of the sound poses' residuals."""
    leave_one_out_rms_m: float
    """The same of each sound pose against the estimate without it; NaN where one pose is indispensable."""


def solve(problem: PivotProblem) -> PivotResult:
    """The tip from the poses that agree with each other; deterministic."""
    rows, known = _equations(problem.T_base_flange)
    sound = agreeing(_misses(rows, known), len(rows))
    solution = _least_squares(rows[sound], known[sound])
    residuals = rows @ solution + known
    seen = observe(
        rows[sound].reshape(-1, 6),
        [Block(name="the tip along", frame="flange"), Block(name="the point along", frame="base")],
    )
    determined = seen.rank == 6
    rms_m = float(np.sqrt(np.mean(np.sum(residuals[sound] ** 2, axis=1))))
    verdict, reasons = judge(_findings(problem, sound, seen, rms_m, solution))
    return PivotResult(
        tip_flange=solution[:3],
        point_base=solution[3:],
        sound=sound,
        covariance=_covariance(rows[sound], residuals[sound]) if determined else np.full((6, 6), np.inf),
        residuals_base=residuals,
        rms_m=rms_m,
        leave_one_out_rms_m=_leave_one_out_rms_m(rows[sound], residuals[sound]) if determined else float("nan"),
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        verdict=verdict,
        reasons=reasons,
    )


def _equations(T_base_flange: RigidTransform) -> tuple[Float[np.ndarray, "n 3 6"], Float[np.ndarray, "n 3"]]:
    """[R_i, -1] and p_i: their product with (t, M) and sum are the residuals."""
    R_base_flange = T_base_flange.rotation.as_matrix()
    against = np.broadcast_to(-np.eye(3), R_base_flange.shape)
    return np.concatenate([R_base_flange, against], axis=-1), T_base_flange.translation


def _least_squares(rows: Float[np.ndarray, "k 3 6"], known: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "6"]:
    """Tip and point; the shortest tip where they are not determined."""
    return np.asarray(np.linalg.lstsq(rows.reshape(-1, 6), -known.ravel(), rcond=1e-10)[0])


def _misses(rows: Float[np.ndarray, "n 3 6"], known: Float[np.ndarray, "n 3"]) -> Misses:
    """By how much each pose misses the tip and point that the chosen ones give (normal equations: there are many)."""
    informations = np.einsum("nij,nik->njk", rows, rows)
    pulls = np.einsum("nij,ni->nj", rows, known)

    def misses(chosen: Int[np.ndarray, "k"]) -> Float[np.ndarray, "n"]:
        information = informations[chosen].sum(axis=0) + len(chosen) * _RIDGE * np.eye(6)
        solution = -np.linalg.solve(information, pulls[chosen].sum(axis=0))
        return np.asarray(np.linalg.norm(rows @ solution + known, axis=1))

    return misses


def _findings(
    problem: PivotProblem,
    sound: Bool[np.ndarray, "n"],
    seen: Observability,
    rms_m: float,
    solution: Float[np.ndarray, "6"],
) -> list[Finding]:
    count, kept = len(sound), int(np.sum(sound))
    findings = weigh_condition(seen, "pivot") + weigh_turns(problem.T_base_flange.rotation[sound], "pivot")
    findings += weigh_residual(rms_m, "pivot", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_spare(3 * kept, 6)
    if kept < FEWEST_POSES:
        findings.append(Finding(verdict="refused", reason=f"pivot: {kept} poses, expected at least {FEWEST_POSES}"))
    elif count - kept > WRONG_SHARE * count:
        reason = f"pivot: {count - kept} of {count} poses disagree with the rest, expected at most {WRONG_SHARE:.0%}"
        findings.append(Finding(verdict="refused", reason=reason))
    elif most_wrong(count) == 0:
        reason = f"pivot: {count} poses: too few to tell a wrong one from the others"
        findings.append(Finding(verdict="doubtful", reason=reason))
    distance_m = float(np.linalg.norm(solution[:3]))
    if distance_m > _USUAL_TIP_M:  # the inverse poses of a pivot are one as well, its point and tip exchanged
        verdict: Verdict = "refused" if distance_m > _LARGEST_TIP_M else "doubtful"
        reason = f"pivot: the tip lies {distance_m:.3g} m from the flange, expected below {_USUAL_TIP_M:g} m"
        findings.append(Finding(verdict=verdict, reason=f"{reason} (mixed units or inverted transforms?)"))
    return findings


def _covariance(rows: Float[np.ndarray, "k 3 6"], residuals: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "6 6"]:
    flat = rows.reshape(-1, 6)
    freedom = max(len(flat) - 6, 1)
    return np.linalg.inv(flat.T @ flat) * np.sum(residuals**2) / freedom


def _leave_one_out_rms_m(rows: Float[np.ndarray, "k 3 6"], residuals: Float[np.ndarray, "k 3"]) -> float:
    """Each pose against the estimate without it: (I - H_ii)^-1 r_i with H the hat matrix."""
    flat = rows.reshape(-1, 6)
    rest = np.eye(3) - rows @ np.linalg.inv(flat.T @ flat) @ rows.swapaxes(1, 2)
    if np.linalg.svd(rest, compute_uv=False).min() < 1e-9:
        return float("nan")
    left_out = np.linalg.solve(rest, residuals[..., None])[..., 0]
    return float(np.sqrt(np.mean(np.sum(left_out**2, axis=1))))

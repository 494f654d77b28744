"""How far a calibration may be trusted: scaled condition number, open directions, and a verdict in words.

Parameters are brought to one unit (m) before anything is compared: a rotation counts by the displacement
it causes at a documented distance. Columns are not normalised, for that would hide a direction that the
data hardly see.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

Verdict = Literal["accepted", "doubtful", "refused"]

DOUBTFUL_CONDITION = 100.0
REFUSED_CONDITION = 1e4
_SINGULAR = 1e-10  # relative singular value that is rounding, not data
_NAMED_SHARE = 0.2  # a block with less than this share of a direction is left out of its description
_OUTLIER_RATIO = 4.0  # times the third quartile: 4.6 sigma for normal errors along one axis, 8 for a vector
_OUTLIER_FLOOR_M = 1e-6  # residuals below this are rounding and quantisation


@dataclass(frozen=True, kw_only=True)
class Block:
    """Neighbouring parameters that form one vector, e.g. the translation of the camera."""

    name: str
    """What it is, e.g. `rotation about`, `translation along`; the direction follows in words."""
    frame: str
    """Frame of its axes."""
    unit_m: float = 1.0
    """Metres of displacement for one unit of the parameter (a rotation's lever; 1 for lengths)."""
    size: int = 3
    """Number of parameters."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Observability:
    """What a Jacobian can tell about the parameters."""

    condition_number: float
    """Largest over smallest singular value of the scaled Jacobian; infinite if a direction is open."""
    rank: int
    singular_values: Float[np.ndarray, "p"]
    """Of the scaled Jacobian, falling."""
    weak_directions: tuple[str, ...]
    """Directions in parameter space whose singular value is below 1/100 of the largest, in words."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that speaks against a result."""

    verdict: Verdict
    reason: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """What speaks for and against a calibration's result. Where refused, the result is not an answer."""

    condition_number: float
    """Of the scaled Jacobian; infinite if a direction is open."""
    observability: tuple[str, ...]
    """Directions that the data hardly determine, in words; empty if none."""
    verdict: Verdict
    reasons: tuple[str, ...]
    """What speaks against the result, in words, the worst first."""


def observe(jacobian: Float[np.ndarray, "rows p"], blocks: Sequence[Block]) -> Observability:
    """Rank, scaled condition number and weak directions of the parameters that `blocks` describe."""
    units_m = np.repeat([block.unit_m for block in blocks], [block.size for block in blocks])
    count = len(units_m)
    padded = np.vstack([jacobian / units_m, np.zeros((count, count))])  # fewer rows than parameters: open directions
    _, values, directions = np.linalg.svd(np.linalg.qr(padded, mode="r"))
    rank = int(np.sum(values > _SINGULAR * values[0])) if values[0] > 0 else 0
    condition = values[0] / values[-1] if rank == count else np.inf
    weak = directions[values <= values[0] / DOUBTFUL_CONDITION]
    return Observability(
        condition_number=float(condition),
        rank=rank,
        singular_values=values,
        weak_directions=tuple(_words(direction, blocks) for direction in weak),
    )


def judge(findings: Iterable[Finding]) -> tuple[Verdict, tuple[str, ...]]:
    """The worst verdict among the findings, and all their reasons, the worst first."""
    order: list[Verdict] = ["refused", "doubtful", "accepted"]
    ranked = sorted(findings, key=lambda finding: order.index(finding.verdict))
    verdict: Verdict = ranked[0].verdict if ranked else "accepted"
    return verdict, tuple(finding.reason for finding in ranked)


def weigh_condition(seen: Observability, what: str) -> list[Finding]:
    """Findings on a condition number: doubtful above 100, refused above 1e4 or without full rank."""
    if seen.condition_number <= DOUBTFUL_CONDITION:
        return []
    verdict: Verdict = "refused" if seen.condition_number > REFUSED_CONDITION else "doubtful"
    degree = "not determined" if seen.rank < len(seen.singular_values) else "hardly determined"
    directions = "; ".join(seen.weak_directions)
    reason = f"{what}: scaled condition number {seen.condition_number:.3g}, {degree}: {directions}"
    return [Finding(verdict=verdict, reason=reason)]


def weigh_residual(rms_m: float, what: str, *, doubtful_m: float, refused_m: float) -> list[Finding]:
    """Findings on a root mean square residual (m)."""
    if rms_m <= doubtful_m:
        return []
    verdict: Verdict = "refused" if not rms_m <= refused_m else "doubtful"
    limit_m = refused_m if verdict == "refused" else doubtful_m
    reason = f"{what}: residuals of {rms_m * 1e3:.3g} mm rms, expected below {limit_m * 1e3:.3g} mm"
    return [Finding(verdict=verdict, reason=reason)]


def outlying(residual_m: Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Which observations miss far more than the others do."""
    return residual_m > max(_OUTLIER_RATIO * _usual_m(residual_m), _OUTLIER_FLOOR_M)


def weigh_outliers(residual_m: Float[np.ndarray, "n"], what: str) -> list[Finding]:
    """Doubts about single observations that miss far more than the others do."""
    usual_m = _usual_m(residual_m)
    return [
        Finding(
            verdict="doubtful",
            reason=f"{what} {index} (counted from 0) misses by {residual_m[index] * 1e3:.3g} mm, "
            f"three quarters of them by {usual_m * 1e3:.3g} mm or less",
        )
        for index in np.flatnonzero(outlying(residual_m))
    ]


def _usual_m(residual_m: Float[np.ndarray, "n"]) -> float:
    """The third quartile: poses of one orientation agree too well to say what is usual."""
    return float(np.quantile(residual_m, 0.75, method="lower"))


def weigh_spare(equations: int, unknowns: int) -> list[Finding]:
    """A doubt where no equation is left over to check the answer with."""
    if equations > unknowns:
        return []
    reason = f"{equations} equations for {unknowns} unknowns: nothing left to check the answer with"
    return [Finding(verdict="doubtful" if equations == unknowns else "refused", reason=reason)]


def weigh_convergence(converged: bool, message: str) -> list[Finding]:
    """A refusal where the iteration did not end at a minimum."""
    return [] if converged else [Finding(verdict="refused", reason=f"did not converge: {message}")]


def _words(direction: Float[np.ndarray, "p"], blocks: Sequence[Block]) -> str:
    """A direction in parameter space, e.g. `translation along (0.00, 0.00, 1.00) of the flange with target ...`."""
    parts, first = [], 0
    for block in blocks:
        piece = direction[first : first + block.size]
        first += block.size
        share = np.linalg.norm(piece)
        if share > _NAMED_SHARE:
            numbers = ", ".join(f"{value + 0.0:.2f}" for value in np.round(piece / share, 2))
            parts.append(f"{block.name} ({numbers}) of the {block.frame}")
    return " with ".join(parts)

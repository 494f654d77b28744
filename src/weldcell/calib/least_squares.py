"""Robust nonlinear least squares on observations of one or more components, with covariance.

The loss is the pseudo-Huber function of each observation's whole residual vector, so that turning the
frame of the residuals does not change the answer. It enters as a factor on the residuals, which leaves a
plain least squares problem for MINPACK's Levenberg-Marquardt (through SciPy).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.optimize import OptimizeResult, least_squares
from scipy.special import gammaincinv
from scipy.stats import chi2

Residuals = Float[np.ndarray, "n components"]
Jacobian = Float[np.ndarray, "n components p"]
Model = Callable[[Float[np.ndarray, "p"]], tuple[Residuals, Jacobian]]
"""Parameters to whitened residuals (in sigmas) and their derivatives."""

_LOSS_SIGMAS = 3.0  # beyond this a residual pulls with constant force
_TOLERANCE = 1e-15  # to solver precision
_MOST_EVALUATIONS = 200  # an answer that the data hold takes some tens
_QUANTILES = 1000  # of a distribution, for its means
_SINGULAR = 1e-12  # relative singular value below which no covariance exists


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A minimum of the robust loss."""

    parameters: Float[np.ndarray, "p"]
    covariance: Float[np.ndarray, "p p"]
    """From the sigmas that the residuals were whitened with, times `inflation`; infinite without full rank."""
    residuals: Residuals
    """Whitened, at the minimum."""
    jacobian: Jacobian
    """Whitened, at the minimum."""
    weights: Float[np.ndarray, "n"]
    """1 for an observation that fits, towards 0 for one that does not."""
    inflation: float
    """Factor on (J'WJ)^-1 that makes it the covariance: the loss's own, and the residuals' variance over the predicted
    one where that is above 1."""
    converged: bool
    message: str
    """What the solver said."""


def fit(model: Model, start: Float[np.ndarray, "p"], *, robust: bool = True) -> Fit:
    """The minimum near `start`; needs at least as many residuals as parameters.

    Two rounds: the first with the sigmas as given, the second with the loss widened to the spread that
    the residuals really have, so that sigmas that were promised too small do not turn data into outliers.
    """
    loss_sigmas = _LOSS_SIGMAS if robust else np.inf
    found = _minimise(model, np.asarray(start, dtype=float), loss_sigmas)
    spread = robust_spread(model(found.x)[0], unknowns=len(found.x))
    if robust and spread > 1:
        loss_sigmas *= spread
        found = _minimise(model, found.x, loss_sigmas)
    residuals, jacobian = model(found.x)
    weights = 1 / np.sqrt(1 + np.sum(residuals**2, axis=-1) / loss_sigmas**2)
    inflation = _inflation(residuals, weights, len(found.x), _LOSS_SIGMAS if robust else np.inf)
    return Fit(
        parameters=found.x,
        covariance=inflation * covariance(jacobian, weights),
        residuals=residuals,
        jacobian=jacobian,
        weights=weights,
        inflation=inflation,
        converged=bool(found.success),
        message=str(found.message),
    )


def covariance(jacobian: Jacobian, weights: Float[np.ndarray, "n"]) -> Float[np.ndarray, "p p"]:
    """Inverse of J'WJ; all infinite where a direction is open."""
    rows = (np.sqrt(weights)[:, None, None] * jacobian).reshape(-1, jacobian.shape[-1])
    _, values, directions = np.linalg.svd(rows, full_matrices=False)
    if len(values) < rows.shape[1] or not values[-1] > _SINGULAR * values[0]:
        return np.full((rows.shape[1], rows.shape[1]), np.inf)
    scaled = directions / values[:, None]
    return scaled.T @ scaled


def without_others(jacobian: Jacobian, count: int) -> Float[np.ndarray, "rows count"]:
    """What the first `count` parameters still change once all others have been fitted: their columns, the others'
    directions taken out.
    """
    rows = jacobian.reshape(-1, jacobian.shape[-1])
    scale = np.linalg.norm(rows, axis=0)
    others = rows[:, count:] / np.where(scale > 0, scale, 1)[count:]
    basis, _ = np.linalg.qr(others)
    kept = rows[:, :count]
    return kept - basis @ (basis.T @ kept)


def robust_spread(residuals: Residuals, unknowns: int = 0) -> float:
    """Standard deviation of one component, from the median length of the residual vectors (1 as predicted)."""
    components = residuals.shape[1]
    median_length = np.sqrt(2 * gammaincinv(components / 2, 0.5))  # of a normal vector: root of the chi2 median
    freedom = max(residuals.size - unknowns, 1) / residuals.size
    return float(np.median(np.linalg.norm(residuals, axis=-1)) / median_length / np.sqrt(freedom))


def _minimise(model: Model, start: Float[np.ndarray, "p"], loss_sigmas: float) -> OptimizeResult:
    damped = _Damped(model, loss_sigmas)
    return least_squares(
        damped.residuals,
        start,
        damped.jacobian,
        method="lm",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_MOST_EVALUATIONS,
    )


def _inflation(residuals: Residuals, weights: Float[np.ndarray, "n"], unknowns: int, loss_sigmas: float) -> float:
    components = residuals.shape[-1]
    factor, usual = _of_normal_noise(components, loss_sigmas) if np.isfinite(loss_sigmas) else (1.0, 1.0)
    freedom = np.sum(weights) * components - unknowns
    if freedom <= 0:
        return factor
    return factor * max(1.0, float(np.sum(weights * np.sum(residuals**2, axis=-1)) / freedom) / usual)


@cache
def _of_normal_noise(components: int, loss_sigmas: float) -> tuple[float, float]:
    """What the loss makes of normal noise of one sigma: the factor on (J'WJ)^-1, and the weighted variance.

    An M-estimate scatters by E[psi^2] / E[psi']^2 (Huber, Robust Statistics, 1981, section 6.3), psi being the weighted
    residual; weights alone overstate that, for they count a usual residual as less than a whole observation.
    """
    squares = chi2.ppf((np.arange(_QUANTILES) + 0.5) / _QUANTILES, components)
    weights = 1 / np.sqrt(1 + squares / loss_sigmas**2)
    slope = np.mean(weights - squares / (components * loss_sigmas**2) * weights**3)
    spread = np.mean(weights**2 * squares) / components / slope**2
    return float(spread * weights.mean()), float(np.mean(weights * squares) / components / weights.mean())


class _Damped:
    """Residuals times s, so that their sum of squares is the robust loss; evaluates the model once a step.

    Pseudo-Huber loss rho(q) = 2 (sqrt(1 + q) - 1) of q = |r|^2 / c^2 equals q s^2 with s^2 = 2 / (sqrt(1 + q) + 1).
    """

    def __init__(self, model: Model, loss_sigmas: float) -> None:
        self._model, self._loss_sigmas = model, loss_sigmas
        self._at = np.array([])

    def residuals(self, parameters: Float[np.ndarray, "p"]) -> Float[np.ndarray, "rows"]:
        self._evaluate(parameters)
        return (self._factor[:, None] * self._residuals).ravel()

    def jacobian(self, parameters: Float[np.ndarray, "p"]) -> Float[np.ndarray, "rows p"]:
        self._evaluate(parameters)
        s, u = self._factor, self._root
        slope = -1 / (u * (u + 1) ** 2 * s * self._loss_sigmas**2)  # 2 ds/d(|r|^2)
        pull = np.einsum("ng,ngp->np", self._residuals, self._jacobian)
        turned = self._residuals[:, :, None] * pull[:, None]
        damped = s[:, None, None] * self._jacobian + slope[:, None, None] * turned
        return damped.reshape(-1, damped.shape[-1])

    def _evaluate(self, parameters: Float[np.ndarray, "p"]) -> None:
        if np.array_equal(parameters, self._at):
            return
        self._at = parameters.copy()
        self._residuals, self._jacobian = self._model(parameters)
        self._root = np.sqrt(1 + np.sum(self._residuals**2, axis=-1) / self._loss_sigmas**2)
        self._factor = np.sqrt(2 / (self._root + 1))

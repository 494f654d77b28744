"""The most likely unknowns of the joint estimate for given sizes of errors: damped Gauss-Newton with priors."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import gammaincinv

from weldcell.calib.joint_problem import JointProblem, Sizes
from weldcell.calib.joint_rows import JointModel, JointState, Observations

Weights = list[Float[np.ndarray, "_"]]
"""For each kind of observations the weight of each: 1, down to 0 for one that is left out."""

_STEPS = 40
_HALVINGS = 8
_STILL_SIGMAS = 1e-8  # a step that moves the residuals by less has arrived
_SOFT_STILL_SIGMAS = 1e-2  # while weights are looked for
_ROUNDING_M = 1e-14  # of a computed place: steps below it go round in circles
_LEVEL = 1e-9  # a relative rise of the cost that is rounding
_CAUCHY_SIGMAS = 3.0
_GATE_CHANCE = 1e-5  # that a sound observation is left out


@dataclass(frozen=True, kw_only=True, eq=False)
class Whitened:
    """All residuals and beliefs in sigmas, at one guess."""

    residuals: Float[np.ndarray, "rows"]
    jacobian: Float[np.ndarray, "rows q"]
    """By the free unknowns."""

    @property
    def cost(self) -> float:
        """Sum of squares."""
        return float(self.residuals @ self.residuals)


def fit(
    problem: JointProblem, model: JointModel, state: JointState, sizes: Sizes, weights: Weights | None
) -> tuple[JointState, bool]:
    """The guess improved to the most likely one, and whether it got there; the noise is that of the first guess.

    Without weights they are those of the Cauchy loss at each step, which outliers pull on ever less.
    """
    still = _SOFT_STILL_SIGMAS if weights is None else _STILL_SIGMAS
    prior_sigma = model.columns.prior_sigma(problem, sizes)
    free, seen = model.columns.free, model.observations(state)
    factors = whitening(seen, sizes)
    finest = _ROUNDING_M * max(float(each.max()) for each in factors)
    for _ in range(_STEPS):
        used = _cauchy_weights(seen, factors) if weights is None else weights
        rows = whitened(model, state, seen, factors, prior_sigma, used)
        step = np.zeros(len(free))
        step[free] = _solved(rows)
        moved = float(np.linalg.norm(rows.jacobian @ step[free]))
        for halving in range(_HALVINGS):
            there = state.moved(step / 2**halving, model.columns)
            seen_there = model.observations(there)
            cost = whitened(model, there, seen_there, factors, prior_sigma, used).cost
            if cost <= rows.cost * (1 + _LEVEL) + finest:
                state, seen = there, seen_there
                break
        if moved < max(still, finest * np.sqrt(len(rows.residuals))):
            return state, True
    return state, weights is None


def whitening(seen: list[Observations], sizes: Sizes) -> list[Float[np.ndarray, "_ _ _"]]:
    """For each kind of observations the matrices that turn metres into sigmas."""
    return [np.linalg.inv(np.linalg.cholesky(each.noise(sizes))) for each in seen]


def whitened(
    model: JointModel,
    state: JointState,
    seen: list[Observations],
    factors: list[Float[np.ndarray, "_ _ _"]],
    prior_sigma: Float[np.ndarray, "p"],
    weights: Weights,
) -> Whitened:
    """Observations and beliefs, each over its sigma and times the root of its weight."""
    free = model.columns.free
    residuals, jacobians = [], []
    for each, factor, weight in zip(seen, factors, weights, strict=True):
        weighted = np.sqrt(weight)[:, None, None] * factor
        residuals.append((weighted @ each.residuals[..., None]).ravel())
        jacobians.append((weighted @ each.jacobian[..., free]).reshape(-1, int(free.sum())))
    residuals.append((model.believed(state) / prior_sigma)[free])
    jacobians.append(np.diag(1 / prior_sigma[free]))
    return Whitened(residuals=np.concatenate(residuals), jacobian=np.concatenate(jacobians))


def gate_weights(seen: list[Observations], sizes: Sizes) -> Weights:
    """1 for what fits, 0 for what is off by more than chance allows, by the spread that most of them show."""
    weights = []
    for each, factor in zip(seen, whitening(seen, sizes), strict=True):
        components = each.residuals.shape[1]
        squares = _squares(each, factor)
        usual = max(1.0, float(np.median(squares)) / float(2 * gammaincinv(components / 2, 0.5)))
        limit = float(2 * gammaincinv(components / 2, 1 - _GATE_CHANCE))
        weights.append((squares <= usual * limit).astype(float))
    return weights


def _cauchy_weights(seen: list[Observations], factors: list[Float[np.ndarray, "_ _ _"]]) -> Weights:
    """Weights that fall with the square of a large residual."""
    return [
        1 / (1 + _squares(each, factor) / (each.residuals.shape[1] * _CAUCHY_SIGMAS**2))
        for each, factor in zip(seen, factors, strict=True)
    ]


def _squares(each: Observations, factor: Float[np.ndarray, "n c c"]) -> Float[np.ndarray, "n"]:
    """Squared length of each residual in sigmas."""
    return np.sum(np.square((factor @ each.residuals[..., None])[..., 0]), axis=1)


def _solved(rows: Whitened) -> Float[np.ndarray, "q"]:
    """The step to the minimum of the linearised problem."""
    scale = np.maximum(np.linalg.norm(rows.jacobian, axis=0), 1e-300)
    return np.linalg.lstsq(rows.jacobian / scale, -rows.residuals, rcond=1e-14)[0] / scale

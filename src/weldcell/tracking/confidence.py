"""How probable it is that a feature is right: the joint is the right one, and the feature is within 0.15 mm.

Errors have heavier tails than their sigma says, for sigma knows the noise but not what was mistaken for an edge, and
the less so the smaller it is. So the logarithm of the odds is taken as a parabola in n = ln(0.15 mm / sigma), and
linear in the logarithm of the support; the weights are those of a logistic regression. The share of explained points
and the margin over rivals decide which joint is accepted at all; beyond that they did not tell right features from
wrong ones, so they have no weight. Two like joints side by side are therefore not told apart by the confidence, but by
the gate.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from weldcell.tracking.found import Trust
from weldcell.tracking.section import Corner

RIGHT_WITHIN_M = 1.5e-4
"""A feature this close to the true one serves a weld of a millimetre's wire."""
WEIGHTS = np.array([-0.74, 0.29, 0.68, 0.25])
"""Of 1, n, n^2 and ln(support). Fitted by `python -m benchmarks.confidence`: simulated pictures of
every kind of joint at all levels of noise, with arc, spatter and strays, seeds 1 to 6."""
_LEAST_SIGMA_M, _MOST_SIGMA_M = 1e-6, 1.85e-4  # beyond the latter the parabola would rise again
_USUAL_SUPPORT = 50


def confidence(corners: Sequence[Corner], trust: Trust | None) -> Float[np.ndarray, "k"]:
    """Probability for each corner that it is right; without grounds the support of a usual joint is taken."""
    support = _USUAL_SUPPORT if trust is None else trust.support
    sigma_m = np.array([corner.sigma_m for corner in corners])
    return probability(grounds(sigma_m, np.full(len(sigma_m), float(support))))


def grounds(sigma_m: Float[np.ndarray, "n"], support: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 4"]:
    """What the weights weigh, one row a feature; support as in `Trust`."""
    nearness = np.log(RIGHT_WITHIN_M / np.clip(sigma_m, _LEAST_SIGMA_M, _MOST_SIGMA_M))
    return np.column_stack([np.ones(len(sigma_m)), nearness, nearness**2, np.log(np.maximum(support, 1.0))])


def probability(rows: Float[np.ndarray, "n k"], weights: Float[np.ndarray, "k"] = WEIGHTS) -> Float[np.ndarray, "n"]:
    """Probability of each row of grounds."""
    return np.asarray(1 / (1 + np.exp(-(rows @ weights))))

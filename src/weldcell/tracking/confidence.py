"""How probable it is that a feature is right: the joint is the right one, and the feature is within 0.15 mm."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from weldcell.tracking.found import Trust
from weldcell.tracking.section import Corner

RIGHT_WITHIN_M = 1.5e-4
"""A feature this close to the true one serves a weld of a millimetre's wire."""
_OFFSET = -3.0
_EXPLAINED_WEIGHT = 6.0
_MARGIN_WEIGHT = 2.0
_SUPPORT_WEIGHT = 1.0
_FULL_SUPPORT = 30


def confidence(corners: Sequence[Corner], trust: Trust | None) -> Float[np.ndarray, "k"]:
    """Probability for each corner that it is right.

    The joint's is a logistic curve of its grounds; its weights were chosen on fabricated profiles with so many strays
    that joints were lost. A corner's error is taken as normal with equal strength in both directions, so that
    P(|e| < r) = 1 - exp(-r^2 / sigma^2).
    """
    sigma = np.array([corner.sigma_m for corner in corners])
    within = 1 - np.exp(-((RIGHT_WITHIN_M / np.maximum(sigma, 1e-9)) ** 2))
    return within * _joint_is_right(trust)


def _joint_is_right(trust: Trust | None) -> float:
    if trust is None:
        return 1.0
    support = min(trust.support / _FULL_SUPPORT, 1.0)
    score = _EXPLAINED_WEIGHT * trust.explained + _MARGIN_WEIGHT * trust.margin + _SUPPORT_WEIGHT * support
    return float(1 / (1 + np.exp(-(_OFFSET + score))))

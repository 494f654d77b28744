"""Quantiles of a handful of values: NumPy's own spend ten times as long on what these may be."""

import numpy as np
from jaxtyping import Float


def quantile(values: Float[np.ndarray, "n"], share: float) -> float:
    """What this share of at least one number lies below, linear between two of them; none of them is NaN."""
    ordered, place = np.sort(values), share * (len(values) - 1)
    below = int(place)
    low, high = float(ordered[below]), float(ordered[min(below + 1, len(values) - 1)])
    return low + (place - below) * (high - low)


def upper_median(values: Float[np.ndarray, "n"]) -> float:
    """The median of at least one number, or the larger one of the middle two; it may reorder them, and is faster."""
    middle = len(values) // 2
    values.partition(middle)
    return float(values[middle])


def median(values: Float[np.ndarray, "n"]) -> float:
    """The median of at least one number, none of them NaN."""
    return quantile(values, 0.5)

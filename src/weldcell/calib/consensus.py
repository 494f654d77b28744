"""Which rows of a measurement agree with each other, where up to three in ten may be grossly wrong.

Least trimmed squares (Rousseeuw 1984, Least median of squares regression): the model is fitted to many small
subsets of rows, each time improved on the rows that it fits best (Rousseeuw, van Driessen 2006, Computing LTS
regression, the C-step), and the one whose best rows fit best wins. Rows far outside its spread are wrong ones.
"""

from collections.abc import Callable
from itertools import combinations
from math import comb

import numpy as np
from jaxtyping import Bool, Float, Int

WRONG_SHARE = 0.3
FEWEST_AGREEING = 4  # of six unknowns: three rows leave three equations, which good rows fail by chance
_SUBSET = 3
_MOST_SUBSETS = 1000  # with 3 wrong in 10, a third of all subsets is sound
_IMPROVED = 10  # of the subsets, the best are improved
_STEPS = 3
_GATE_RATIO = 4.0  # times the worst of the best rows
_FLOOR_M = 1e-6  # misses below this are rounding

Misses = Callable[[Int[np.ndarray, "k"]], Float[np.ndarray, "n"]]
"""Fits the model to some rows and says by how much every row misses it (m)."""


def most_wrong(count: int) -> int:
    """How many wrong rows can be told among so many."""
    return max(min(int(WRONG_SHARE * count), count - FEWEST_AGREEING), 0)


def agreeing(misses: Misses, count: int) -> Bool[np.ndarray, "n"]:
    """The rows that agree; all of them where they are too few to tell. Deterministic."""
    if most_wrong(count) == 0:
        return np.ones(count, dtype=bool)
    trusted = count - most_wrong(count)
    fitted = sorted((misses(subset) for subset in _subsets(count)), key=lambda missed: _trimmed(missed, trusted))
    improved = [_improve(misses, missed, trusted) for missed in fitted[:_IMPROVED]]
    return _gated(misses, min(improved, key=lambda missed: _trimmed(missed, trusted)), trusted)


def _improve(misses: Misses, missed: Float[np.ndarray, "n"], trusted: int) -> Float[np.ndarray, "n"]:
    for _ in range(_STEPS):
        missed = misses(np.sort(np.argsort(missed, kind="stable")[:trusted]))
    return missed


def _gated(misses: Misses, missed: Float[np.ndarray, "n"], trusted: int) -> Bool[np.ndarray, "n"]:
    """All rows near the best ones; fitted again with them, for good rows just outside to come back."""
    good = np.zeros(len(missed), dtype=bool)
    for _ in range(_STEPS):
        gate_m = max(_GATE_RATIO * np.sort(missed)[trusted - 1], _FLOOR_M)
        if np.array_equal(good, missed <= gate_m):
            break
        good = missed <= gate_m
        missed = misses(np.flatnonzero(good))
    return good


def _trimmed(missed: Float[np.ndarray, "n"], trusted: int) -> float:
    return float(np.sum(np.sort(missed)[:trusted] ** 2))


def _subsets(count: int) -> Int[np.ndarray, "k 3"]:
    """All subsets, or as many by chance; always the same chance, for the answer to depend on the data alone."""
    if comb(count, _SUBSET) <= _MOST_SUBSETS:
        return np.array(list(combinations(range(count), _SUBSET)))
    rng = np.random.default_rng(0)
    return np.argsort(rng.random((_MOST_SUBSETS, count)), axis=1)[:, :_SUBSET]

"""Pieces of a stripe: runs of places that hold together."""

import numpy as np
from jaxtyping import Bool


def in_long_pieces(broken: Bool[np.ndarray, "gaps"], fewest: int) -> Bool[np.ndarray, "n"]:
    """Which of n > 0 places are in a piece of so many at least; `broken` says whether one ends after each place."""
    ends = np.concatenate([[-1], np.flatnonzero(broken), [len(broken)]])
    lengths = ends[1:] - ends[:-1]
    return np.repeat(lengths >= fewest, lengths)

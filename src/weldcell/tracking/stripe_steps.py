"""Columns beside a step of the stripe: the search sees pairs of columns, and an edge may go between the two of one."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float32, Int, Shaped

from weldcell.tracking.stripe_search import CELL_COLUMNS, RoughStripe, picked

_STEP_PX = 16.0
_FARTHEST_COLUMNS = 2 * CELL_COLUMNS  # between cells that a step parts; one that nothing was found in may lie between
_HALF_ROWS = np.arange(-4, 5)[:, None]


def parted_at_steps(image: Shaped[np.ndarray, "height width"], rough: RoughStripe) -> RoughStripe:
    """The rough stripe, but columns beside a step that are brighter where the other side leads are put there."""
    columns, centre = rough.columns, rough.centre_px
    jump_px, gap = centre[1:] - centre[:-1], columns[1:] - columns[:-1]
    broken = (np.abs(jump_px) > _STEP_PX) & (gap < _FARTHEST_COLUMNS)
    before = np.flatnonzero(broken)
    if len(before) == 0:
        return rough
    beside = np.arange(CELL_COLUMNS)
    own = np.concatenate([before[:, None] - beside, before[:, None] + 1 + beside]).ravel()
    other = np.repeat(np.concatenate([before + 1, before]), CELL_COLUMNS)
    inside = (own >= 0) & (own < len(columns))
    own, other = own[inside], other[inside]
    at_other, at_own = _light(image, rough, columns[np.tile(own, 2)], np.concatenate([other, own])).reshape(2, -1)
    better = at_other > at_own
    source = np.arange(len(columns))
    source[own[better]] = other[better]
    moved = {name: values[source] for name, values in vars(rough).items() if np.ndim(values) and name != "columns"}
    return replace(rough, **moved)


def _light(
    image: Shaped[np.ndarray, "height width"],
    rough: RoughStripe,
    columns: Int[np.ndarray, "k"],
    at: Int[np.ndarray, "k"],
) -> Float32[np.ndarray, "k"]:
    """Light of columns where the rough stripe's entries `at` are, above these ones' background."""
    rows = np.rint(rough.centre_px[at]).astype(np.int64)
    grey = picked(image, rows, _HALF_ROWS, columns)
    return np.asarray(np.add.reduce(grey) - len(_HALF_ROWS) * rough.background_grey[at])

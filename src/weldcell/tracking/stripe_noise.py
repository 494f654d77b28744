"""How noisy the picture of a stripe is: beside it, and in its own light, which the centre's roughness tells."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from weldcell.tracking.cell_noise import QUANTISATION_GREY
from weldcell.tracking.quantiles import upper_median
from weldcell.tracking.stripe_search import picked

DEFAULT_SPECKLE_CONTRAST = 0.45
"""Taken where a picture has too few columns to measure its own."""
_NOISE_ROWS = np.concatenate([np.arange(-26, -16), np.arange(17, 27)])[:, None]
_NOISE_STEP = 8  # every eighth column tells enough
_NOISE_BLOCK = 20
_ROUGHNESS_STEP = 4  # columns; wider apart than the speckle's grain
_ROUGHNESS_FEWEST = 60
_CHI2_MEDIAN = 0.4549  # of one degree of freedom


@dataclass(frozen=True, kw_only=True)
class Spread:
    """What a centre scatters by."""

    noise_variance: Float32[np.ndarray, "n"]
    """By the background's noise."""
    own_variance: Float32[np.ndarray, "n"]
    """By a noise as large as the stripe's light itself: speckle of contrast 1."""


def noise_near(
    image: Shaped[np.ndarray, "height width"], row: Int[np.ndarray, "n"], columns: Int[np.ndarray, "n"]
) -> Float32[np.ndarray, "n"]:
    """Standard deviation of the background on both sides, as the median over blocks of columns.

    A slope of the background has no part in differences of neighbours; those of white noise have twice its variance.
    """
    some = slice(None, None, _NOISE_STEP)
    grey = picked(image, row[some], _NOISE_ROWS, columns[some])
    differences = grey[1:] - grey[:-1]
    differences[len(_NOISE_ROWS) // 2 - 1] = 0  # across the stripe
    variance = np.add.reduce(differences * differences) / np.float32(2 * (len(_NOISE_ROWS) - 2))
    blocks = max(1, len(variance) // _NOISE_BLOCK)
    size = len(variance) // blocks
    medians = np.partition(variance[: blocks * size].reshape(blocks, size), size // 2, axis=1)[:, size // 2]
    by_block = np.sqrt(np.maximum(medians, np.float32(QUANTISATION_GREY**2)))
    return by_block[np.minimum(np.arange(len(row)) // (_NOISE_STEP * size), blocks - 1)]


def excess_noise(
    columns: Int[np.ndarray, "n"],
    row: Float[np.ndarray, "n"],
    spread: Spread,
    good: Bool[np.ndarray, "n"],
    given_contrast: float | None,
) -> float:
    """B, which explains the stripe's roughness from column to column.

    Third differences of columns 4 px apart: straight and round stripes have none, and speckle of neighbours is alike.
    Their squares have the mean s1 + 9 s2 + 9 s3 + s4 and, for normal noise, the median 0.4549 of it. Solved for B at
    each place, the median is B whatever the brightness does; corners and strays do not move a median.
    """
    if given_contrast is not None:
        return given_contrast**2
    columns, row = columns[good], row[good]
    step = _ROUGHNESS_STEP
    if len(row) < 3 * step + _ROUGHNESS_FEWEST:
        return DEFAULT_SPECKLE_CONTRAST**2
    places = [slice(k * step, len(row) - (3 - k) * step, 2) for k in range(4)]  # every other one tells as much
    together = columns[places[3]] - columns[places[0]] == 3 * step
    if np.count_nonzero(together) < _ROUGHNESS_FEWEST:
        return DEFAULT_SPECKLE_CONTRAST**2
    rough = (row[places[3]] - row[places[0]] - 3 * (row[places[2]] - row[places[1]])) ** 2 / _CHI2_MEDIAN
    noise, own = (
        part[places[0]] + part[places[3]] + 9 * (part[places[1]] + part[places[2]])
        for part in (spread.noise_variance[good], spread.own_variance[good])
    )
    values = ((rough - noise) / np.maximum(own, 1e-12))[together]
    return max(upper_median(values), 0.0)

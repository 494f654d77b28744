"""How noisy the cells of a shrunk picture are, whatever its light: from mixed second differences of neighbours.

Those do not see slopes of the light, and have four times a cell's variance. What is much larger is a stripe or an edge.
"""

from dataclasses import dataclass
from statistics import median

import numpy as np
from jaxtyping import Float, Float32, Shaped

QUANTISATION_GREY = float(1 / np.sqrt(12))
"""Rounding to whole levels: the least noise a picture can have."""
_LEVELS, _SAMPLES = 8, 48  # of brightness; rows and columns that tell the noise
_SATURATED_SHARE = 0.98
_OUTLYING, _ROUNDING_GREY2 = 2.8, 1.5**2  # so much is rounding


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """A cell's noise: its variance is `read_grey2` + `shot_grey` times its level (grey levels)."""

    read_grey2: float
    shot_grey: float

    def sigma(self, level: Shaped[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Standard deviation at these levels."""
        return np.sqrt(self.read_grey2 + self.shot_grey * level)


@dataclass(frozen=True, kw_only=True)
class CellNoise:
    """Some thousand cells all over a picture."""

    level: Float32[np.ndarray, "n"]
    """Their light (grey levels)."""
    variance: Float32[np.ndarray, "n"]
    """What each says of a cell's variance."""

    def sigma(self) -> float:
        """Standard deviation of most cells."""
        return float(np.sqrt(_trimmed_mean(self.variance[None])[0])) if len(self.variance) else QUANTISATION_GREY

    def model(self) -> NoiseModel:
        """How the noise grows with the light, where it is not saturated: medians of what eight classes of it tell."""
        least, order = QUANTISATION_GREY**2, np.argsort(self.level)
        dark = np.count_nonzero(self.level < _SATURATED_SHARE * self.level.max(initial=0))
        size = dark // _LEVELS
        if size == 0:
            return NoiseModel(read_grey2=least, shot_grey=0.0)
        classes = order[: size * _LEVELS].reshape(_LEVELS, size)
        levels, variances = self.level[classes].mean(axis=1), _trimmed_mean(self.variance[classes])
        slopes = (variances[1:] - variances[0]) / np.maximum(levels[1:] - levels[0], 1.0)
        shot = max(median(slopes.tolist()), 0.0)
        return NoiseModel(read_grey2=max(median((variances - shot * levels).tolist()), least), shot_grey=shot)


def cell_noise(cells: Shaped[np.ndarray, "rows columns"]) -> CellNoise:
    """The noise of a picture of at least 2 x 2 cells."""
    height, width = (size - 1 for size in cells.shape)
    down, right = max(1, height // _SAMPLES), max(1, width // _SAMPLES)
    here, beside, below, across = (
        cells[a : height + a : down, b : width + b : right].astype(np.float32).ravel() for a in (0, 1) for b in (0, 1)
    )
    return CellNoise(level=(here + across) / 2, variance=np.square(here - beside - below + across) / 4)


def _trimmed_mean(variances: Float32[np.ndarray, "k n"]) -> Float32[np.ndarray, "k"]:
    """Mean of each row, without outliers."""
    mean = variances.mean(axis=1)
    for _ in range(2):
        kept = variances <= np.maximum(_OUTLYING**2 * mean, _ROUNDING_GREY2)[:, None]
        mean = (variances * kept).sum(axis=1) / np.maximum(kept.sum(axis=1), 1)
    return np.asarray(mean, np.float32)

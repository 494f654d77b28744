"""Stripe centres without a picture: what an extractor would find, from the exact stripe and its noise's statistics.

The extractor keeps the strongest crossing of each column, if it stands out of the noise and is neither as narrow as a
hot pixel nor as wide as a patch of light; `tracking` has the same rules, and a test compares both. What a column holds
of the stripe's light goes with its speckle, a gamma variable: summed under a Gaussian of width s, speckle of contrast C
and grain G across leaves the squared contrast C^2 G / sqrt(G^2 + 2 s^2).
"""

import numpy as np
from jaxtyping import Bool, Float

from weldcell.cell.optics import CameraModel
from weldcell.cell.profile import Stripe
from weldcell.sensor_sim.centre_noise import CentreNoise
from weldcell.sensor_sim.speckle import correlated_rows, gamma_factors
from weldcell.sensor_sim.stripe import StripePieces

_SIGNAL_SIGMAS = 6.0  # of the light under the stripe's own Gaussian
_SEARCH_LEVELS, _SEARCH_SIGMAS = (
    1.0,
    3.5,
)  # faint stretches beside sure ones included: a block of 8 rows and 2 columns stands out by more; of half a block
_BLOCK_ROWS, _CELL_PIXELS = 8, 8
_CELL_ROUNDING = 1 / 8  # variance (levels^2): two averages of whole numbers, rounded
_NARROWEST_WEIGHT_PX2 = 0.7
_WIDTH_PX = (0.6, 5.5)
_EDGE_SIGMAS = 2.7  # a stripe nearer to the picture's border is cut off


def found_centres(
    pieces: StripePieces,
    ambient_grey: Float[np.ndarray, "k"],
    contrast: Float[np.ndarray, "k"],
    camera: CameraModel,
    noise: CentreNoise,
    rng: np.random.Generator,
) -> Stripe:
    """The stripe with scattered centres and their predicted sigma; `contrast` is the speckle's, each for a piece."""
    length_px = camera.height_px if pieces.along == "rows" else camera.width_px
    margin = _EDGE_SIGMAS * pieces.sigma_px
    inside = (pieces.centre_px > margin) & (pieces.centre_px < length_px - 1 - margin)
    narrow = (pieces.sigma_px > _WIDTH_PX[0]) & (pieces.sigma_px < _WIDTH_PX[1])
    kept = _strongest(pieces, np.flatnonzero(inside & narrow))
    kept = kept[_is_clear(pieces, kept, ambient_grey[kept], contrast[kept], noise, rng)]
    peak = np.minimum(pieces.amplitude_grey[kept], noise.chip.full_well_electrons / noise.chip.electrons_per_light)
    sigma = noise.sigma(peak, pieces.sigma_px[kept], ambient_grey[kept], contrast[kept])
    cut, centre = pieces.cut_px[kept], pieces.centre_px[kept]
    found = centre + noise.draw_px(cut, sigma, rng, centre, pieces.sigma_px[kept])
    u, v = (cut.astype(float), found) if pieces.along == "rows" else (found, cut.astype(float))
    return Stripe(u_px=u, v_px=v, sigma_px=sigma.total_px)


def _strongest(pieces: StripePieces, chosen: np.ndarray) -> np.ndarray:
    """The brightest of the chosen pieces of each cut, in the order of the cuts."""
    light = pieces.amplitude_grey[chosen] * pieces.sigma_px[chosen]
    order = chosen[np.lexsort((-light, pieces.cut_px[chosen]))]
    first = np.diff(pieces.cut_px[order], prepend=-1) != 0
    return order[first]


def _is_clear(
    pieces: StripePieces,
    kept: np.ndarray,
    ambient_grey: Float[np.ndarray, "n"],
    contrast: Float[np.ndarray, "n"],
    noise: CentreNoise,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "n"]:
    """Whether the search sees the light of a column and its neighbour, and the column's own is clear of the noise."""
    if len(kept) == 0:
        return np.zeros(0, bool)
    chip, width_px = noise.chip, pieces.sigma_px[kept]
    levels_per_grey = chip.electrons_per_light * chip.levels_per_electron
    peak = pieces.amplitude_grey[kept] * _speckled(pieces.cut_px[kept], width_px, contrast, noise, rng)
    peak_levels = np.minimum(peak * levels_per_grey, chip.white_level)
    noise_levels = chip.levels_per_electron * np.sqrt(noise.dark_variance + ambient_grey * chip.electrons_per_light)
    weight_px2 = np.maximum(width_px**2, _NARROWEST_WEIGHT_PX2)
    weighted = peak_levels * np.sqrt(2 * np.pi / (1 / width_px**2 + 1 / weight_px2))
    stands_out = weighted > _SIGNAL_SIGMAS * noise_levels * (np.pi * weight_px2) ** 0.25
    block = peak_levels * np.sqrt(2 * np.pi) * width_px / _BLOCK_ROWS
    pair = pieces.cut_px[kept] // 2
    index = pair - pair.min()
    of_pair = np.bincount(index, block)[index] / 2
    cell_levels = np.sqrt(noise_levels**2 / _CELL_PIXELS + _CELL_ROUNDING)
    return stands_out & (of_pair > _SEARCH_LEVELS + _SEARCH_SIGMAS * cell_levels)


def _speckled(
    cut_px: np.ndarray,
    width_px: Float[np.ndarray, "n"],
    contrast: Float[np.ndarray, "n"],
    noise: CentreNoise,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n"]:
    """Each column's light over its mean."""
    grain_px = noise.speckle.across_px
    of_column = contrast * np.sqrt(grain_px / np.hypot(grain_px, np.sqrt(2) * width_px))
    field = correlated_rows((1, int(cut_px.max()) + 1), noise.speckle, rng)[:, cut_px]
    return gamma_factors(field, of_column[None])[0]

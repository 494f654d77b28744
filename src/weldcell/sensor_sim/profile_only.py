"""Stripe centres without a picture: what an extractor would find, from the exact stripe and its noise's statistics.

The extractor keeps the strongest crossing of each column, if it stands out of the noise and is neither as narrow as a
hot pixel nor as wide as a patch of light; `tracking` has the same rules, and a test compares both.
"""

import numpy as np
from jaxtyping import Float

from weldcell.cell.optics import CameraModel
from weldcell.cell.profile import Stripe
from weldcell.sensor_sim.centre_noise import CentreNoise
from weldcell.sensor_sim.stripe import StripePieces

_FAINTEST_SIGMAS = 8.0  # of a column's summed light
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
    full = noise.chip.full_well_electrons / noise.chip.electrons_per_light
    peak = np.minimum(pieces.amplitude_grey, full)
    margin = _EDGE_SIGMAS * pieces.sigma_px
    inside = (pieces.centre_px > margin) & (pieces.centre_px < length_px - 1 - margin)
    narrow = (pieces.sigma_px > _WIDTH_PX[0]) & (pieces.sigma_px < _WIDTH_PX[1])
    background = np.sqrt(noise.dark_variance + ambient_grey * noise.chip.electrons_per_light)
    total = np.sqrt(2 * np.pi) * pieces.sigma_px * peak * noise.chip.electrons_per_light
    clear = total > _FAINTEST_SIGMAS * background * np.sqrt(2 * _EDGE_SIGMAS * pieces.sigma_px)
    kept = _strongest(pieces, np.flatnonzero(inside & narrow & clear))
    sigma = noise.sigma(peak[kept], pieces.sigma_px[kept], ambient_grey[kept], contrast[kept])
    cut, centre = pieces.cut_px[kept], pieces.centre_px[kept]
    found = centre + noise.draw_px(cut, sigma, rng)
    u, v = (cut.astype(float), found) if pieces.along == "rows" else (found, cut.astype(float))
    return Stripe(u_px=u, v_px=v, sigma_px=sigma.total_px)


def _strongest(pieces: StripePieces, chosen: np.ndarray) -> np.ndarray:
    """The brightest of the chosen pieces of each cut, in the order of the cuts."""
    light = pieces.amplitude_grey[chosen] * pieces.sigma_px[chosen]
    order = chosen[np.lexsort((-light, pieces.cut_px[chosen]))]
    first = np.diff(pieces.cut_px[order], prepend=-1) != 0
    return order[first]

"""Drawing the stripe's pieces as grey levels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from weldcell.sensor_sim.stripe import StripePieces

_REACH_SIGMAS = 4.0  # exp(-8): 0.07 of 200 grey levels
_NARROWEST_BAND_PX = 4


@dataclass(frozen=True, kw_only=True)
class LaserLight:
    """Grey levels of the laser's light in the rows of the picture that it reaches."""

    first_row: int
    """Row of the picture that the band starts at."""
    grey: Float[np.ndarray, "rows width"]
    """Grey levels (float32); no rows if there is no light."""


def draw_stripe(pieces: StripePieces, width_px: int, height_px: int) -> LaserLight:
    """The light of all pieces: each adds a Gaussian along its column, out to four sigma."""
    reach_px = np.ceil(_REACH_SIGMAS * pieces.sigma_px)
    low = np.clip(np.floor(pieces.v_px - reach_px), 0, height_px)
    high = np.clip(np.ceil(pieces.v_px + reach_px) + 1, 0, height_px)
    in_picture = high > low
    if not in_picture.any():
        return LaserLight(first_row=0, grey=np.zeros((0, width_px), np.float32))
    first_row, last_row = int(low[in_picture].min()), int(high[in_picture].max())
    grey = np.zeros((last_row - first_row, width_px), np.float32)
    bands = np.maximum(2 ** np.ceil(np.log2(np.maximum(reach_px, 1))), _NARROWEST_BAND_PX).astype(int)
    for band_px in np.unique(bands[in_picture]):  # a handful of widths, each drawn at once
        _add_band(grey, first_row, pieces, in_picture & (bands == band_px), int(band_px))
    return LaserLight(first_row=first_row, grey=grey)


def _add_band(
    grey: Float[np.ndarray, "rows width"],
    first_row: int,
    pieces: StripePieces,
    chosen: Bool[np.ndarray, "k"],
    band_px: int,
) -> None:
    """Add the chosen pieces, `band_px` rows to either side of their centres."""
    centre = np.rint(pieces.v_px[chosen])
    offset = np.arange(-band_px, band_px + 1)
    away_px = offset - (pieces.v_px[chosen] - centre)[:, None]
    sigma_px = pieces.sigma_px[chosen, None]
    light = pieces.amplitude_grey[chosen, None] * np.exp(-0.5 * (away_px / sigma_px) ** 2)
    rows = centre.astype(np.int64)[:, None] + offset - first_row
    columns = np.broadcast_to(pieces.u_px[chosen, None], rows.shape)
    inside = (rows >= 0) & (rows < len(grey))
    np.add.at(grey, (rows[inside], columns[inside]), light[inside].astype(np.float32))

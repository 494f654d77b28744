"""Drawing the stripe's pieces as grey levels."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from weldcell.sensor_sim.stripe import StripePieces

_REACH_SIGMAS = 4.0  # exp(-8): 0.07 of 200 grey levels
_NARROWEST_BAND_PX = 4


@dataclass(frozen=True, kw_only=True)
class LaserLight:
    """Grey levels of the laser's light in the part of the picture that it reaches."""

    first_row: int
    """Row of the picture that the part starts at."""
    first_column: int = 0
    """Column of the picture that the part starts at."""
    grey: Float[np.ndarray, "rows columns"]
    """Grey levels (float32); empty if there is no light."""

    @property
    def window(self) -> tuple[slice, slice]:
        """The part's rows and columns in the picture."""
        rows, columns = self.grey.shape
        return slice(self.first_row, self.first_row + rows), slice(self.first_column, self.first_column + columns)


def draw_stripe(pieces: StripePieces, width_px: int, height_px: int) -> LaserLight:
    """The light of all pieces: each adds a Gaussian along its cut, out to four sigma.

    The part of the picture is a band of whole rows for a stripe along rows, of whole columns for one along columns.
    """
    if pieces.along == "rows":
        first, grey = _draw(pieces, width_px, height_px)
        return LaserLight(first_row=first, grey=grey)
    first, turned = _draw(pieces, height_px, width_px)
    return LaserLight(first_row=0, first_column=first, grey=turned.T)


def _draw(pieces: StripePieces, cuts: int, cut_length_px: int) -> tuple[int, Float[np.ndarray, "length cuts"]]:
    """Where the light begins on the cuts, and its grey levels (float32) from there on: a column for each cut."""
    reach_px = np.ceil(_REACH_SIGMAS * pieces.sigma_px)
    low = np.clip(np.floor(pieces.centre_px - reach_px), 0, cut_length_px)
    high = np.clip(np.ceil(pieces.centre_px + reach_px) + 1, 0, cut_length_px)
    in_picture = high > low
    if not in_picture.any():
        return 0, np.zeros((0, cuts), np.float32)
    first, last = int(low[in_picture].min()), int(high[in_picture].max())
    layout: Literal["C", "F"] = "C" if pieces.along == "rows" else "F"  # in memory always as in the picture
    grey = np.zeros((last - first, cuts), np.float32, order=layout)
    bands = np.maximum(2 ** np.ceil(np.log2(np.maximum(reach_px, 1))), _NARROWEST_BAND_PX).astype(int)
    for band_px in np.unique(bands[in_picture]):  # a handful of widths, each drawn at once
        _add_band(grey, first, pieces, in_picture & (bands == band_px), int(band_px))
    return first, grey


def _add_band(
    grey: Float[np.ndarray, "length cuts"],
    first: int,
    pieces: StripePieces,
    chosen: Bool[np.ndarray, "k"],
    band_px: int,
) -> None:
    """Add the chosen pieces, `band_px` pixels to either side of their centres."""
    centre = np.rint(pieces.centre_px[chosen])
    offset = np.arange(-band_px, band_px + 1)
    away_px = offset - (pieces.centre_px[chosen] - centre)[:, None]
    sigma_px = pieces.sigma_px[chosen, None]
    light = pieces.amplitude_grey[chosen, None] * np.exp(-0.5 * (away_px / sigma_px) ** 2)
    places = centre.astype(np.int64)[:, None] + offset - first
    cuts = np.broadcast_to(pieces.cut_px[chosen, None], places.shape)
    inside = (places >= 0) & (places < len(grey))
    np.add.at(grey, (places[inside], cuts[inside]), light[inside].astype(np.float32))

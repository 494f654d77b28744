"""Straight streaks of light, drawn without steps and with exactly their light.

A disc of light that moves evenly along a segment of length L during the exposure, blurred to a Gaussian of sigma s,
leaves E / L g(n) (Phi(a / s) - Phi((a - L) / s)) at the distances a along and n across the segment, with g the normal
density of sigma s: its sum is the light E whatever the length.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import ndtr

_REACH_SIGMAS = 4.0
_SHORTEST_SIGMAS = 1e-4  # shorter streaks are drawn this long, which is round
_NARROWEST_BAND_PX = 4
_FAINTEST_GREY = 0.2


@dataclass(frozen=True, kw_only=True)
class Streaks:
    """Segments in the picture, along each of which a blurred spot moves evenly."""

    start_px: Float[np.ndarray, "n 2"]
    """Where the spot starts (u, v)."""
    stop_px: Float[np.ndarray, "n 2"]
    """Where it ends."""
    sigma_px: Float[np.ndarray, "n"]
    """Size of the spot, one sigma."""
    light_grey: Float[np.ndarray, "n"]
    """Grey levels that all pixels of the streak sum to."""

    def chosen(self, which: np.ndarray) -> "Streaks":
        """Some of them."""
        return Streaks(**{field.name: getattr(self, field.name)[which] for field in fields(self)})


def draw_streaks(picture: Float[np.ndarray, "height width"], streaks: Streaks) -> None:
    """Add streaks to a picture; those whose brightest pixel stays below 0.2 levels are left out."""
    streaks = streaks.chosen(_worth_it(streaks, picture.shape))
    steep = np.abs(streaks.stop_px - streaks.start_px) @ [1.0, -1.0] < 0
    _add_flat(picture, streaks.chosen(~steep))
    _add_flat(picture.T, _flipped(streaks.chosen(steep)))


def _worth_it(streaks: Streaks, shape: tuple[int, ...]) -> Bool[np.ndarray, "n"]:
    length_px = np.linalg.norm(streaks.stop_px - streaks.start_px, axis=1)
    sigma_px = streaks.sigma_px
    peak = streaks.light_grey / (2 * np.pi * sigma_px**2 + np.sqrt(2 * np.pi) * sigma_px * length_px)
    reach_px = _REACH_SIGMAS * sigma_px[:, None]
    low = np.minimum(streaks.start_px, streaks.stop_px) - reach_px
    high = np.maximum(streaks.start_px, streaks.stop_px) + reach_px
    return (peak > _FAINTEST_GREY) & np.all((high > -1) & (low < [shape[1], shape[0]]), axis=1)


def _flipped(streaks: Streaks) -> Streaks:
    """The streaks with u and v exchanged."""
    return replace(streaks, start_px=streaks.start_px[:, ::-1], stop_px=streaks.stop_px[:, ::-1])


def _add_flat(picture: Float[np.ndarray, "height width"], streaks: Streaks) -> None:
    """Add streaks that run rather along u than along v, in groups of similar width."""
    step = streaks.stop_px - streaks.start_px
    slope = np.divide(step[:, 1], step[:, 0], out=np.zeros(len(step)), where=step[:, 0] != 0)
    reach_px = np.ceil(_REACH_SIGMAS * streaks.sigma_px * np.hypot(1, slope))
    bands = np.maximum(2 ** np.ceil(np.log2(reach_px)), _NARROWEST_BAND_PX).astype(int)
    for band_px in np.unique(bands):
        _add_band(picture, streaks.chosen(bands == band_px), slope[bands == band_px], int(band_px))


def _add_band(
    picture: Float[np.ndarray, "height width"], streaks: Streaks, slope: Float[np.ndarray, "n"], band_px: int
) -> None:
    """Add streaks column by column, `band_px` rows to either side of their middle lines."""
    reach_px = _REACH_SIGMAS * streaks.sigma_px
    ends_u = np.stack([streaks.start_px[:, 0], streaks.stop_px[:, 0]])
    low = np.clip(np.floor(ends_u.min(axis=0) - reach_px), 0, picture.shape[1]).astype(np.int64)
    high = np.clip(np.ceil(ends_u.max(axis=0) + reach_px) + 1, 0, picture.shape[1]).astype(np.int64)
    count = np.maximum(high - low, 0)
    which = np.repeat(np.arange(len(low)), count)
    column = low[which] + np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    du = column - streaks.start_px[which, 0]
    middle = streaks.start_px[which, 1] + slope[which] * du
    row = np.rint(middle).astype(np.int64)[:, None] + np.arange(-band_px, band_px + 1)
    light = _section(streaks, which, du, row - streaks.start_px[which, 1, None])
    inside = (row >= 0) & (row < picture.shape[0]) & (light > 0)
    columns = np.broadcast_to(column[:, None], row.shape)
    np.add.at(picture, (row[inside], columns[inside]), light[inside].astype(np.float32))


def _section(
    streaks: Streaks, which: np.ndarray, du: Float[np.ndarray, "m"], dv: Float[np.ndarray, "m rows"]
) -> Float[np.ndarray, "m rows"]:
    """The streaks' light at pixels given from the streaks' starts, in units of sigma."""
    sigma_px = streaks.sigma_px
    step = (streaks.stop_px - streaks.start_px) / sigma_px[:, None]
    length = np.linalg.norm(step, axis=1)
    axis = np.divide(step, length[:, None], out=np.tile([1.0, 0.0], (len(step), 1)), where=length[:, None] > 0)
    length = np.maximum(length, _SHORTEST_SIGMAS)
    scale = streaks.light_grey / (sigma_px**2 * length * np.sqrt(2 * np.pi))
    du, dv = du[:, None] / sigma_px[which, None], dv / sigma_px[which, None]
    axis_u, axis_v = axis[which, 0, None], axis[which, 1, None]
    along, across = du * axis_u + dv * axis_v, dv * axis_u - du * axis_v
    covered = ndtr(along) - ndtr(along - length[which, None])
    return scale[which, None] * np.exp(-0.5 * across**2) * covered

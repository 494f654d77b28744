"""Roughly where the stripe runs: a search in the picture shrunk to cells of 4 rows and 2 columns.

A cell averages eight pixels, so the search costs an eighth and sees dimmer stripes than single pixels would show.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from weldcell.tracking.cell_noise import QUANTISATION_GREY, NoiseModel, cell_noise
from weldcell.tracking.stripe_faint import REACH_PX, beside
from weldcell.tracking.stripe_path import over_slopes, stripe_path
from weldcell.tracking.stripe_pieces import in_long_pieces

CELL_ROWS, CELL_COLUMNS = 4, 2
_SIDE_CELLS = (2, 3, 4)  # sides 8 to 16 px off: clear of a stripe of 3 px sigma, and not of a patch 24 px wide
_SEARCH_SNR = 6.0  # the largest of 200 000 noise values reaches 4.5 of its own sigma
_FAINT_SNR = 2.0  # beside what is seen
_CLEAR_SHARE = 0.95  # of cell columns that show the stripe: then nothing faint is looked for
_ROUNDING = 1.0  # two averages, each rounded to a level
_REACH_CELLS = 4  # a stripe's light is looked for in so many cells to either side
_NEAR_BACKGROUND_CELLS, _BACKGROUND_CELLS = (3, 4), (5, 6)  # 12 and 16 px off a narrow stripe; 20 and 24 off others
_NARROW_PX2 = 6.0
_FIRST_VARIANCE_PX2 = np.float32(16.0)
_LEAST_VARIANCE_PX2, _MOST_VARIANCE_PX2 = 0.5, 49.0
_MOST_SHIFT_PX = 8.0
_CELL_VARIANCE_PX2 = CELL_ROWS**2 / 12
_FEWEST_CELLS = 3  # in a row, for a piece off the path
_STEP_CELLS = 4  # a larger step from one cell column to the next parts two pieces
_END_CELLS = 2  # of the stripe's end: 4 px a px
_UNSHARED_PIXELS = 65536


@dataclass(frozen=True, kw_only=True)
class RoughStripe:
    """One entry for each picture column in which something stands out."""

    columns: Int[np.ndarray, "n"]
    centre_px: Float32[np.ndarray, "n"]
    """Row, right to a pixel or two."""
    variance_px2: Float32[np.ndarray, "n"]
    """Square of the stripe's sigma along the column."""
    background_grey: Float32[np.ndarray, "n"]
    """Level of the background at the stripe."""
    background_slope: Float32[np.ndarray, "n"]
    """Its rise with the row, in grey levels a pixel."""
    background_step: Float32[np.ndarray, "n"]
    """Background below the stripe minus background above it, grey levels."""
    background_apart_px: float
    """From the middle of the background above to the middle of that below."""


_OFFSET = np.arange(-max(_BACKGROUND_CELLS), max(_BACKGROUND_CELLS) + 2)[:, None]
_AWAY_PX = ((_OFFSET[:, 0] - 0.5) * CELL_ROWS).astype(np.float32)
_FIRST_WEIGHT = np.exp(-0.5 * _AWAY_PX**2 / _FIRST_VARIANCE_PX2) * (np.abs(_AWAY_PX) < (_REACH_CELLS + 1) * CELL_ROWS)
_MOMENTS = np.stack([_FIRST_WEIGHT, _FIRST_WEIGHT * _AWAY_PX, _FIRST_WEIGHT * _AWAY_PX**2])  # order 0, 1 and 2
_MOMENTS_OF_LEVEL, _MOMENTS_OF_SLOPE = _MOMENTS.sum(axis=1)[:, None], (_MOMENTS @ _AWAY_PX)[:, None]

LEVEL_BIAS = 0.2
"""How far the background's level lies below its mean, as a share of a pixel's noise: the darker of two cells."""
STEP_NOISE = 0.3
"""Standard deviation of the background's step, as a share of a pixel's noise (medians of five such values)."""


def search(image: Shaped[np.ndarray, "height width"]) -> RoughStripe | None:
    """Columns in which a place stands out against *both* its sides; None if there are none.

    An edge of the ambient picture is as bright as one of its sides, so it does not stand out.
    """
    cells = _shrunk(image)
    if min(cells.shape) < 2:
        return None
    cores = _mean(cells[:-1], cells[1:])
    response = cv2.subtract(cores, _brightest_side(cores))
    noise = cell_noise(cells)
    seen = response.max(axis=0) > _ROUNDING + _SEARCH_SNR * noise.sigma() / np.sqrt(2)
    is_clear, rows = np.count_nonzero(seen) >= _CLEAR_SHARE * len(seen), None
    if is_clear:
        rows = cv2.transpose(response).argmax(axis=1)  # along memory: faster than down the columns
    if rows is None or np.abs(np.diff(rows)).max(initial=0) > _STEP_CELLS:
        rows, seen = _along_path(cores, noise.model())
    found = np.flatnonzero(seen)
    return _measured(cells, rows[found], found) if len(found) else None


def _along_path(
    cores: Shaped[np.ndarray, "rows k"], noise: NoiseModel
) -> tuple[Int[np.ndarray, "k"], Bool[np.ndarray, "k"]]:
    """Rows and which cell columns are seen, by the best path through the picture."""
    response = over_slopes(cores)
    columns, rows = stripe_path(response, cores, noise)
    each = np.arange(response.shape[1])
    if len(columns) == 0:
        return np.zeros_like(each), np.zeros(len(each), bool)
    on_path = beside(response, columns, rows, REACH_PX // CELL_COLUMNS)
    rows, seen = on_path.rows, on_path.near & (_snr(response, cores, noise, each, on_path.rows) > _FAINT_SNR)
    # Off the path the stripe may be between its ends, such as on a narrow gap's bottom, and where a steep end goes on.
    off = np.flatnonzero(~seen)
    rows[off] = cv2.transpose(response)[off].argmax(axis=1)
    clear = np.zeros_like(seen)
    clear[off] = _snr(response, cores, noise, off, rows[off]) > _SEARCH_SNR
    inside = (each > columns[0]) & (each < columns[-1])
    return rows, seen | _in_pieces(rows, clear & inside) | _gone_on(rows, seen, clear)


def _gone_on(
    rows: Int[np.ndarray, "k"], seen: Bool[np.ndarray, "k"], clear: Bool[np.ndarray, "k"]
) -> Bool[np.ndarray, "k"]:
    """Which clear cell columns go on, one by one, from the first or the last one that is seen."""
    gone_on = np.zeros_like(seen)
    joined = np.abs(rows[1:] - rows[:-1]) <= _END_CELLS
    at = np.flatnonzero(seen)
    if len(at):
        after, before = slice(at[-1] + 1, None), slice(0, at[0])
        gone_on[after] = np.logical_and.accumulate(clear[after] & joined[at[-1] :])
        gone_on[before] = np.logical_and.accumulate((clear[before] & joined[: at[0]])[::-1])[::-1]
    return gone_on


def _in_pieces(rows: Int[np.ndarray, "k"], seen: Bool[np.ndarray, "k"]) -> Bool[np.ndarray, "k"]:
    """Which cell columns are seen together with some of their neighbours, at places that hold together."""
    apart = (np.abs(np.diff(rows)) > _STEP_CELLS) | ~seen[1:] | ~seen[:-1]
    return seen & in_long_pieces(apart, _FEWEST_CELLS)


def _snr(
    response: Shaped[np.ndarray, "rows k"],
    cores: Shaped[np.ndarray, "rows k"],
    noise: NoiseModel,
    columns: Int[np.ndarray, "n"],
    rows: Int[np.ndarray, "n"],
) -> Float[np.ndarray, "n"]:
    """How far these places stand out, in units of the noise there."""
    places = rows * response.shape[1] + columns
    sigma = np.maximum(noise.sigma(cores.ravel().take(places)), QUANTISATION_GREY)
    return (response.ravel().take(places) - _ROUNDING) * np.sqrt(2) / sigma


def _brightest_side(cores: Shaped[np.ndarray, "rows k"]) -> Shaped[np.ndarray, "rows k"]:
    """The brightest place beside each one: so near that a bright patch is beside itself, and not a stripe."""
    reach, count = max(_SIDE_CELLS), len(cores)
    padded = cv2.copyMakeBorder(cores, reach, reach, 0, 0, cv2.BORDER_REPLICATE)
    brightest = cv2.max(padded[:count], padded[2 * reach :])
    for step in _SIDE_CELLS[:-1]:
        for shift in (reach - step, reach + step):
            cv2.max(brightest, padded[shift : shift + count], dst=brightest)
    return brightest


def picked(
    image: Shaped[np.ndarray, "height width"],
    rows: Int[np.ndarray, "n"],
    offset: Int[np.ndarray, "rows 1"],
    columns: Int[np.ndarray, "n"],
) -> Float32[np.ndarray, "rows n"]:
    """The values at rows + offset of these columns; beyond the picture's edge, those at the edge."""
    height, width = image.shape
    if rows.min() + offset[0, 0] < 0 or rows.max() + offset[-1, 0] >= height:
        index = np.clip(rows + offset, 0, height - 1) * width + columns
    else:
        index = (rows * width + columns) + offset * width
    return image.ravel().take(index).astype(np.float32)


def _measured(
    cells: Shaped[np.ndarray, "rows columns"], first: Int[np.ndarray, "k"], found: Int[np.ndarray, "k"]
) -> RoughStripe:
    """Centre, width and background in cell columns `found`, about the cells `first` and the next one."""
    grey = picked(cells, first, _OFFSET, found)
    moments = _MOMENTS @ grey
    for near, far in (_NEAR_BACKGROUND_CELLS, _BACKGROUND_CELLS):
        # The darker of two cells, so that no reflection counts; then the median of neighbours, against noise.
        reach = max(_BACKGROUND_CELLS)
        above = cv2.medianBlur(np.minimum(grey[reach - far], grey[reach - near])[None], 5)[0]
        below = cv2.medianBlur(np.minimum(grey[reach + 1 + far], grey[reach + 1 + near])[None], 5)[0]
        apart_px = CELL_ROWS * (near + far + 1.0)
        step = below - above
        middle, slope = (above + below) / 2, step / np.float32(apart_px)
        light = moments - _MOMENTS_OF_LEVEL * middle - _MOMENTS_OF_SLOPE * slope
        centre, variance = adapted(np.float32(0), _FIRST_VARIANCE_PX2, *light)
        if 2 * np.count_nonzero(variance <= _NARROW_PX2 + _CELL_VARIANCE_PX2) >= len(variance):
            break
    by_cell = np.empty((5, len(found), CELL_COLUMNS), np.float32)
    by_cell[0] = ((first + 1) * CELL_ROWS - 0.5 + centre)[:, None]
    by_cell[1] = np.maximum(variance - _CELL_VARIANCE_PX2, _LEAST_VARIANCE_PX2)[:, None]
    by_cell[2], by_cell[3], by_cell[4] = (middle + slope * centre)[:, None], slope[:, None], step[:, None]
    centre_px, variance_px2, background_grey, background_slope, background_step = by_cell.reshape(5, -1)
    return RoughStripe(
        columns=(CELL_COLUMNS * found[:, None] + np.arange(CELL_COLUMNS)).ravel(),
        centre_px=centre_px,
        variance_px2=variance_px2,
        background_grey=background_grey,
        background_slope=background_slope,
        background_step=background_step,
        background_apart_px=apart_px,
    )


def adapted(
    centre: Float32[np.ndarray, "*n"] | np.float32,
    weight_variance: Float32[np.ndarray, "n"] | np.float32,
    total: Float32[np.ndarray, "n"],
    shift: Float32[np.ndarray, "n"],
    second: Float32[np.ndarray, "n"],
) -> tuple[Float32[np.ndarray, "n"], Float32[np.ndarray, "n"]]:
    """Centre and variance of a Gaussian stripe, from its moments under a Gaussian weight about `centre`.

    Their product is a Gaussian of variance q with 1/q = 1/V + 1/W, whose mean lies the share q/V of the way from the
    weight's centre to the stripe's.
    """
    total = np.maximum(total, 1e-3)
    mean = shift / total
    q = np.maximum(second / total - mean * mean, 0.05)
    variance = 1 / np.maximum(1 / q - 1 / weight_variance, 1 / _MOST_VARIANCE_PX2)
    shift_px = np.minimum(np.maximum(mean * variance / q, -_MOST_SHIFT_PX), _MOST_SHIFT_PX)
    return centre + shift_px, variance


def _shrunk(image: Shaped[np.ndarray, "height width"]) -> Shaped[np.ndarray, "rows columns"]:
    """Means of cells of 4 rows and 2 columns; what is left over at the lower and right edges is not in them."""
    rows, columns = image.shape[0] // CELL_ROWS, image.shape[1] // CELL_COLUMNS
    if rows == 0 or columns == 0:
        return np.zeros((0, 0), image.dtype)
    pairs = np.empty((2 * rows, columns), image.dtype)
    band = max(1, _UNSHARED_PIXELS // columns)
    for top in range(0, 2 * rows, band):  # OpenCV shares larger pictures out, and waits
        bottom = min(top + band, 2 * rows)
        piece = image[2 * top : 2 * bottom, : columns * CELL_COLUMNS]
        cv2.resize(piece, (columns, bottom - top), dst=pairs[top:bottom], interpolation=cv2.INTER_AREA)
    return _mean(pairs[0::2], pairs[1::2])


def _mean(first: Shaped[np.ndarray, "rows columns"], second: Shaped[np.ndarray, "rows columns"]) -> np.ndarray:
    """The mean of two whole numbers, rounded down, without leaving their type (Warren, Hacker's Delight, 2-5)."""
    half_difference = first ^ second
    half_difference >>= 1
    mean = first & second
    mean += half_difference
    return mean

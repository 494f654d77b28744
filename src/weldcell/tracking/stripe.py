"""The laser stripe's centre in each picture column, to a fraction of a pixel, with its standard deviation."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from scipy.ndimage import median_filter

from weldcell.cell.errors import BadInput
from weldcell.cell.profile import Stripe

DEFAULT_SPECKLE_CONTRAST = 0.45  # taken where a picture has too few columns to measure its own
_CORE_ROWS = 7  # the search compares this many rows with the rows on both sides
_SIDE_ROWS = 9
_SIDE_SHIFT = 16  # centre of the side rows: clear of a stripe of 4 px sigma
_SEARCH_COLUMNS = 3
_NOISE_COLUMNS = 24
_SEARCH_SNR = 6.0  # the largest of 1080 noise values reaches 3.3 of its own sigma
_HALF_WINDOW = 26
_BAND_START = 17  # background is taken from _BAND_START to _HALF_WINDOW rows off, on both sides
_TRIMMED_EACH_SIDE = 2
_SIGNAL_SNR = 8.0
_STRIPE_SIGMA_PX = (0.6, 5.5)  # narrower is a hot pixel, wider a patch of ambient light
_WINDOW_SIGMAS = 2.6  # half width of the centroid's window, in stripe sigmas
_QUANTISATION_GREY = 1 / np.sqrt(12)  # 8-bit rounding: the least noise a picture can have
_SMOOTHED_COLUMNS = 9
_PIECE_GAP_PX = 3
_SHORTEST_PIECE = 5
_SPECKLE_TRIPLES = 60


def find_stripe(image: np.ndarray, *, speckle_contrast: float | None = None) -> Stripe:
    """The strongest stripe of each column; columns without a clear one are left out.

    `image` has 8 bits and one channel (BadInput otherwise). The centre is the fixed point of a centroid in a smooth
    window: the window is symmetric about the estimate itself, so neither its rounding nor an even background can
    pull it. `sigma_px` follows from the picture's noise and from the speckle contrast (standard deviation over mean
    of one pixel's brightness), which is measured on the stripe's own roughness unless it is given.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise BadInput(f"stripe: expected a grey picture of 8 bits, found shape {image.shape}, type {image.dtype}")
    columns, rows = _search(image)
    if len(columns) == 0:
        return _stripe(columns, np.zeros(0), np.zeros(0))
    windows = _cut_windows(image, columns, rows)
    centre, width = _matched_centre(windows.signal)
    width = median_filter(width, size=_SMOOTHED_COLUMNS, mode="nearest")
    refined = _windowed_centroid(windows, centre, width)
    v_px = rows + refined.centre
    whole = (v_px > _WINDOW_SIGMAS * width) & (v_px < image.shape[0] - 1 - _WINDOW_SIGMAS * width)
    keep = refined.clear & whole & (width > _STRIPE_SIGMA_PX[0]) & (width < _STRIPE_SIGMA_PX[1])
    keep[keep] = _in_long_piece(columns[keep], v_px[keep], width[keep])
    columns, v_px, refined = columns[keep], v_px[keep], refined.only(keep)
    if speckle_contrast is None:
        speckle_contrast = _measured_contrast(columns, v_px, refined)
    return _stripe(columns, v_px, np.sqrt(refined.noise_variance + speckle_contrast**2 * refined.speckle_variance))


@dataclass(frozen=True, kw_only=True)
class _Windows:
    """Rows about the stripe, one line a column, background subtracted."""

    signal: Float32[np.ndarray, "n rows"]
    background_step: Float32[np.ndarray, "n"]
    """Background below the stripe minus background above it, in grey levels."""
    noise_grey: float


@dataclass(frozen=True, kw_only=True)
class _Centroid:
    """Centres relative to the window's middle row, and what they scatter by."""

    centre: Float[np.ndarray, "n"]
    noise_variance: Float[np.ndarray, "n"]
    speckle_variance: Float[np.ndarray, "n"]
    """For a contrast of 1."""
    clear: Bool[np.ndarray, "n"]

    def only(self, keep: Bool[np.ndarray, "n"]) -> "_Centroid":
        return _Centroid(
            centre=self.centre[keep],
            noise_variance=self.noise_variance[keep],
            speckle_variance=self.speckle_variance[keep],
            clear=self.clear[keep],
        )


def _search(image: UInt8[np.ndarray, "height width"]) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Columns in which a row stands out against the rows on *both* its sides, and that row.

    An edge of the ambient picture is as bright as one of its sides, so it does not stand out.
    """
    core = cv2.blur(image, (_SEARCH_COLUMNS, _CORE_ROWS), borderType=cv2.BORDER_REPLICATE)
    sides = cv2.blur(image, (_SEARCH_COLUMNS, _SIDE_ROWS), borderType=cv2.BORDER_REPLICATE)
    sides = cv2.copyMakeBorder(sides, _SIDE_SHIFT, _SIDE_SHIFT, 0, 0, cv2.BORDER_REPLICATE)
    above, below = sides[: -2 * _SIDE_SHIFT], sides[2 * _SIDE_SHIFT :]
    response = cv2.subtract(core, cv2.max(above, below))
    rows = cv2.transpose(response).argmax(axis=1)  # along memory: twice as fast as down the columns
    height = response[rows, np.arange(image.shape[1])].astype(float)
    averaged = np.sqrt(_SEARCH_COLUMNS * _CORE_ROWS)
    threshold = 1 + _SEARCH_SNR * _picture_noise(image) / averaged  # 1: the rounding of two 8-bit means
    columns = np.flatnonzero(height > threshold)
    return columns, rows[columns]


def _picture_noise(image: UInt8[np.ndarray, "height width"]) -> float:
    """Standard deviation of one pixel (grey levels), from differences of neighbouring rows without the large ones."""
    sample = image[:, :: max(1, image.shape[1] // _NOISE_COLUMNS)].astype(np.float32)
    differences = np.diff(sample, axis=0).ravel()
    spread = np.float32(255.0)
    for _ in range(4):
        inside = differences[np.abs(differences) <= max(2.8 * spread, 1.5)]
        if len(inside) == 0:
            break
        spread = inside.std()
    return max(float(spread) / np.sqrt(2), _QUANTISATION_GREY) if len(differences) else _QUANTISATION_GREY


def _cut_windows(
    image: UInt8[np.ndarray, "height width"], columns: Int[np.ndarray, "n"], rows: Int[np.ndarray, "n"]
) -> _Windows:
    """The windows about `rows`, minus the straight line through the background on both sides."""
    picked = np.clip(rows[:, None] + _offsets().astype(int), 0, image.shape[0] - 1)
    grey = image[picked, columns[:, None]].astype(np.float32)
    band = _HALF_WINDOW - _BAND_START + 1
    above, below = np.sort(grey[:, :band], axis=1), np.sort(grey[:, -band:], axis=1)
    trimmed = slice(_TRIMMED_EACH_SIDE, band - _TRIMMED_EACH_SIDE)  # a reflection in the band must not count
    above_mean, below_mean = above[:, trimmed].mean(axis=1), below[:, trimmed].mean(axis=1)
    step = below_mean - above_mean
    middle, slope = (above_mean + below_mean) / 2, step / (_HALF_WINDOW + _BAND_START)
    variances = (above.var(axis=1, ddof=1) + below.var(axis=1, ddof=1)) / 2
    return _Windows(
        signal=grey - middle[:, None] - slope[:, None] * _offsets(),
        background_step=step,
        noise_grey=max(float(np.sqrt(np.median(variances))), _QUANTISATION_GREY),
    )


def _offsets() -> Float32[np.ndarray, "rows"]:
    return np.arange(-_HALF_WINDOW, _HALF_WINDOW + 1, dtype=np.float32)


def _matched_centre(
    signal: Float32[np.ndarray, "n rows"],
) -> tuple[Float32[np.ndarray, "n"], Float32[np.ndarray, "n"]]:
    """Centre and width (Gaussian sigma, px) by adaptive moments: the weight converges to the stripe's own shape.

    A Gaussian of width s under a Gaussian weight of width W has second moment q with 1/q = 1/s^2 + 1/W^2, and the
    centroid moves only the share q/W^2 of the error towards the truth: both are undone in each step.
    """
    middle = slice(_HALF_WINDOW - _BAND_START, _HALF_WINDOW + _BAND_START + 1)
    signal, offsets = np.ascontiguousarray(signal[:, middle]), _offsets()[middle]
    centre = np.zeros(len(signal), dtype=np.float32)
    variance = np.full(len(signal), 4.0, dtype=np.float32)
    for _ in range(4):
        x = offsets - centre[:, None]
        squared = x * x
        weighted = np.exp(squared * (-0.5 / variance[:, None])) * signal
        total = np.maximum(weighted.sum(axis=1), 1e-3)
        second = np.clip(np.einsum("ij,ij->i", weighted, squared) / total, 0.05, 0.9 * variance)
        shift = np.einsum("ij,ij->i", weighted, x) / total
        inverse = 1 / second - 1 / variance
        centre = np.clip(centre + np.clip(shift / (second * inverse), -2, 2), -8, 8)
        variance = np.clip(1 / inverse, 0.25, 49.0)
    return centre, np.sqrt(variance)


def _windowed_centroid(
    windows: _Windows, centre: Float32[np.ndarray, "n"], width: Float32[np.ndarray, "n"]
) -> _Centroid:
    """The fixed point c of sum w(v - c) (v - c) I(v) = 0 by Newton, with w(x) = 1 / (1 + (x/h)^8).

    A plain centroid of speckle scatters less than a matched filter does, hence the flat top; the soft edge keeps
    the sum over whole pixels equal to the integral, hence no bias from the sub-pixel phase.
    """
    signal = windows.signal
    half = (_WINDOW_SIGMAS * np.clip(width, 1.0, _STRIPE_SIGMA_PX[1])).astype(np.float32)[:, None]
    for _ in range(3):
        x = _offsets() - centre[:, None]
        squared = (x * (1 / half)) ** 2
        fourth = squared * squared
        weight = 1 / (1 + fourth * fourth)
        moment = weight * x
        slope = np.einsum("ij,ij->i", weight * (1 - 8 * fourth * fourth * weight), signal)
        slope = np.maximum(slope, 1e-3)
        shift = np.einsum("ij,ij->i", moment, signal) / slope
        centre = np.clip(centre + np.clip(shift, -2, 2), -8, 8)
    noise = windows.noise_grey
    total = np.einsum("ij,ij->i", weight, signal)
    clear = (total > _SIGNAL_SNR * noise * np.sqrt((weight * weight).sum(axis=1))) & (np.abs(centre) < 6)
    square_moment = np.einsum("ij,ij->i", moment, moment)
    # Half of the background line's pull is in doubt: a step between two surfaces is not a slope.
    pull = np.einsum("ij,ij->i", moment, x) / (_HALF_WINDOW + _BAND_START) / slope
    band_noise = noise * np.sqrt(2 / (_HALF_WINDOW - _BAND_START + 1))
    step = np.maximum(np.abs(windows.background_step) - 3 * band_noise, 0)
    bright = np.einsum("ij,ij->i", moment * moment, signal * signal) - noise**2 * square_moment
    return _Centroid(
        centre=centre.astype(float),
        noise_variance=(noise**2 * square_moment / slope**2 + pull**2 * (band_noise**2 + step**2 / 4)).astype(float),
        speckle_variance=np.maximum(bright / slope**2, 0).astype(float),
        clear=clear,
    )


def _in_long_piece(
    columns: Int[np.ndarray, "n"], v_px: Float[np.ndarray, "n"], width: Float32[np.ndarray, "n"]
) -> Bool[np.ndarray, "n"]:
    """Which points belong to a connected piece; crumbs of a few columns are noise or spatter."""
    jump = np.abs(np.diff(v_px)) > 4 + 4 * width[1:]
    piece = np.concatenate([[0], np.cumsum(jump | (np.diff(columns) > _PIECE_GAP_PX))])
    return np.bincount(piece)[piece] >= _SHORTEST_PIECE if len(columns) else np.zeros(0, bool)


def _measured_contrast(columns: Int[np.ndarray, "n"], v_px: Float[np.ndarray, "n"], found: _Centroid) -> float:
    """The speckle contrast that explains the stripe's roughness from column to column.

    Second differences of three neighbouring columns have variance s1 + 4 s2 + s3; their median square is 0.4549 of
    it for normal noise, and corners and strays do not move a median.
    """
    neighbours = columns[2:] - columns[:-2] == 2
    if neighbours.sum() < _SPECKLE_TRIPLES:
        return DEFAULT_SPECKLE_CONTRAST
    rough = (v_px[2:] - 2 * v_px[1:-1] + v_px[:-2])[neighbours] ** 2 / 0.4549
    noise, speckle = (
        (part[2:] + 4 * part[1:-1] + part[:-2])[neighbours] for part in (found.noise_variance, found.speckle_variance)
    )
    # The median of squares scaled to one scatter, so that dim and bright pieces count alike.
    contrast2 = 0.2
    for _ in range(3):
        expected = noise + contrast2 * speckle
        excess = np.median(rough / expected) * np.median(expected) - np.median(noise)
        contrast2 = max(excess / max(np.median(speckle), 1e-12), 0.0)
    return float(np.sqrt(contrast2))


def _stripe(columns: Int[np.ndarray, "n"], v_px: Float[np.ndarray, "n"], sigma_px: Float[np.ndarray, "n"]) -> Stripe:
    return Stripe(u_px=columns.astype(float), v_px=v_px, sigma_px=sigma_px)

"""The stripe's centre in each column, as precise as the picture's noise allows.

Let the stripe be A g(v - c) with g(x) = exp(-x^2 / 2 s^2), and let a pixel's noise have the variance a + B A^2 g: a of
the camera's read noise and the background's light, B of what grows with the stripe's own light (photon noise, speckle).
The Fisher information of c is the sum of (A g')^2 / (a + B A^2 g), and the root of the score reaches it: with
g' = -x g / s^2 that is

    sum w(v - c) (v - c) I(v) = 0,   w = g / (k + g),   k = a / (B A^2).

A large k (dim stripe, no speckle) makes this the matched filter, a small one (speckle) a centroid in a flat window,
which scatters less there: one formula adapts from column to column. The weight is even about the estimate itself, so
neither a background that was not fully taken off nor the start's rounding can pull it, and it is smooth, so the sum
over whole pixels equals the integral and the sub-pixel phase does not matter.

B is measured: it is what is left of the centres' roughness along the stripe when a's share is taken off.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from weldcell.tracking.cell_noise import QUANTISATION_GREY
from weldcell.tracking.stripe_faint import REACH_PX, path_at
from weldcell.tracking.stripe_noise import Spread, excess_noise
from weldcell.tracking.stripe_pieces import in_long_pieces
from weldcell.tracking.stripe_search import (
    STEP_NOISE,
    RoughStripe,
    adapted,
)
from weldcell.tracking.stripe_windows import (
    LEAST_LIGHT,
    WINDOW_SIGMAS,
    FlatWeighted,
    Weighted,
    Windows,
    cut_windows,
    flat_light,
    gaussian_light,
)

_STRIPE_SIGMA_PX = (0.6, 5.5)  # narrower is a hot pixel, wider a patch of ambient light
_LEAST_K = np.float32(np.exp(-(WINDOW_SIGMAS**2) / 2))  # the weight falls to a half at the window's edge
_MOST_K = np.float32(1e3)
_SIGNAL_SNR = 8.0
_DIM_SNR = 16.0  # what is brighter and no stripe by itself is none beside one either
_FAINT_SNR, _FAINT_SHARE = 4.0, 0.2  # the latter of the clear columns' beside it
_FEW_SHARE = 0.05  # of the columns
_STEADY_SNR, _STEADY_PX, _TOGETHER_COLUMNS = 2.0, 2.5, 9  # of columns that are clear only together
_FARTHEST_FAINT_PX = 0.999  # off its neighbours' path; the step is cut off at 1
_FARTHEST_PX = 6.0
_START_PX2 = np.float32(4.0)
_PIECE_GAP_PX = 3
_SHORTEST_PIECE = 5


@dataclass(frozen=True, kw_only=True)
class Centres:
    """The stripe's centre in the columns where there is one."""

    columns: Int[np.ndarray, "n"]
    v_px: Float[np.ndarray, "n"]
    sigma_px: Float[np.ndarray, "n"]
    amplitude_grey: Float[np.ndarray, "n"]


def measure(
    image: Shaped[np.ndarray, "height width"], rough: RoughStripe, *, speckle_contrast: float | None = None
) -> Centres:
    """The centres near the rough ones, without those that are not clear of the noise or not part of a piece."""
    columns, windows = rough.columns, cut_windows(image, rough)
    start = rough.centre_px - windows.row
    gaussian = gaussian_light(windows, start, rough.variance_px2 + _START_PX2)
    centre, variance = adapted(start, gaussian.weight_variance, gaussian.total, gaussian.shift, gaussian.second)
    variance = _pooled(variance)
    width, row = np.sqrt(variance), windows.row + centre
    snr = _signal_to_noise(windows, gaussian)
    whole = _is_stripe(windows, slice(None), centre, width)
    good = _in_long_pieces((snr > _SIGNAL_SNR) & whole, columns, row, width, REACH_PX)
    path, faint = good, np.flatnonzero((snr < _DIM_SNR) & ~good)
    if len(faint) > _FEW_SHARE * len(good):
        path = good | _is_steady(row, np.where(whole, snr, 0))
    known = np.flatnonzero(path)
    faint = _put_on_path(columns, windows, centre, variance, known, faint)
    width, row = np.sqrt(variance), windows.row + centre
    excess = excess_noise(columns, row, _spread(windows, gaussian, variance), good, speckle_contrast)
    weighted = flat_light(windows, centre, variance, _flatness(windows, gaussian, variance, excess))
    step = _newton_step(weighted, variance)
    good[faint] = _is_seen(windows, weighted, step, columns, known, faint)
    centre += step
    row = windows.row + centre
    good = _in_long_pieces(good, columns, row, width, _PIECE_GAP_PX)
    spread = _spread(windows, weighted, variance)
    excess = excess_noise(columns, row, spread, good, speckle_contrast)
    noise_variance = spread.noise_variance + _background_variance(windows, weighted, variance)
    sigma_px = np.sqrt(noise_variance + np.float32(excess) * spread.own_variance)
    kept = np.flatnonzero(good & (sigma_px < width))  # a centre less sure than the stripe is wide tells nothing
    return Centres(
        columns=columns[kept],
        v_px=windows.row[kept].astype(float) + centre[kept],
        sigma_px=sigma_px[kept].astype(float),
        amplitude_grey=_amplitude_grey(weighted)[kept].astype(float),
    )


def _newton_step(weighted: FlatWeighted, variance: Float32[np.ndarray, "n"]) -> Float32[np.ndarray, "n"]:
    """How far the score's root is: its derivative is -sum (w + x w') I, with x w' = -w (1 - w) x^2 / W."""
    slope = weighted.total - (weighted.second - weighted.second_wwi) / weighted.weight_variance
    return np.clip(weighted.shift / np.maximum(slope, 0.4 * weighted.second / variance), -1, 1)


def _spread(windows: Windows, weighted: Weighted, variance: Float32[np.ndarray, "n"]) -> Spread:
    """The score's noise over the score's derivative, which for a Gaussian stripe is sum w x^2 I / s^2."""
    slope = weighted.second / variance
    noise_share = windows.noise_grey / slope
    noise = weighted.second_ww * noise_share * noise_share
    own = weighted.second_wwii / (slope * slope)
    return Spread(noise_variance=noise, own_variance=np.maximum(own - noise, 0))


def _background_variance(
    windows: Windows, weighted: FlatWeighted, variance: Float32[np.ndarray, "n"]
) -> Float32[np.ndarray, "n"]:
    """Variance of the centre by what is not known of the background's slope.

    That is the noise of its step, and half the step: an edge between two surfaces is no slope.
    """
    noise_grey = windows.noise_grey * STEP_NOISE + QUANTISATION_GREY
    doubt = np.maximum(np.abs(windows.background_step) - 3 * noise_grey, 0) / 2
    pull = weighted.second_w * variance / (weighted.second * windows.background_apart_px)
    return (noise_grey * noise_grey + doubt * doubt) * (pull * pull)


def _pooled(variance: Float32[np.ndarray, "n"]) -> Float32[np.ndarray, "n"]:
    """The width of a column and its neighbours: the median keeps strays out, the mean steadies it."""
    return np.asarray(cv2.blur(cv2.medianBlur(variance[None], 5), (5, 1), borderType=cv2.BORDER_REPLICATE))[0]


def _signal_to_noise(windows: Windows, weighted: Weighted) -> Float32[np.ndarray, "n"]:
    """The light under the weights over the noise that they let in."""
    return np.asarray(weighted.total / (windows.noise_grey * np.sqrt(weighted.ww)))


def _is_stripe(
    windows: Windows,
    which: Int[np.ndarray, "n"] | slice,
    centre: Float32[np.ndarray, "n"],
    width: Float32[np.ndarray, "n"],
) -> Bool[np.ndarray, "n"]:
    """Which columns' light would be a stripe: whole within picture and window, neither point nor patch."""
    reach, row, away = WINDOW_SIGMAS * width, windows.row[which] + centre, np.abs(centre)
    return (
        (width > _STRIPE_SIGMA_PX[0])
        & (width < _STRIPE_SIGMA_PX[1])
        & (row > reach)
        & (row + reach < windows.height_px - 1)
        & (away < _FARTHEST_PX)
        & (away + reach < windows.powers[1, -1] + 1)
    )


def _is_steady(row: Float32[np.ndarray, "n"], snr: Float32[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Columns whose light is clear of the noise only together with that of their neighbours, and in line with it."""
    in_line = (snr > _STEADY_SNR) & (np.abs(row - cv2.medianBlur(row[None], 5)[0]) < _STEADY_PX)
    light = np.where(in_line, np.minimum(snr, _SIGNAL_SNR), 0)  # no single column may stand for all
    together = cv2.boxFilter(light[None], -1, (_TOGETHER_COLUMNS, 1), normalize=False, borderType=cv2.BORDER_ISOLATED)
    return np.asarray(in_line & (together[0] > _SIGNAL_SNR * np.sqrt(_TOGETHER_COLUMNS)))


def _put_on_path(
    columns: Int[np.ndarray, "n"],
    windows: Windows,
    centre: Float32[np.ndarray, "n"],
    variance: Float32[np.ndarray, "n"],
    known: Int[np.ndarray, "k"],
    faint: Int[np.ndarray, "m"],
) -> Int[np.ndarray, "l"]:
    """Those columns of `faint` that have known ones beside them, `centre` and `variance` set to what these say."""
    if len(faint) == 0 or len(known) == 0:
        return faint[:0]
    at, known_at = columns[faint], columns[known]
    path = path_at(at, known_at, _smoothed(windows.row[known] + centre[known]), REACH_PX)
    centre[faint] = path_centre = path.at - windows.row[faint]
    variance[faint] = path_variance = np.interp(at, known_at, variance[known]).astype(np.float32)
    return faint[path.near & _is_stripe(windows, faint, path_centre, np.sqrt(path_variance))]


def _smoothed(row: Float32[np.ndarray, "n"]) -> Float32[np.ndarray, "n"]:
    """The rows with the noise of single columns taken off; steps stay."""
    steady = cv2.medianBlur(row[None], 5)
    mean = cv2.blur(steady, (5, 1), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(np.where(np.abs(mean - steady) < 2, mean, steady)[0])


def _is_seen(
    windows: Windows,
    weighted: Weighted,
    step: Float32[np.ndarray, "n"],
    columns: Int[np.ndarray, "n"],
    known: Int[np.ndarray, "k"],
    faint: Int[np.ndarray, "m"],
) -> Bool[np.ndarray, "m"]:
    """Which of the faint columns show the stripe where it should be, above the noise that the weight lets in.

    Beside a stripe far above the noise, what is faint is something else.
    """
    if len(faint) == 0:
        return np.zeros(0, bool)
    snr = _signal_to_noise(windows, weighted)
    beside = np.interp(columns[faint], columns[known], snr[known])
    enough = snr[faint] > np.maximum(_FAINT_SNR, _FAINT_SHARE * beside)
    return np.asarray(enough & (np.abs(step[faint]) < _FARTHEST_FAINT_PX))


def _in_long_pieces(
    good: Bool[np.ndarray, "n"],
    columns: Int[np.ndarray, "n"],
    row: Float32[np.ndarray, "n"],
    width: Float32[np.ndarray, "n"],
    most_gap_px: int,
) -> Bool[np.ndarray, "n"]:
    """Which of the good columns belong to a connected piece; crumbs of a few columns are noise or spatter."""
    kept = np.flatnonzero(good)
    if len(kept) == 0:
        return good
    columns, row, width = columns[kept], row[kept], width[kept]
    jump = np.abs(row[1:] - row[:-1]) > 4 + 4 * width[1:]
    long = np.zeros(len(good), bool)
    long[kept] = in_long_pieces(jump | (columns[1:] - columns[:-1] > most_gap_px), _SHORTEST_PIECE)
    return long


def _flatness(
    windows: Windows, gaussian: Weighted, variance: Float32[np.ndarray, "n"], excess: float
) -> Float32[np.ndarray, "n"]:
    """k of the weight, from the stripe's peak: light of A sqrt(2 pi q) under a Gaussian weight, 1/q = 1/V + 1/W."""
    q = variance * gaussian.weight_variance / (variance + gaussian.weight_variance)
    ratio = windows.noise_grey / np.maximum(gaussian.total, LEAST_LIGHT)
    return np.clip(ratio * ratio * q * np.float32(2 * np.pi / max(excess, 1e-9)), _LEAST_K, _MOST_K)


def _amplitude_grey(weighted: FlatWeighted) -> Float32[np.ndarray, "n"]:
    """A of a stripe A g from its light under the weight: the sum of A g w."""
    return np.asarray(weighted.total / weighted.wg)

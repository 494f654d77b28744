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

from weldcell.tracking.stripe_noise import Spread, excess_noise, noise_near
from weldcell.tracking.stripe_search import (
    BACKGROUND_APART_PX,
    LEVEL_BIAS,
    QUANTISATION_GREY,
    STEP_NOISE,
    RoughStripe,
    adapted,
    picked,
)

_STRIPE_SIGMA_PX = (0.6, 5.5)  # narrower is a hot pixel, wider a patch of ambient light
_WINDOW_SIGMAS = 2.7  # half of a flat window: 0.7 % of the light lies further out
_LEAST_K = np.float32(np.exp(-(_WINDOW_SIGMAS**2) / 2))  # the weight falls to a half at the window's edge
_MOST_K = np.float32(1e3)
_NARROWEST_WEIGHT_PX2 = np.float32(0.7)  # narrower weights feel the pixels' grid
_START_SLACK_PX = 3  # how far the search may be off
_SIGNAL_SNR = 8.0
_FARTHEST_PX = 6.0
_LEAST_EXPONENT = -30.0  # numbers that are not normal are slow
_LEAST_LIGHT = np.float32(1e-3)
_START_PX2 = np.float32(4.0)
_PIECE_GAP_PX = 3
_SHORTEST_PIECE = 5


@dataclass(frozen=True, kw_only=True)
class Centres:
    """The stripe's centre in the columns where there is one."""

    columns: Int[np.ndarray, "n"]
    v_px: Float[np.ndarray, "n"]
    sigma_px: Float[np.ndarray, "n"]


def measure(
    image: Shaped[np.ndarray, "height width"], rough: RoughStripe, *, speckle_contrast: float | None = None
) -> Centres:
    """The centres near the rough ones, without those that are not clear of the noise or not part of a piece."""
    windows = _cut(image, rough)
    start = rough.centre_px - windows.row
    gaussian = _weighted(windows, start, rough.variance_px2 + _START_PX2)
    centre, variance = adapted(start, gaussian.weight_variance, gaussian.total, gaussian.shift, gaussian.second)
    variance = _pooled(variance)
    good = _is_clear(windows, gaussian, centre, variance, image.shape[0])
    good[good] = _in_long_piece(rough.columns[good], (windows.row + centre)[good], variance[good])
    spread = _spread(windows, gaussian, variance)
    excess = excess_noise(rough.columns, windows.row + centre, spread, good, speckle_contrast)
    weighted = _weighted(windows, centre, variance, _flatness(windows, gaussian, variance, excess))
    centre = centre + _newton_step(windows, weighted, variance)
    spread = _spread(windows, weighted, variance)
    excess = excess_noise(rough.columns, windows.row + centre, spread, good, speckle_contrast)
    noise_variance = spread.noise_variance + _background_variance(windows, weighted, variance)
    sigma_px = np.sqrt(noise_variance + np.float32(excess) * spread.own_variance)
    good &= sigma_px < np.sqrt(variance)  # a centre less sure than the stripe is wide tells nothing
    return Centres(
        columns=rough.columns[good],
        v_px=windows.row[good].astype(float) + centre[good],
        sigma_px=sigma_px[good].astype(float),
    )


@dataclass(frozen=True, kw_only=True)
class _Windows:
    """Rows about the stripe, one column a column of the picture, background taken off."""

    row: Float32[np.ndarray, "n"]
    """The windows' middle row, a whole number."""
    powers: Float32[np.ndarray, "3 rows"]
    """Each row's offset from the middle, to the power of 0, 1 and 2."""
    signal: Float32[np.ndarray, "rows n"]
    noise_grey: Float32[np.ndarray, "n"]
    """Standard deviation of the background's noise."""
    background_step: Float32[np.ndarray, "n"]
    """Background below the stripe minus background above it."""


@dataclass(frozen=True, kw_only=True)
class _Weighted:
    """The light under weights about an estimate of the centre."""

    centre: Float32[np.ndarray, "n"]
    """That estimate, from the window's middle row."""
    weight_variance: Float32[np.ndarray, "n"]
    """Of the weight's Gaussian."""
    weight: Float32[np.ndarray, "rows n"]
    light: Float32[np.ndarray, "rows n"]
    """Weight times signal."""
    total: Float32[np.ndarray, "n"]
    """Sum of the light."""
    shift: Float32[np.ndarray, "n"]
    """Sum of x times light, x counted from the estimate."""
    second: Float32[np.ndarray, "n"]
    """Sum of x^2 times light; positive."""


def _cut(image: Shaped[np.ndarray, "height width"], rough: RoughStripe) -> _Windows:
    among = len(rough.columns) * 99 // 100  # a few patches must not widen the windows of all
    widest = np.sqrt(np.partition(rough.variance_px2, among)[among])
    half = int(np.ceil(_WINDOW_SIGMAS * widest)) + _START_SLACK_PX
    row = np.rint(rough.centre_px)
    rows, offset = row.astype(np.int64), np.arange(-half, half + 1)[:, None]
    powers = offset.astype(np.float32) ** np.arange(3, dtype=np.float32)
    noise_grey = noise_near(image, rows, rough.columns)
    background = np.empty((2, len(row)), np.float32)
    background[0] = rough.background_grey + LEVEL_BIAS * noise_grey + rough.background_slope * (row - rough.centre_px)
    background[1] = rough.background_slope
    signal = picked(image, rows, offset, rough.columns)
    signal -= powers[:, :2] @ background
    return _Windows(
        row=row,
        powers=np.ascontiguousarray(powers.T),
        signal=signal,
        noise_grey=noise_grey,
        background_step=rough.background_step,
    )


def _weighted(
    windows: _Windows,
    centre: Float32[np.ndarray, "n"],
    variance: Float32[np.ndarray, "n"],
    k: Float32[np.ndarray, "n"] | None = None,
) -> _Weighted:
    """The light under g / (k + g) about these centres; without `k` under the Gaussian g itself."""
    weight_variance = np.maximum(variance, _NARROWEST_WEIGHT_PX2)
    inverse = -0.5 / weight_variance
    terms = np.empty((3, len(centre)), np.float32)
    terms[0], terms[1], terms[2] = centre * centre * inverse, -2 * centre * inverse, inverse
    weight = windows.powers.T @ terms  # -x^2 / 2W, as a product of matrices faster than element by element
    cv2.exp(cv2.max(weight, _LEAST_EXPONENT, dst=weight), dst=weight)
    if k is not None:
        weight /= k + weight
    light = weight * windows.signal
    total, first, second = windows.powers @ light
    shift = first - centre * total
    return _Weighted(
        centre=centre,
        weight_variance=weight_variance,
        weight=weight,
        light=light,
        total=total,
        shift=shift,
        second=np.maximum(second - centre * (first + shift), _LEAST_LIGHT),
    )


def _newton_step(
    windows: _Windows, weighted: _Weighted, variance: Float32[np.ndarray, "n"]
) -> Float32[np.ndarray, "n"]:
    """How far the score's root is: its derivative is -sum (w + x w') I, with x w' = -w (1 - w) x^2 / W."""
    flat = _second_moment(windows, weighted.weight * weighted.light, weighted.centre)
    slope = weighted.total - (weighted.second - flat) / weighted.weight_variance
    return np.clip(weighted.shift / np.maximum(slope, 0.4 * weighted.second / variance), -1, 1)


def _second_moment(
    windows: _Windows, values: Float32[np.ndarray, "rows n"], centre: Float32[np.ndarray, "n"]
) -> Float32[np.ndarray, "n"]:
    """Sum of x^2 times the values, with x counted from the centre."""
    zeroth, first, second = windows.powers @ values
    return second - centre * (2 * first - centre * zeroth)


def _spread(windows: _Windows, weighted: _Weighted, variance: Float32[np.ndarray, "n"]) -> Spread:
    """The score's noise over the score's derivative, which for a Gaussian stripe is sum w x^2 I / s^2."""
    slope = weighted.second / variance
    noise_share = windows.noise_grey / slope
    noise = _second_moment(windows, weighted.weight * weighted.weight, weighted.centre) * noise_share * noise_share
    own = _second_moment(windows, weighted.light * weighted.light, weighted.centre) / (slope * slope)
    return Spread(noise_variance=noise, own_variance=np.maximum(own - noise, 0))


def _background_variance(
    windows: _Windows, weighted: _Weighted, variance: Float32[np.ndarray, "n"]
) -> Float32[np.ndarray, "n"]:
    """Variance of the centre by what is not known of the background's slope.

    That is the noise of its step, and half the step: an edge between two surfaces is no slope.
    """
    noise_grey = windows.noise_grey * STEP_NOISE + QUANTISATION_GREY
    doubt = np.maximum(np.abs(windows.background_step) - 3 * noise_grey, 0) / 2
    pull = _second_moment(windows, weighted.weight, weighted.centre) * variance / weighted.second
    return (noise_grey * noise_grey + doubt * doubt) * np.square(pull / BACKGROUND_APART_PX)


def _pooled(variance: Float32[np.ndarray, "n"]) -> Float32[np.ndarray, "n"]:
    """The width of a column and its neighbours: the median keeps strays out, the mean steadies it."""
    return np.asarray(cv2.blur(cv2.medianBlur(variance[None], 5), (5, 1), borderType=cv2.BORDER_REPLICATE))[0]


def _is_clear(
    windows: _Windows,
    gaussian: _Weighted,
    centre: Float32[np.ndarray, "n"],
    variance: Float32[np.ndarray, "n"],
    height_px: int,
) -> Bool[np.ndarray, "n"]:
    """Columns whose light is a stripe: above the noise, whole within picture and window, neither point nor patch."""
    width = np.sqrt(variance)
    norm = np.sqrt(np.sqrt(np.pi * gaussian.weight_variance))  # root of the sum of the squared weights
    reach, row = _WINDOW_SIGMAS * width, windows.row + centre
    return (
        (gaussian.total > _SIGNAL_SNR * windows.noise_grey * norm)
        & (width > _STRIPE_SIGMA_PX[0])
        & (width < _STRIPE_SIGMA_PX[1])
        & (row > reach)
        & (row < height_px - 1 - reach)
        & (np.abs(centre) < _FARTHEST_PX)
        & (np.abs(centre) + reach < windows.powers[1, -1] + 1)
    )


def _in_long_piece(
    columns: Int[np.ndarray, "n"], v_px: Float[np.ndarray, "n"], width_px2: Float32[np.ndarray, "n"]
) -> Bool[np.ndarray, "n"]:
    """Which points belong to a connected piece; crumbs of a few columns are noise or spatter."""
    if len(columns) == 0:
        return np.zeros(0, bool)
    jump = np.abs(np.diff(v_px)) > 4 + 4 * np.sqrt(width_px2[1:])
    piece = np.zeros(len(columns), np.int64)
    np.cumsum(jump | (np.diff(columns) > _PIECE_GAP_PX), out=piece[1:])
    return np.bincount(piece)[piece] >= _SHORTEST_PIECE


def _flatness(
    windows: _Windows, gaussian: _Weighted, variance: Float32[np.ndarray, "n"], excess: float
) -> Float32[np.ndarray, "n"]:
    """k of the weight, from the stripe's peak: the light under a Gaussian weight is A sqrt(2 pi / (1/V + 1/W))."""
    narrowing = (1 / variance + 1 / gaussian.weight_variance) / np.float32(2 * np.pi)
    peak_grey = np.maximum(gaussian.total, _LEAST_LIGHT) * np.sqrt(narrowing)
    ratio = windows.noise_grey / peak_grey
    return np.clip(ratio * ratio / np.float32(max(excess, 1e-9)), _LEAST_K, _MOST_K)

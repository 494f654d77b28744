"""The picture about the stripe, a window for each column, and its light under weights about the stripe's centre."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, Shaped

from weldcell.tracking.stripe_noise import noise_near
from weldcell.tracking.stripe_search import LEVEL_BIAS, RoughStripe, picked

WINDOW_SIGMAS = 2.7
"""Half of a flat window: 0.7 % of the light lies further out."""
LEAST_LIGHT = np.float32(1e-3)
"""Instead of none or less, where something is divided by it."""
_NARROWEST_WEIGHT_PX2 = np.float32(0.7)  # narrower weights feel the pixels' grid
_START_SLACK_PX = 3  # how far the search may be off
_LEAST_EXPONENT = -30.0  # numbers that are not normal are slow


@dataclass(frozen=True, kw_only=True)
class Windows:
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
    background_apart_px: float
    """From the middle of the one to that of the other."""


@dataclass(frozen=True, kw_only=True)
class Weighted:
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


def cut_windows(image: Shaped[np.ndarray, "height width"], rough: RoughStripe) -> Windows:
    """Windows about the rough stripe, as high as nearly all of its columns need."""
    among = len(rough.columns) * 99 // 100  # a few patches must not widen the windows of all
    widest = np.sqrt(np.partition(rough.variance_px2, among)[among])
    half = int(np.ceil(WINDOW_SIGMAS * widest)) + _START_SLACK_PX
    row = np.rint(rough.centre_px)
    rows, offset = row.astype(np.int64), np.arange(-half, half + 1)[:, None]
    powers = offset.astype(np.float32) ** np.arange(3, dtype=np.float32)
    noise_grey = noise_near(image, rows, rough.columns)
    background = np.empty((2, len(row)), np.float32)
    background[0] = rough.background_grey + LEVEL_BIAS * noise_grey + rough.background_slope * (row - rough.centre_px)
    background[1] = rough.background_slope
    signal = picked(image, rows, offset, rough.columns)
    signal -= powers[:, :2] @ background
    return Windows(
        row=row,
        powers=np.ascontiguousarray(powers.T),
        signal=signal,
        noise_grey=noise_grey,
        background_step=rough.background_step,
        background_apart_px=rough.background_apart_px,
    )


def weighted_light(
    windows: Windows,
    centre: Float32[np.ndarray, "n"],
    variance: Float32[np.ndarray, "n"],
    k: Float32[np.ndarray, "n"] | None = None,
) -> Weighted:
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
    return Weighted(
        centre=centre,
        weight_variance=weight_variance,
        weight=weight,
        light=light,
        total=total,
        shift=shift,
        second=np.maximum(second - centre * (first + shift), LEAST_LIGHT),
    )


def second_moment(
    windows: Windows, values: Float32[np.ndarray, "rows n"], centre: Float32[np.ndarray, "n"]
) -> Float32[np.ndarray, "n"]:
    """Sum of x^2 times the values, with x counted from the centre."""
    zeroth, first, second = windows.powers @ values
    return second - centre * (2 * first - centre * zeroth)

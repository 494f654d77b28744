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

    height_px: int
    """Of the picture."""
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
    """Sums of the light I under weights w about an estimate of the centre; x is counted from that estimate."""

    weight_variance: Float32[np.ndarray, "n"]
    """Of the weight's Gaussian g."""
    total: Float32[np.ndarray, "n"]
    """Sum of w I."""
    shift: Float32[np.ndarray, "n"]
    """Sum of x w I."""
    second: Float32[np.ndarray, "n"]
    """Sum of x^2 w I; positive."""
    ww: Float32[np.ndarray, "n"]
    """Sum of w^2."""
    second_ww: Float32[np.ndarray, "n"]
    """Sum of x^2 w^2."""
    second_wwii: Float32[np.ndarray, "n"]
    """Sum of x^2 w^2 I^2."""


@dataclass(frozen=True, kw_only=True)
class FlatWeighted(Weighted):
    """The same under weights that need not be Gaussian, and what these need besides."""

    wg: Float32[np.ndarray, "n"]
    """Sum of w g."""
    second_w: Float32[np.ndarray, "n"]
    """Sum of x^2 w."""
    second_wwi: Float32[np.ndarray, "n"]
    """Sum of x^2 w^2 I."""


def cut_windows(image: Shaped[np.ndarray, "height width"], rough: RoughStripe) -> Windows:
    """Windows about the rough stripe, as high as nearly all of its columns need."""
    among = len(rough.columns) * 99 // 100  # a few patches must not widen the windows of all
    widest = np.sqrt(np.partition(rough.variance_px2, among)[among])
    half = int(np.ceil(WINDOW_SIGMAS * widest)) + _START_SLACK_PX
    row = np.rint(rough.centre_px)
    rows, offset = row.astype(np.int64), np.arange(-half, half + 1)[:, None]
    powers = (offset ** np.arange(3)).astype(np.float32)
    noise_grey = noise_near(image, rows, rough.columns)
    background = np.empty((2, len(row)), np.float32)
    background[0] = rough.background_grey + LEVEL_BIAS * noise_grey + rough.background_slope * (row - rough.centre_px)
    background[1] = rough.background_slope
    signal = picked(image, rows, offset, rough.columns)
    signal -= powers[:, :2] @ background
    return Windows(
        height_px=image.shape[0],
        row=row,
        powers=np.ascontiguousarray(powers.T),
        signal=signal,
        noise_grey=noise_grey,
        background_step=rough.background_step,
        background_apart_px=rough.background_apart_px,
    )


def gaussian_light(windows: Windows, centre: Float32[np.ndarray, "n"], variance: Float32[np.ndarray, "n"]) -> Weighted:
    """The light under Gaussians g about these centres."""
    weight_variance, squares, weight = _gaussian(windows, centre, variance)
    light = np.multiply(weight, windows.signal, out=weight)
    total, shift, second = _moments(windows, centre, light)
    squares *= light
    squares *= light
    ww = np.sqrt(np.float32(np.pi) * weight_variance)  # over whole pixels the sum equals the integral
    return Weighted(
        weight_variance=weight_variance,
        total=total,
        shift=shift,
        second=second,
        ww=ww,
        second_ww=ww * weight_variance / 2,
        second_wwii=np.add.reduce(squares),
    )


def flat_light(
    windows: Windows,
    centre: Float32[np.ndarray, "n"],
    variance: Float32[np.ndarray, "n"],
    k: Float32[np.ndarray, "n"],
) -> FlatWeighted:
    """The light under g / (k + g) about these centres."""
    weight_variance, squares, gaussian = _gaussian(windows, centre, variance)
    weight = k + gaussian
    np.divide(gaussian, weight, out=weight)
    wg, ww = _sum(weight, gaussian), _sum(weight, weight)
    light = np.multiply(weight, windows.signal, out=gaussian)
    total, shift, second = _moments(windows, centre, light)
    squares *= weight
    second_w, second_ww = np.add.reduce(squares), _sum(squares, weight)
    squares *= light
    return FlatWeighted(
        weight_variance=weight_variance,
        total=total,
        shift=shift,
        second=second,
        ww=ww,
        second_ww=second_ww,
        second_wwii=_sum(squares, windows.signal),
        wg=wg,
        second_w=second_w,
        second_wwi=np.add.reduce(squares),
    )


def _gaussian(
    windows: Windows, centre: Float32[np.ndarray, "n"], variance: Float32[np.ndarray, "n"]
) -> tuple[Float32[np.ndarray, "n"], Float32[np.ndarray, "rows n"], Float32[np.ndarray, "rows n"]]:
    """The Gaussian's variance, x^2 and the Gaussian."""
    weight_variance = np.maximum(variance, _NARROWEST_WEIGHT_PX2)
    terms = np.empty((3, len(centre)), np.float32)
    terms[0], terms[1], terms[2] = centre * centre, -2 * centre, 1
    squares = windows.powers.T @ terms  # as a product of matrices faster than element by element
    gaussian = squares * (-0.5 / weight_variance)
    cv2.exp(cv2.max(gaussian, _LEAST_EXPONENT, dst=gaussian), dst=gaussian)
    return weight_variance, squares, gaussian


def _moments(
    windows: Windows, centre: Float32[np.ndarray, "n"], light: Float32[np.ndarray, "rows n"]
) -> tuple[Float32[np.ndarray, "n"], Float32[np.ndarray, "n"], Float32[np.ndarray, "n"]]:
    """Sums of light, x times light, x^2 times light."""
    total, first, second = windows.powers @ light
    shift = first - centre * total
    return total, shift, np.maximum(second - centre * (first + shift), LEAST_LIGHT)


def _sum(first: Float32[np.ndarray, "rows n"], second: Float32[np.ndarray, "rows n"]) -> Float32[np.ndarray, "n"]:
    """Sums of the product over the rows."""
    return np.asarray(np.einsum("ij,ij->j", first, second))

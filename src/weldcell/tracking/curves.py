"""Smooth pieces of a section: robust polynomials as low as the points allow, and where they cross."""

import math
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float

from weldcell.tracking.quantiles import upper_median
from weldcell.tracking.section import Corner, Section

LEAST_SCALE = 0.3
"""Of the predicted sigma: keeps noise-free points from all being outliers of each other."""
_TUKEY = 4.685  # 95 % efficiency with normal noise (Huber and Ronchetti, Robust Statistics, 2009)
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_SAME_SLOPE = 1e-3  # within which points keep their weights
_START_GATE_M = 3e-4  # how far from its start a point of the curve may lie
_LEAST_LEAN = 0.05  # of the noise's direction out of the curve: along it, points would tell nothing
_ROUNDS_HIGHER = 2
_HIGHER_SIGMAS = 2.5  # one degree more where its coefficient is this significant: a lower bar costs bias, not variance
_HOPEFUL_SIGMAS = 1.5  # one less significant than this before it is fitted will not be after
_MOST_LAGS = 8
_MOST_CORRELATION = 20.0
_NEWTON_STEPS = 6
_Number = TypeVar("_Number", float, np.ndarray)


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """The polynomial z = sum c_k t^k with t = (x - origin_m) / length_m, in the laser frame."""

    origin_m: float
    length_m: float
    coefficients_m: Float[np.ndarray, "k"]
    covariance: Float[np.ndarray, "k k"]
    """Of the coefficients (m^2), with the residuals' own scale and their correlation along the stripe."""
    sigmas: float
    """Scale of the residuals, in predicted sigmas of the points: 1 where they keep what the stripe promised."""
    count: int
    """Points that take part in it."""
    inlier_share: float
    """Of the points offered."""

    def z_at(self, x_m: float) -> float:
        """z of the curve (m)."""
        return _polynomial((x_m - self.origin_m) / self.length_m, self.coefficients_m.tolist())

    def z_of(self, x_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """z of the curve at many x (m)."""
        return _polynomial((x_m - self.origin_m) / self.length_m, self.coefficients_m.tolist())

    def slope_at(self, x_m: float) -> float:
        """dz/dx of the curve."""
        t, slope, coefficients = (x_m - self.origin_m) / self.length_m, 0.0, self.coefficients_m.tolist()
        for order in range(len(coefficients) - 1, 0, -1):
            slope = slope * t + order * coefficients[order]
        return slope / self.length_m

    def angle_at(self, x_m: float) -> float:
        """Inclination against x (rad), positive where the curve gets deeper with x."""
        return math.atan(self.slope_at(x_m))

    def variance_at(self, x_m: float) -> float:
        """Variance of `z_at` (m^2)."""
        t = (x_m - self.origin_m) / self.length_m
        powers = np.array([t**order for order in range(len(self.coefficients_m))])
        return float(powers @ self.covariance @ powers)


def _polynomial(t: _Number, coefficients: list[float]) -> _Number:
    """Horner's scheme; of the first degree at least."""
    value = t * coefficients[-1]
    for coefficient in coefficients[-2:0:-1]:
        value = (value + coefficient) * t
    return value + coefficients[0]


def line_curve(slope: float, intercept_m: float) -> Curve:
    """The straight line z = intercept_m + slope x, taken as exact."""
    return Curve(
        origin_m=0.0,
        length_m=1.0,
        coefficients_m=np.array([intercept_m, slope]),
        covariance=np.zeros((2, 2)),
        sigmas=1.0,
        count=0,
        inlier_share=1.0,
    )


def flipped_curve(curve: Curve) -> Curve:
    """The curve in the section with left and right swapped."""
    signs = (-1.0) ** np.arange(len(curve.coefficients_m))
    return replace(
        curve,
        origin_m=-curve.origin_m,
        coefficients_m=curve.coefficients_m * signs,
        covariance=curve.covariance * np.outer(signs, signs),
    )


def fit_curve(section: Section, start: Curve, *, highest_degree: int = 1, rounds: int = 3) -> Curve | None:
    """The robust polynomial (Tukey's biweight) through what lies near `start`; None if too few points determine it.

    Straight, unless the next degree's coefficient is significant. The noise lies along a direction known for every
    point, so this is a regression along it: the residual in z has sigma |1 - slope dx/dz| sigma_z, where the line's
    slope will do for what is bent a little.
    """
    x, z = section.x_m, section.z_m
    if len(x) < 4:
        return None
    low, high = float(x.min()), float(x.max())
    middle, half = (low + high) / 2, max((high - low) / 2, 1e-9)
    powers = _powers((x - middle) / half, 2 * highest_degree)
    residual_m = z - start.z_of(x)
    slope = start.slope_at(middle)
    inside = np.abs(residual_m) <= math.hypot(1, slope) * np.maximum(_START_GATE_M, 3 * section.sigma_m)
    weight = _weights(section, slope)
    best: Curve | None = None
    for degree in range(1, highest_degree + 1):
        part = powers[: degree + 1]
        for _ in range(rounds if degree == 1 else _ROUNDS_HIGHER):
            relative = np.square(residual_m) * weight
            near = relative[inside]
            if len(near) <= degree + 2:
                return best
            scale = max(_MAD_TO_SIGMA * math.sqrt(upper_median(near)), LEAST_SCALE)
            robust = np.square(np.maximum(1 - relative / (_TUKEY * scale) ** 2, 0))
            used = robust * weight
            moments = powers @ used
            try:
                inverse = _inverse(moments[: 2 * degree + 1])
            except np.linalg.LinAlgError:
                return best
            coefficients = inverse @ (part @ (used * z))
            residual_m = z - coefficients @ part
            inside = robust > 0.3  # strays must not widen the scale
            if degree == 1 and abs(float(coefficients[1]) / half - slope) > _SAME_SLOPE:
                slope = float(coefficients[1]) / half
                weight = _weights(section, slope)
        count = int(np.count_nonzero(robust))
        correlation = _correlation(residual_m * np.sqrt(weight), robust > 0) if highest_degree > 1 else 1.0
        variance = max(scale, 1.0) ** 2 / _EFFICIENCY
        covariance = variance * correlation * inverse
        if degree > 1 and abs(coefficients[-1]) < _HIGHER_SIGMAS * math.sqrt(covariance[-1, -1]):
            break
        best = Curve(
            origin_m=middle,
            length_m=half,
            coefficients_m=coefficients,
            covariance=covariance,
            sigmas=scale,
            count=count,
            inlier_share=count / len(x),
        )
        if degree == highest_degree or not _may_bend(
            float(powers[degree + 1] @ (used * residual_m)), moments, inverse, variance
        ):
            break
    return best


def _may_bend(pull: float, moments: Float[np.ndarray, "m"], inverse: Float[np.ndarray, "k k"], variance: float) -> bool:
    """Whether the next degree's coefficient is large enough, with this fit's weights, to be worth a fit of its own.

    By the normal matrix's Schur complement s it is pull / s, with a variance of variance / s: pull is the sum of the
    weighted residuals times the next power.
    """
    size = len(inverse)
    mixed = moments[size : 2 * size]
    return pull**2 > _HOPEFUL_SIGMAS**2 * variance * float(moments[2 * size] - mixed @ inverse @ mixed)


def _weights(section: Section, slope: float) -> Float[np.ndarray, "n"]:
    """One over the variance of each point's residual in z from a curve of this slope."""
    lean = np.maximum(np.abs(1 - slope * section.noise_slope), _LEAST_LEAN)
    return 1 / np.square(lean * section.sigma_m)


def _powers(t: Float[np.ndarray, "n"], degree: int) -> Float[np.ndarray, "k n"]:
    """Rows: t to the power of 0 to `degree`."""
    powers = np.ones((degree + 1, len(t)))
    for order in range(1, degree + 1):
        np.multiply(powers[order - 1], t, out=powers[order])
    return powers


def _inverse(moments: Float[np.ndarray, "m"]) -> Float[np.ndarray, "k k"]:
    """Of the normal matrix, whose element (i, j) is the moment i + j; LinAlgError if there is none.

    A line's in closed form, which takes a third of the time.
    """
    if len(moments) > 3:
        size = np.arange(len(moments) // 2 + 1)
        return np.linalg.inv(moments[size[:, None] + size])
    one, t, tt = moments.tolist()
    determinant = one * tt - t * t
    if not determinant > 0:
        raise np.linalg.LinAlgError("singular normal equations")
    return np.array([[tt / determinant, -t / determinant], [-t / determinant, one / determinant]])


def _correlation(relative: Float[np.ndarray, "n"], inside: Bool[np.ndarray, "n"]) -> float:
    """Variance of a mean of the residuals against independent ones: 1 + 2 sum of the significant autocorrelations."""
    r = relative[inside]
    count = len(r)
    if count < 4 * _MOST_LAGS:
        return 1.0
    r = r - r.mean()
    power = float(r @ r)
    factor = 1.0
    for lag in range(1, _MOST_LAGS + 1):
        share = float(r[lag:] @ r[:-lag]) / power if power > 0 else 0.0
        if share < 3 / math.sqrt(count):
            break
        factor += 2 * share
    return min(factor, _MOST_CORRELATION)


def curves_cross(first: Curve, second: Curve, x_m: float) -> Corner | None:
    """Where two curves cross near `x_m`, with the variance that both pass on; None if they do not."""
    found_m = crossing_m(first, second, x_m)
    return None if found_m is None else crossing_at(first, second, found_m)


def crossing_m(first: Curve, second: Curve, x_m: float) -> float | None:
    """x at which two curves cross near `x_m`; None if they do not."""
    for _ in range(_NEWTON_STEPS):
        opening = first.slope_at(x_m) - second.slope_at(x_m)
        if abs(opening) < 1e-6:
            return None
        step_m = (second.z_at(x_m) - first.z_at(x_m)) / opening
        x_m += step_m
        if abs(step_m) < 1e-12:
            break
    return x_m if math.isfinite(x_m) and abs(second.z_at(x_m) - first.z_at(x_m)) <= 1e-6 else None


def crossing_at(first: Curve, second: Curve, x_m: float) -> Corner:
    """The corner of two curves that cross at `x_m`.

    dx = (dz2 - dz1) / (b1 - b2) and dz = (b1 dz2 - b2 dz1) / (b1 - b2), with slopes b and the curves' own errors there.
    """
    first_slope, second_slope = first.slope_at(x_m), second.slope_at(x_m)
    variance = (1 + second_slope**2) * first.variance_at(x_m) + (1 + first_slope**2) * second.variance_at(x_m)
    return Corner(x_m=x_m, z_m=first.z_at(x_m), sigma_m=math.sqrt(variance) / abs(first_slope - second_slope))

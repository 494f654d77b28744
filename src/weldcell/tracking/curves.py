"""Smooth pieces of a section: robust polynomials as low as the points allow, and where they cross."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from weldcell.tracking.section import Corner, Section

LEAST_SCALE = 0.3
"""Of the predicted sigma: keeps noise-free points from all being outliers of each other."""
_TUKEY = 4.685  # 95 % efficiency with normal noise (Huber and Ronchetti, Robust Statistics, 2009)
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_START_GATE_M = 3e-4  # how far from its start a point of the curve may lie
_ROUNDS_HIGHER = 2
_HIGHER_SIGMAS = 2.5  # one degree more where its coefficient is this significant: a lower bar costs bias, not variance
_MOST_LAGS = 8
_MOST_CORRELATION = 20.0
_NEWTON_STEPS = 6


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
        return float(self._powers(x_m) @ self.coefficients_m)

    def z_of(self, x_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """z of the curve at many x (m)."""
        t = (x_m - self.origin_m) / self.length_m
        return np.asarray(np.polynomial.polynomial.polyval(t, self.coefficients_m))

    def slope_at(self, x_m: float) -> float:
        """dz/dx of the curve."""
        orders = np.arange(1, len(self.coefficients_m))
        t = (x_m - self.origin_m) / self.length_m
        return float((orders * t ** (orders - 1)) @ self.coefficients_m[1:]) / self.length_m

    def angle_at(self, x_m: float) -> float:
        """Inclination against x (rad), positive where the curve gets deeper with x."""
        return float(np.arctan(self.slope_at(x_m)))

    def variance_at(self, x_m: float) -> float:
        """Variance of `z_at` (m^2)."""
        powers = self._powers(x_m)
        return float(powers @ self.covariance @ powers)

    def _powers(self, x_m: float) -> Float[np.ndarray, "k"]:
        return ((x_m - self.origin_m) / self.length_m) ** np.arange(len(self.coefficients_m))


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
    point, so this is a regression along it: the residual in z has sigma |1 - slope dx/dz| sigma_z.
    """
    x, z = section.x_m, section.z_m
    if len(x) < 4:
        return None
    middle, half = float(x.min() + x.max()) / 2, max(float(np.ptp(x)) / 2, 1e-9)
    t = (x - middle) / half
    powers = np.vander(t, highest_degree + 1, increasing=True)
    residual_m = z - start.z_of(x)
    slope: float | Float[np.ndarray, "n"] = start.slope_at(middle)
    inside = np.abs(residual_m) <= np.hypot(1, slope) * np.maximum(_START_GATE_M, 3 * section.sigma_m)
    best: Curve | None = None
    for degree in range(1, highest_degree + 1):
        part = powers[:, : degree + 1]
        for _ in range(rounds if degree == 1 else _ROUNDS_HIGHER):
            sigma = section.sigma_m * np.maximum(np.abs(1 - slope * section.noise_slope), 0.05)
            relative = np.abs(residual_m) / sigma
            near = relative[inside]
            if len(near) <= degree + 2:
                return best
            scale = max(_MAD_TO_SIGMA * _median(near), LEAST_SCALE)
            robust = np.square(np.maximum(1 - np.square(relative / (_TUKEY * scale)), 0))
            weighted = (robust / np.square(sigma))[:, None] * part
            try:
                inverse = np.linalg.inv(part.T @ weighted)
            except np.linalg.LinAlgError:
                return best
            coefficients = inverse @ (z @ weighted)
            residual_m = z - part @ coefficients
            slope = part[:, :-1] @ (np.arange(1, degree + 1) * coefficients[1:]) / half
            inside = robust > 0.3  # strays must not widen the scale
        count = int(np.count_nonzero(robust))
        correlation = _correlation(residual_m / (sigma * scale), robust > 0) if highest_degree > 1 else 1.0
        covariance = max(scale, 1.0) ** 2 / _EFFICIENCY * correlation * inverse
        if degree > 1 and abs(coefficients[-1]) < _HIGHER_SIGMAS * np.sqrt(covariance[-1, -1]):
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
    return best


def _median(values: Float[np.ndarray, "n"]) -> float:
    """The upper median: a selection is faster than NumPy's median on few values."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


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
        if share < 3 / np.sqrt(count):
            break
        factor += 2 * share
    return min(factor, _MOST_CORRELATION)


def curves_cross(first: Curve, second: Curve, x_m: float) -> Corner | None:
    """Where two curves cross near `x_m`, with the variance that both pass on; None if they do not.

    dx = (dz2 - dz1) / (b1 - b2) and dz = (b1 dz2 - b2 dz1) / (b1 - b2), with slopes b and the curves' own errors there.
    """
    for _ in range(_NEWTON_STEPS):
        opening = first.slope_at(x_m) - second.slope_at(x_m)
        if abs(opening) < 1e-6:
            return None
        step_m = (second.z_at(x_m) - first.z_at(x_m)) / opening
        x_m += step_m
        if abs(step_m) < 1e-12:
            break
    if not np.isfinite(x_m) or abs(second.z_at(x_m) - first.z_at(x_m)) > 1e-6:
        return None
    first_slope, second_slope = first.slope_at(x_m), second.slope_at(x_m)
    variance = (1 + second_slope**2) * first.variance_at(x_m) + (1 + first_slope**2) * second.variance_at(x_m)
    return Corner(
        x_m=float(x_m), z_m=first.z_at(x_m), sigma_m=float(np.sqrt(variance) / abs(first_slope - second_slope))
    )

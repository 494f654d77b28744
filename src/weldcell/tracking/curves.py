"""Smooth pieces of a section: robust polynomials as low as the points allow, where they cross and where they end."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from weldcell.tracking.section import Corner, Section

_TUKEY = 4.685  # 95 % efficiency with normal noise (Huber and Ronchetti, Robust Statistics, 2009)
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_LEAST_SCALE = 0.3  # of the predicted sigma: keeps noise-free points from all being outliers of each other
_START_GATE_M = 3e-4  # how far from its start a point of the curve may lie
_ROUNDS_HIGHER = 2
_HIGHER_SIGMAS = 2.5  # one degree more where its coefficient is this significant: a lower bar costs bias, not variance
_MOST_LAGS = 8
_MOST_CORRELATION = 20.0
_NEWTON_STEPS = 6
_ON_SIGMAS = 3.5
_BEYOND_ON = 0.03  # share of columns beyond a curve's end that lie on it by chance
_PRIOR_BEGINS, _PRIOR_COUNT = 0.1, 4.0  # runs of strays, and columns, counted before any are seen
_PRIOR_GOES_ON = 0.6  # of two columns
_MOST_MISSING = 400


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
            scale = max(_MAD_TO_SIGMA * _median(near), _LEAST_SCALE)
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


@dataclass(frozen=True, kw_only=True)
class End:
    """Where the points of a curve stop."""

    corner: Corner
    """The end, on the curve."""
    nats: float
    """How much likelier the points beyond it are, as no part of the curve, than as strays of it (natural logarithm)."""


def curve_end(
    section: Section, curve: Curve, inner_m: float, outer_m: float, *, beyond: Curve | None = None
) -> End | None:
    """The end of a curve that holds at x = `inner_m` and no more at `outer_m`; None if there are no points to tell.

    Every column between is on the curve or off it: seen elsewhere, or missing. Strays come in runs, so on the curve a
    column is off with one probability after one that is on and with another after one that is off, both counted on
    the curve's inner half, for strays and for missing columns; beyond the end nearly all are off. A cut after column i
    has the likelihood prod_{j<=i} P(s_j | s_{j-1}, curve) prod_{j>i} P(s_j | beyond), and mean and variance over all
    cuts are the end and its variance: strays beside the end make it less certain. Sampling leaves the end anywhere
    between two columns, which adds a twelfth of their squared distance. Points on the curve `beyond` the end, if it is
    known, are no strays.
    """
    at = _where_columns_cut(section, curve, (inner_m + outer_m) / 2)
    inside = np.flatnonzero((at >= min(inner_m, outer_m)) & (at <= max(inner_m, outer_m)))
    if len(inside) < 3:
        return None
    sign = 1.0 if outer_m > inner_m else -1.0
    inside = inside[np.argsort(sign * at[inside])]
    x, part = at[inside], section.only(inside)
    on = _is_on(part, curve)
    if not on.any():
        return None
    beyond_it = np.zeros(len(x), bool) if beyond is None else ~on & _is_on(part, beyond)
    steps = np.abs(np.diff(x))
    spacing_m = max(_median(steps), 1e-9)
    missing = np.clip(np.rint(np.append(steps, abs(outer_m - x[-1])) / spacing_m) - 1, 0, _MOST_MISSING)
    total, after = _nats_on_curve(on, beyond_it, missing)
    likelihood = np.exp(total - total.max())
    likelihood /= likelihood.sum()
    ends = x + sign * 0.5 * np.minimum(np.append(steps, np.inf), spacing_m)
    x_m = float(likelihood @ ends)
    variance = float(likelihood @ np.square(ends - x_m)) + spacing_m**2 / 12
    sigma_m = float(np.sqrt((1 + curve.slope_at(x_m) ** 2) * variance + curve.variance_at(x_m)))
    return End(
        corner=Corner(x_m=x_m, z_m=curve.z_at(x_m), sigma_m=sigma_m), nats=float(total.max() - total[-1] - after)
    )


def _where_columns_cut(section: Section, curve: Curve, near_m: float) -> Float[np.ndarray, "n"]:
    """x at which each point's column cuts the curve, so that a stray takes the place of the point that it replaced."""
    lean = 1 - curve.slope_at(near_m) * section.noise_slope
    away_m = curve.z_of(section.x_m) - section.z_m
    return section.x_m + section.noise_slope * away_m / np.where(np.abs(lean) > 0.05, lean, 1.0)


def _is_on(section: Section, curve: Curve) -> Bool[np.ndarray, "n"]:
    lean = np.maximum(np.abs(1 - curve.slope_at(float(section.x_m.mean())) * section.noise_slope), 0.05)
    allowed_m = _ON_SIGMAS * max(curve.sigmas, _LEAST_SCALE) * section.sigma_m * lean
    return np.asarray(np.abs(section.z_m - curve.z_of(section.x_m)) <= np.maximum(allowed_m, 1e-7))


def _nats_on_curve(
    on: Bool[np.ndarray, "n"],
    beyond_it: Bool[np.ndarray, "n"],
    missing: Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "n"], float]:
    """How much likelier the columns up to each point are on the curve than beyond its end, and those after the last.

    `missing` columns follow each point. `beyond_it` are points on the curve beyond the end.
    """
    broken = np.append(False, ~on[:-1] | (missing[:-1] > 0))  # the column before is off the curve
    half = max(len(on) // 2, 1)
    count, off, holes = float(half), float(np.sum(~on[:half])), float(np.sum(missing[:half] > 0))
    runs = float(np.sum(~on[:half] & ~broken[:half]))
    stray = (runs + _PRIOR_BEGINS) / (count - off + _PRIOR_COUNT)
    hole = (holes + _PRIOR_BEGINS) / (count + _PRIOR_COUNT)
    stray_on = (off - runs + _PRIOR_GOES_ON) / (off + 2)
    hole_on = (float(missing[:half].sum()) - holes + _PRIOR_GOES_ON) / (float(missing[:half].sum()) + 2)
    stray, hole, stray_on, hole_on = min(stray, 0.4), min(hole, 0.4), min(stray_on, 0.9), min(hole_on, 0.9)
    elsewhere = (1 - _BEYOND_ON) / 2  # beyond the end: seen elsewhere, or missing
    nats_off = np.where(broken, np.log(stray_on / elsewhere), np.log(stray / elsewhere))
    nats_on = np.where(broken, np.log((1 - stray_on) / _BEYOND_ON), np.log((1 - stray - hole) / _BEYOND_ON))
    at_point = np.where(on, nats_on, np.minimum(nats_off, 0.0))
    in_hole = np.log(hole / elsewhere) + (missing - 1) * np.log(hole_on / (1 - _BEYOND_ON))
    after_point = np.where(missing > 0, np.minimum(in_hole, 0.0), 0.0)
    at_point = np.where(beyond_it, np.log(_BEYOND_ON), at_point)
    total = np.cumsum(at_point + np.append(0.0, after_point[:-1]))
    return total, float(after_point[-1])

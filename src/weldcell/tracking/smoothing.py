"""A robust smoothing curve through noisy points in space, as smooth as the points' own scatter calls for."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline
from scipy.linalg import cholesky, eigh, solve_triangular

_DEGREE = 3
_POINTS_A_KNOT = 4
_MOST_INTERVALS = 60
_PENALTY_ORDER = 3  # quadratics are free: the curve is not drawn straight at its ends
_LEAST_SMOOTHNESS = 1e-4  # of the penalty, against the data: knots in a gap without points stay determined
_SMOOTHNESS = np.append(0.0, np.logspace(-4, 14, 73))
_TUKEY = 4.685
_ROUNDS = 8
_MEDIAN_LENGTH = 1.538  # of a vector of three standard normal numbers
_LEAST_SPREAD_M = 1e-6  # closer than this no point is a stray
_LINE_POINTS = 11


@dataclass(frozen=True, kw_only=True)
class SmoothCurve:
    """A smoothing curve, and how far its points lie from it."""

    curve: BSpline
    """From the parameter to points (..., 3)."""
    scatter_m: float
    """Standard deviation of one coordinate of a point of weight one."""
    weight: Float[np.ndarray, "n"]
    """Robust weight of each point: 1 for one of the bulk, 0 for a stray."""


def smooth_curve(
    parameter: Float[np.ndarray, "n"], points: Float[np.ndarray, "n 3"], weight: Float[np.ndarray, "n"]
) -> SmoothCurve:
    """The penalised B-spline (Eilers and Marx 1996) through points with these weights (1 / variance, any scale).

    Its smoothness is the one of greatest restricted likelihood (REML; Wood 2011 finds it less prone to undersmooth
    than cross-validation), one for all three coordinates, so that the curve turns with the frame. Strays lose
    their weight by Tukey's biweight on the distance from the curve. At least four points are needed.
    """
    weight = weight / weight.mean()
    middle = points.mean(axis=0)
    knots = _knots(parameter)
    basis = BSpline.design_matrix(parameter, knots, _DEGREE).toarray()
    differences = np.diff(np.eye(basis.shape[1]), n=_PENALTY_ORDER, axis=0)
    penalty = differences.T @ differences
    robust = _first_weight(parameter, points)
    coefficients, scatter = np.zeros((basis.shape[1], 3)), 0.0
    for _ in range(_ROUNDS):
        coefficients, scatter = _penalised_fit(basis, penalty, points - middle, weight * robust)
        distance = np.linalg.norm(points - middle - basis @ coefficients, axis=1) * np.sqrt(weight)
        spread = max(float(np.median(distance[robust > 0])) / _MEDIAN_LENGTH, _LEAST_SPREAD_M)
        fresh = np.maximum(1 - (distance / (_TUKEY * spread)) ** 2, 0) ** 2
        settled = np.abs(fresh - robust).max() < 0.01
        robust = fresh
        if settled:
            break
    return SmoothCurve(curve=BSpline(knots, coefficients + middle, _DEGREE), scatter_m=scatter, weight=robust)


def _knots(parameter: Float[np.ndarray, "n"]) -> Float[np.ndarray, "k"]:
    """Even knots, going on beyond both ends: only so are the penalty's free curves the quadratics."""
    intervals = int(np.clip(len(parameter) // _POINTS_A_KNOT, 1, _MOST_INTERVALS))
    start, end = parameter.min(), parameter.max()
    knots = start + (end - start) / intervals * np.arange(-_DEGREE, intervals + _DEGREE + 1)
    knots[[_DEGREE, -_DEGREE - 1]] = start, end  # exactly, or rounding leaves an end point outside
    return knots


def _first_weight(parameter: Float[np.ndarray, "n"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Zero for points far from the Theil-Sen line of their neighbours (median of all slopes), one for the others."""
    count = len(points)
    size = min(_LINE_POINTS, count)
    start = np.clip(np.arange(count) - size // 2, 0, count - size)
    window = start[:, None] + np.arange(size)
    first, second = np.triu_indices(size, 1)
    steps = parameter[window[:, second]] - parameter[window[:, first]]
    slopes = np.median((points[window[:, second]] - points[window[:, first]]) / steps[..., None], axis=1)
    offsets = points[window] - slopes[:, None] * parameter[window][..., None]
    expected = np.median(offsets, axis=1) + slopes * parameter[:, None]
    distance = np.linalg.norm(points - expected, axis=1)
    return (distance <= max(6 * float(np.median(distance)), _LEAST_SPREAD_M)).astype(float)


def _penalised_fit(
    basis: Float[np.ndarray, "n k"],
    penalty: Float[np.ndarray, "k k"],
    points: Float[np.ndarray, "n 3"],
    weight: Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "k 3"], float]:
    """Coefficients of the smoothness with the greatest restricted likelihood, and the scatter it estimates.

    In the basis that diagonalises data and penalty (Demmler and Reinsch 1975) every smoothness is a vector:
    the k-th component shrinks by 1 / (1 + lambda s_k), lambda being what is added to the least smoothness.
    """
    gram = basis.T @ (weight[:, None] * basis)
    unit = np.trace(gram) / np.trace(penalty)
    factor = cholesky(gram + _LEAST_SMOOTHNESS * unit * penalty, lower=True)
    half = solve_triangular(factor, unit * penalty, lower=True)
    strength, axes = eigh(solve_triangular(factor, half.T, lower=True))
    strength[:_PENALTY_ORDER] = 0.0  # quadratics
    moments = axes.T @ solve_triangular(factor, basis.T @ (weight[:, None] * points), lower=True)
    energy = float(weight @ (points**2).sum(axis=1))
    shrink = 1 / (1 + _SMOOTHNESS[:, None] * np.maximum(strength, 0.0))
    left_over = np.maximum(energy - shrink @ (moments**2).sum(axis=1), 1e-15 * energy + 1e-300)
    degrees = 3 * max(int((weight > 0).sum()) - _PENALTY_ORDER, 1)
    held = (_SMOOTHNESS + _LEAST_SMOOTHNESS)[:, None] * shrink[:, _PENALTY_ORDER:]
    best = int((degrees * np.log(left_over) - 3 * np.log(held).sum(axis=1)).argmin())
    coefficients = solve_triangular(factor, axes @ (shrink[best][:, None] * moments), lower=True, trans="T")
    return coefficients, float(np.sqrt(left_over[best] / degrees))

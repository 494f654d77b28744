"""Circles in a plane: through three points, through many, and how far points are from them.

A circle is three numbers: its centre's two coordinates and its radius, all in the unit of the points.
"""

import numpy as np
from jaxtyping import Float, Int


def circles_through(
    points: Float[np.ndarray, "n 2"],
    first: Int[np.ndarray, "k"],
    second: Int[np.ndarray, "k"],
    third: Int[np.ndarray, "k"],
) -> Float[np.ndarray, "used 3"]:
    """Centre and radius of the circles through three points each; collinear triples are left out."""
    origin = points[first]
    a, b = points[second] - origin, points[third] - origin
    twice_area = 2 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    a, b, origin, twice_area = (value[np.abs(twice_area) > 1e-15] for value in (a, b, origin, twice_area))
    a2, b2 = np.sum(a**2, axis=1), np.sum(b**2, axis=1)
    x = (b[:, 1] * a2 - a[:, 1] * b2) / twice_area
    y = (a[:, 0] * b2 - b[:, 0] * a2) / twice_area
    return np.column_stack([origin[:, 0] + x, origin[:, 1] + y, np.hypot(x, y)])


def algebraic_circle(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "3"]:
    """Kasa's circle: least squares on |p|^2 = 2 c.p + k; a start only, it shrinks short noisy arcs."""
    middle = points.mean(axis=0)
    local = points - middle
    size = np.sqrt(np.mean(local**2))
    design = np.column_stack([2 * local, np.full(len(local), size)])
    x, y, k = np.linalg.lstsq(design.T @ design, design.T @ np.sum(local**2, axis=1), rcond=1e-13)[0] * [1, 1, size]
    return np.array([x + middle[0], y + middle[1], np.sqrt(max(k + x * x + y * y, 0.0))])


def radial_distance(points: Float[np.ndarray, "n 2"], circle: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n"]:
    """Distance of points from the circle, positive outside."""
    x, z = points[:, 0] - circle[0], points[:, 1] - circle[1]
    return np.sqrt(x * x + z * z) - circle[2]


def agreeing_points(
    points: Float[np.ndarray, "n 2"], gates_m: Float[np.ndarray, "n"], circles: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k"]:
    """How many points lie within their gates of each circle; d^2 - r^2 stands for 2 r (d - r), without a root."""
    x, z, radii_m = points[:, 0] - circles[:, :1], points[:, 1] - circles[:, 1:2], circles[:, 2:]
    return np.sum(np.abs(x * x + z * z - radii_m**2) < 2 * radii_m * gates_m, axis=1).astype(float)


def circle_residuals(
    arc: Float[np.ndarray, "k 2"], sigma_m: Float[np.ndarray, "k"], circle: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "k 1"], Float[np.ndarray, "k 1 3"]]:
    """Radial distances in sigmas, and their derivatives by the circle: for `least_squares.fit`."""
    offsets = arc - circle[:2]
    distances = np.hypot(offsets[:, 0], offsets[:, 1])
    residuals = (distances - circle[2]) / sigma_m
    jacobian = np.column_stack([-offsets / distances[:, None], -np.ones(len(arc))]) / sigma_m[:, None]
    return residuals[:, None], jacobian[:, None]

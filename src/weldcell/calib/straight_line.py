"""The straight line that most of some points lie on."""

import numpy as np
from jaxtyping import Bool, Float

from weldcell.cell.errors import BadInput

_ROUNDS = 5
_OUTLYING = 4.0  # robust standard deviations
_MAD = 1.4826  # from median absolute deviation to standard deviation
_FEWEST = 4


def fit_line(
    points: Float[np.ndarray, "n 2"], near: float
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"], Bool[np.ndarray, "n"]]:
    """A point of the line, its unit direction, and which points count (total least squares on the majority).

    The start is the pair of points half the set apart that has the most points within `near`: no draw, no start value.
    """
    count = len(points)
    if count < _FEWEST:
        raise BadInput(f"line: {count} points, expected at least {_FEWEST}")
    first = points[: count - count // 2]
    chords = points[count // 2 :][: len(first)] - first
    chords = chords / np.maximum(np.linalg.norm(chords, axis=1, keepdims=True), 1e-300)
    off = np.abs(
        (points[None, :, 0] - first[:, None, 0]) * chords[:, None, 1]
        - (points[None, :, 1] - first[:, None, 1]) * chords[:, None, 0]
    )
    best = int(np.argmax((off < near).sum(axis=1)))
    kept = off[best] < near
    for _ in range(_ROUNDS):
        middle = points[kept].mean(axis=0)
        direction = np.linalg.svd(points[kept] - middle, full_matrices=False)[2][0]
        away = np.abs((points - middle) @ [-direction[1], direction[0]])
        kept = away <= max(_OUTLYING * _MAD * float(np.median(away[kept])), 1e-6 * near)
        if kept.sum() < _FEWEST:
            raise BadInput("line: no four points lie on one")
    return middle, direction, kept


def crossing(
    line: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
    other: tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]],
) -> Float[np.ndarray, "2"]:
    """Where two lines (point and direction) cross."""
    (point, direction), (other_point, other_direction) = line, other
    share = np.linalg.solve(np.column_stack([direction, -other_direction]), other_point - point)
    return np.asarray(point + share[0] * direction)

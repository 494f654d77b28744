"""What is too faint to be found anywhere in its column, but lies where the stripe beside it leads.

Among a thousand rows a noise of 4.5 sigma turns up by chance, so a lone column needs a clear signal. On the path
between columns that have one, only a few rows come into question, and half the signal will do. Speckle leaves every
other column of a noisy picture that dark.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

REACH_PX = 12
"""Columns so far from clear ones may be faint."""
_BAND_CELLS = 2  # to either side of the path
_SUPPORTERS, _SUPPORT_CELLS = 3, 4  # of the columns on both sides
_STEEPEST_CELLS = 1.5  # cells a cell column: 3 px a px
_STEEPEST, _SLACK_PX = 3.0, 4.0


def with_faint_cells(
    response: Shaped[np.ndarray, "rows k"],
    rows: Int[np.ndarray, "k"],
    seen: Bool[np.ndarray, "k"],
    faintest: float,
    reach: int,
) -> tuple[Int[np.ndarray, "k"], Bool[np.ndarray, "k"]]:
    """Rows and which cell columns are seen, with those that reach `faintest` near the path of the others."""
    sure = seen & (_supporters(np.where(seen, rows, -1_000_000)) >= _SUPPORTERS)
    others = np.flatnonzero(~seen)
    if len(others) == 0 or not sure.any():
        return rows, seen
    path = path_at(others, np.flatnonzero(sure), rows[sure].astype(np.float32), reach, _STEEPEST_CELLS, 2.0)
    others, path = others[path.near], path.at[path.near]
    if len(others) == 0:
        return rows, seen
    step = np.arange(-_BAND_CELLS, _BAND_CELLS + 1)[:, None]
    near = np.clip(np.rint(path).astype(np.int64) + step, 0, len(response) - 1)
    nearby = response.ravel().take(near * response.shape[1] + others)
    best = nearby.argmax(axis=0)
    each = np.arange(len(others))
    enough = nearby[best, each] > faintest
    rows, seen = rows.copy(), seen.copy()
    rows[others[enough]], seen[others[enough]] = near[best, each][enough], True
    return rows, seen


def _supporters(rows: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
    """How many of the cell columns beside each hold a place that one stripe could join with its own."""
    count = np.zeros(len(rows), np.int64)
    for step in range(1, min(_SUPPORT_CELLS, len(rows) - 1) + 1):
        joined = np.abs(rows[step:] - rows[:-step]) <= 1 + _STEEPEST_CELLS * step
        count[step:] += joined
        count[:-step] += joined
    return count


@dataclass(frozen=True, kw_only=True)
class Path:
    """Where the stripe should be, between the places where it is."""

    at: Float32[np.ndarray, "m"]
    near: Bool[np.ndarray, "m"]
    """Whether there is a known place near enough."""


def path_at(
    columns: Int[np.ndarray, "m"],
    known: Int[np.ndarray, "n"],
    places: Float[np.ndarray, "n"],
    reach: int,
    steepest: float = _STEEPEST,
    slack: float = _SLACK_PX,
) -> Path:
    """Places interpolated between known columns; the nearer one's where they don't join, or beyond the last."""
    after = np.searchsorted(known, columns)
    left, right = np.maximum(after - 1, 0), np.minimum(after, len(known) - 1)
    gap = np.maximum(known[right] - known[left], 1)
    share = np.clip((columns - known[left]) / gap, 0, 1)
    rise = places[right] - places[left]
    joined = (np.abs(rise) <= steepest * gap + slack) & (gap <= 2 * reach)
    share = np.where(joined, share, np.rint(share))
    away = np.minimum(np.abs(columns - known[left]), np.abs(known[right] - columns))
    return Path(at=(places[left] + share * rise).astype(np.float32), near=away <= reach)

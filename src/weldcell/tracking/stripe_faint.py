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
STEEPEST_CELLS = 1.5
"""Rows of cells a column of them that a stripe may climb: 3 px a px."""
_BAND_CELLS = 2  # to either side of the path
_SLACK_CELLS = 2.0
_JUMP_CELLS = 3  # columns from a jump to where the path is sure
_STEEPEST, _SLACK_PX = 3.0, 4.0


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
    share = (columns - known[left]) / gap
    rise = places[right] - places[left]
    joined = (np.abs(rise) <= steepest * gap + slack) & (gap <= 2 * reach)
    share = np.where(joined, share, np.rint(share))
    away = np.minimum(np.abs(columns - known[left]), np.abs(known[right] - columns))
    return Path(at=(places[left] + share * rise).astype(np.float32), near=away <= reach)


@dataclass(frozen=True, kw_only=True)
class Places:
    """A row for each cell column."""

    rows: Int[np.ndarray, "k"]
    near: Bool[np.ndarray, "k"]
    """Whether the path passes near enough."""


def beside(
    response: Shaped[np.ndarray, "rows k"], columns: Int[np.ndarray, "n"], rows: Int[np.ndarray, "n"], reach_cells: int
) -> Places:
    """The brightest place of each cell column beside the path through `rows` at `columns`.

    Where the path jumps is not known to the column, so that both of its ends are looked at there.
    """
    each = np.arange(response.shape[1])
    path = path_at(each, columns, rows.astype(np.float32), reach_cells, STEEPEST_CELLS, _SLACK_CELLS)
    best = _brightest_in_band(response, each, path.at)
    before, after = path.at[np.maximum(each - _JUMP_CELLS, 0)], path.at[np.minimum(each + _JUMP_CELLS, each[-1])]
    jump = np.flatnonzero(np.abs(after - before) > 2 * _JUMP_CELLS * STEEPEST_CELLS + _SLACK_CELLS)
    for side in (before, after) if len(jump) else ():
        other = _brightest_in_band(response, jump, side[jump])
        better = response[other, jump] > response[best[jump], jump]
        best[jump[better]] = other[better]
    return Places(rows=best, near=path.near)


def _brightest_in_band(
    response: Shaped[np.ndarray, "rows k"], columns: Int[np.ndarray, "m"], at: Float32[np.ndarray, "m"]
) -> Int[np.ndarray, "m"]:
    step = np.arange(-_BAND_CELLS, _BAND_CELLS + 1)[:, None]
    band = np.minimum(np.maximum(np.rint(at).astype(np.int64) + step, 0), len(response) - 1)
    best = response.ravel().take(band * response.shape[1] + columns).argmax(axis=0)
    return band[best, np.arange(len(columns))]

"""The stripe's pieces on the levels of a step target, and their ends at the edges (for `dual_step`).

A piece is the stripe between two jumps. Blur spreads its end evenly to both sides, so that the light, summed across
the stripe, is down to half there. But speckle makes light of any strength uncertain by its own size, and the dark
beyond not: the place where it is down to a quarter is found, and the way back from there is known by the blur.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Int, Shaped

_JUMP_PX = 3.0
_GAP_PX = 6
_CRUMB = 5  # points
_STEEPEST, _WIDEST_GAP_PX = 0.6, 40  # of a piece with gaps in it
_LEAST_SHARE = 0.04  # of the picture's length: shorter pieces are walls and crumbs
_TRIM_PX = 8  # at a piece's ends, where its neighbour may pull
_OUTLYING = 4.0
_ACROSS_PX = 5  # to either side of the centre for the brightness
_BACKGROUND_PX = (9, 16)
_INSIDE_PX, _BEYOND_PX, _SLACK_PX = 30, 12, 3  # of the rough end: looked at, and how far it may be too far out
_FAINT_SHARE, _FAINT_BEYOND_SIGMAS = 0.25, 0.674  # a blurred edge is down to a quarter 0.674 sigma beyond its middle
_BLUR_PX = 0.8  # of a lens in focus with its pixels, one sigma; half as much or twice as much moves ends by 0.4 px
_FEWEST = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class StepPieces:
    """What one picture shows of a target."""

    pixels: Float[np.ndarray, "n 2"]
    level: Int[np.ndarray, "n"]
    """Which level the point lies on, counted along the target's x."""
    edge: Int[np.ndarray, "n"]
    """Which edge the point ends a piece at; -1 for points within a level."""
    sigma_px: Float[np.ndarray, "n"]
    """Standard deviation across the stripe."""


def step_pieces(
    image: Shaped[np.ndarray, "height width"],
    stripe_px: Float[np.ndarray, "n 2"],
    sigma_px: Float[np.ndarray, "n"],
    *,
    along: Literal["rows", "columns"],
    forward: int,
    levels: int,
    ends: tuple[tuple[int, int], ...],
    every: int = 1,
) -> StepPieces | None:
    """Points and ends of the stripe's pieces on a target of some levels; None if other than that many pieces are seen.

    `forward` is +1 where the target's x runs with growing columns (rows, for a stripe along columns), `ends` names
    (level, edge) of the ends that no wall hides, `every` thins the points within the levels.
    """
    axis = 0 if along == "rows" else 1
    grey = np.asarray(image if along == "rows" else image.T, dtype=np.float32)
    order = np.argsort(stripe_px[:, axis], kind="stable")
    place, across, sigma_px = stripe_px[order, axis], stripe_px[order, 1 - axis], sigma_px[order]
    pieces = _pieces(place, across)
    least = max(_LEAST_SHARE * grey.shape[1], 2 * _TRIM_PX + _FEWEST)
    pieces = [piece for piece in pieces if len(piece) >= least]
    if len(pieces) != levels:
        return None
    rows: list[tuple[float, float, int, int, float]] = []
    for number, piece in enumerate(pieces):
        level = number if forward > 0 else levels - 1 - number
        inner = piece[_TRIM_PX:-_TRIM_PX]
        curve, sound = _smooth_curve(place[inner], across[inner])
        rows += [(place[k], across[k], level, -1, sigma_px[k]) for k in inner[sound][::every]]
        for end_level, edge in ends:
            if end_level == level:
                side = forward if edge > level else -forward
                end = _end(grey, curve, float(place[piece[-1 if side > 0 else 0]]), side)
                if np.isfinite(end):
                    rows.append((end, float(curve(end)), level, edge, float(np.median(sigma_px[inner]))))
    found = np.array(rows)
    pixels = found[:, :2] if along == "rows" else found[:, 1::-1]
    return StepPieces(pixels=pixels, level=found[:, 2].astype(int), edge=found[:, 3].astype(int), sigma_px=found[:, 4])


def _pieces(place: Float[np.ndarray, "n"], across: Float[np.ndarray, "n"]) -> list[Int[np.ndarray, "k"]]:
    """Points of each piece, in order; crumbs are left out first, and what goes on behind a gap is joined again."""
    if len(place) == 0:
        return []
    jumps = np.abs(np.diff(across)) > _JUMP_PX
    crumbs = np.split(np.arange(len(place)), np.flatnonzero(jumps | (np.diff(place) > _GAP_PX)) + 1)
    kept = [crumb for crumb in crumbs if len(crumb) >= _CRUMB]
    if not kept:
        return []
    points = np.concatenate(kept)
    gap = np.diff(place[points])
    jumps = np.abs(np.diff(across[points])) > _JUMP_PX + _STEEPEST * gap
    return np.split(points, np.flatnonzero(jumps | (gap > _WIDEST_GAP_PX)) + 1)


def _smooth_curve(
    place: Float[np.ndarray, "n"], across: Float[np.ndarray, "n"]
) -> tuple[np.polynomial.Polynomial, Shaped[np.ndarray, "n"]]:
    """A parabola (the lens bends lines) through a piece, and which points lie on it."""
    sound = np.ones(len(place), bool)
    for _ in range(3):
        curve = np.polynomial.Polynomial.fit(place[sound], across[sound], 2)
        away = np.abs(across - curve(place))
        sound = away <= max(_OUTLYING * 1.4826 * float(np.median(away)), 1e-6)
    return curve, sound


def _end(grey: Float[np.ndarray, "height width"], curve: np.polynomial.Polynomial, rough: float, side: int) -> float:
    """Where the piece ends near `rough`, towards `side`; NaN if the picture ends first or nothing does."""
    places = np.rint(rough) + side * np.arange(-_INSIDE_PX, _BEYOND_PX + 1.0)
    if places.min() < 0 or places.max() > grey.shape[1] - 1:
        return np.nan
    offsets = np.arange(-_BACKGROUND_PX[1], _BACKGROUND_PX[1] + 1.0)[:, None]
    u = np.broadcast_to(places, (len(offsets), len(places))).astype(np.float32)
    v = (curve(places) + offsets).astype(np.float32)
    band = cv2.remap(grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    outside = np.abs(offsets[:, 0]) >= _BACKGROUND_PX[0]
    light = (band[np.abs(offsets[:, 0]) <= _ACROSS_PX] - np.median(band[outside], axis=0)).sum(axis=0)
    faint = _FAINT_SHARE * float(np.mean(light[: _INSIDE_PX - _SLACK_PX]))
    dark = light < faint
    gone = (
        dark[_INSIDE_PX - _SLACK_PX : -2] & dark[_INSIDE_PX - _SLACK_PX + 1 : -1] & dark[_INSIDE_PX - _SLACK_PX + 2 :]
    )
    if not gone.any() or faint <= 0:
        return np.nan
    k = int(np.argmax(gone)) + _INSIDE_PX - _SLACK_PX
    if dark[k - 1]:
        return np.nan
    share = float((light[k - 1] - faint) / (light[k - 1] - light[k]))
    return float(places[k - 1] + side * (share - _FAINT_BEYOND_SIGMAS * _BLUR_PX))

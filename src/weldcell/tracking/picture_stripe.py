"""The stripe in a picture of which little is known: which colour the laser has, which way it runs, how wide it is."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from weldcell.cell.profile import Stripe
from weldcell.tracking.stripe import Along, find_stripe

LaserColour = Literal["red", "green", "blue", "mono"]
"""Of the laser's light; mono: the picture's brightness tells."""

_COLOURS: tuple[LaserColour, ...] = ("red", "green", "blue")
_SHRINKINGS = (1, 2, 4, 8)  # a stripe may be eight times as wide as `find_stripe` knows
_LEAST_SIDE_PX = 64
_FINER_SHARE = 0.8  # of the clearest stripe's length: then the finer picture is as good
_COLOURED_SHARE = 0.5  # brightness alone sees other things too, so it must see far more
_WORTH_SHARE = 0.5  # of the longest way's length: what is shorter is another thing
_PIECE_GAP_PX = 16  # speckle on bare metal leaves some columns dark
_PIECE_JUMP_PX = 6
_LEAST_DENSITY = 0.8  # points for a pixel of a piece: speckle leaves more than 0.8 of them
_STEEPEST = 2.5  # across for along, over such a gap
_LEAST_PIECE_PX = 24.0  # no stripe is shorter, nor than this share of the picture's shorter side:
_LEAST_STRIPE_SHARE = 0.1
_FEWEST_POINTS, _FEWEST_SHARE = 96, 0.6  # of the longest piece, or of its picture's side: a board's corners make crumbs
_LEAST_PIECE_SHARE = 0.05  # of the longest piece: shorter ones are crumbs of what else is in view
_CHUNK = 16  # points that tell a direction
_DIRECTIONS = 36
_LEAST_TURN_RAD = np.deg2rad(8)
_THICKEST_PX = 25  # a stripe of 4 px sigma
_FULL_SHARE = 0.98
_BORDER_PX = 4  # beside the edge of a turned picture


@dataclass(frozen=True, kw_only=True)
class PictureStripe:
    """A picture's stripe, and how it was found."""

    stripe: Stripe
    """In pixels of the picture."""
    direction_rad: float
    """The way it was followed: 0 is along the rows, a quarter turn along the columns, between them diagonally."""
    colour: LaserColour
    shrinking: int
    """How many pixels were made one before: a wide stripe is found in a smaller picture."""


def stripes_in_picture(
    picture: Shaped[np.ndarray, "height width *channels"],
    *,
    colour: LaserColour | Literal["auto"] = "auto",
    along: Along | Literal["auto"] = "auto",
) -> list[PictureStripe]:
    """The stripe of a grey or RGB picture of 8 or 16 bits, followed in each way that shows much of it, the best first.

    Never empty, but the stripe has no points if there is none. "auto" tries each colour and each direction.
    """
    by_shrinking = [_ways(views, along) for views in _shrunk(picture, colour)]
    lengths = [_clear_length_px(ways[0]) for ways in by_shrinking]
    ways = next(ways for ways, px in zip(by_shrinking, lengths, strict=True) if px >= _FINER_SHARE * max(lengths))
    worth = [way for way in ways if _clear_length_px(way) >= _WORTH_SHARE * _clear_length_px(ways[0])]
    side_px = min(picture.shape[:2])
    least_px = max(_LEAST_PIECE_PX, _LEAST_STRIPE_SHARE * side_px)
    return [
        _without_crumbs(way, max(least_px, min(_FEWEST_POINTS * way.shrinking, _FEWEST_SHARE * side_px)))
        for way in worth
    ]


@dataclass(frozen=True, kw_only=True)
class _View:
    """The grey picture that one colour of laser light leaves."""

    colour: LaserColour
    shrinking: int
    image: Shaped[np.ndarray, "height width"]
    """Only what is thinner than 25 px is left of the surroundings."""


def _shrunk(
    picture: Shaped[np.ndarray, "height width *channels"], colour: LaserColour | Literal["auto"]
) -> Iterator[list[_View]]:
    for shrinking in _SHRINKINGS:
        rows, columns = picture.shape[0] // shrinking, picture.shape[1] // shrinking
        if shrinking == 1:
            yield _views(picture, colour, 1)
        elif min(rows, columns) >= _LEAST_SIDE_PX:
            whole = picture[: rows * shrinking, : columns * shrinking]
            yield _views(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), colour, shrinking)


def _views(
    picture: Shaped[np.ndarray, "height width *channels"], colour: LaserColour | Literal["auto"], shrinking: int
) -> list[_View]:
    """One for each colour that the laser may have."""
    if picture.ndim == 2:
        return [_View(colour="mono", shrinking=shrinking, image=cv2.subtract(picture, _surroundings(picture)))]
    channels = cv2.split(picture)
    views = []
    for index, name in enumerate(_COLOURS):
        if colour in (name, "auto"):
            image = _coloured_light(channels[index], channels[index - 1], channels[index - 2])
            views.append(_View(colour=name, shrinking=shrinking, image=image))
    if colour in ("mono", "auto"):
        brightness = cv2.transform(picture, np.full((1, 3), 1 / 3))
        light = cv2.subtract(brightness, _surroundings(brightness))
        views.append(_View(colour="mono", shrinking=shrinking, image=light))
    return views


def _surroundings(grey: Shaped[np.ndarray, "height width"]) -> Shaped[np.ndarray, "height width"]:
    """The picture without what is bright and thin (morphological opening; Serra 1982).

    It keeps patches and their edges in place: a board behind the stripe goes away without moving its centre.
    """
    return cv2.morphologyEx(grey, cv2.MORPH_OPEN, np.ones((_THICKEST_PX, _THICKEST_PX), np.uint8))


def _coloured_light(
    own: Shaped[np.ndarray, "height width"],
    first: Shaped[np.ndarray, "height width"],
    second: Shaped[np.ndarray, "height width"],
) -> Shaped[np.ndarray, "height width"]:
    """What one channel shows more than the other two, so that thin grey things vanish as well.

    Where its own channel is full, a stripe's core may fill the others too; the difference would have a hole there.
    """
    coloured = cv2.subtract(own, cv2.addWeighted(first, 0.5, second, 0.5, 0))
    full = own >= _FULL_SHARE * np.iinfo(own.dtype).max
    coloured[full] = own[full]
    return cv2.min(coloured, cv2.subtract(own, _surroundings(own)))


def _ways(views: list[_View], along: Along | Literal["auto"]) -> list[PictureStripe]:
    """The stripe in the view that shows the longest one, followed in each direction, the longest first."""
    axes = {"rows": (0.0,), "columns": (np.pi / 2,), "auto": (0.0, np.pi / 2)}[along]
    by_view = [_longest_first([_followed(view, direction) for direction in axes]) for view in views]
    lengths = np.array([_clear_length_px(ways[0]) for ways in by_view])
    lengths *= [_COLOURED_SHARE if view.colour == "mono" else 1.0 for view in views]
    best = int(lengths.argmax())
    if along != "auto":
        return by_view[best]
    return _longest_first(by_view[best] + _diagonals(views[best], by_view[best][0]))


def _longest_first(ways: list[PictureStripe]) -> list[PictureStripe]:
    return sorted(ways, key=_clear_length_px, reverse=True)


def _diagonals(view: _View, seen: PictureStripe) -> list[PictureStripe]:
    """The stripe followed along the two directions in which most of it runs, if those are diagonal."""
    chunks, _ = _chords(seen, _pieces(seen))
    if not len(chunks):
        return []
    angle_rad = np.mod(np.arctan2(chunks[:, 1], chunks[:, 0]), np.pi)
    share, edges = np.histogram(angle_rad, _DIRECTIONS, (0, np.pi), weights=np.hypot(*chunks.T))
    tried_rad = []
    for strongest in np.argsort(share)[::-1][:2]:
        near = np.abs(_turn(angle_rad, edges[strongest : strongest + 2].mean())) < np.pi / _DIRECTIONS
        middle_rad = float(np.median(angle_rad[near])) if near.any() else 0.0
        if abs(_turn(np.array(middle_rad), np.round(middle_rad / (np.pi / 2)) * np.pi / 2)) > _LEAST_TURN_RAD:
            tried_rad.append(middle_rad - np.pi if middle_rad > np.pi / 2 else middle_rad)
    return [_followed(view, angle) for angle in tried_rad]


def _turn(angle_rad: Float[np.ndarray, "*n"], from_rad: float) -> Float[np.ndarray, "*n"]:
    """Angle between two lines, within a quarter turn."""
    return np.asarray(np.mod(angle_rad - from_rad + np.pi / 2, np.pi) - np.pi / 2)


def _followed(view: _View, direction_rad: float) -> PictureStripe:
    """The stripe as seen with this direction along the rows."""
    if direction_rad == 0:
        stripe = find_stripe(view.image, along="rows")
    elif direction_rad == np.pi / 2:
        stripe = find_stripe(view.image, along="columns")
    else:
        stripe = _stripe_of_turned(view, direction_rad)
    return PictureStripe(
        stripe=Stripe(
            u_px=(stripe.u_px + 0.5) * view.shrinking - 0.5,
            v_px=(stripe.v_px + 0.5) * view.shrinking - 0.5,
            sigma_px=stripe.sigma_px * view.shrinking,
        ),
        direction_rad=direction_rad,
        colour=view.colour,
        shrinking=view.shrinking,
    )


def _stripe_of_turned(view: _View, direction_rad: float) -> Stripe:
    """The stripe of the picture turned so that this direction is level, in pixels of the picture as it was."""
    height, width = view.image.shape
    cos, sin = np.cos(direction_rad), np.sin(direction_rad)
    rotation = np.array([[cos, sin], [-sin, cos]])
    corners = np.array([[0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]]) @ rotation.T
    first = np.floor(corners.min(axis=0))
    size = np.ceil(corners.max(axis=0) - first).astype(int) + 1
    onto = np.column_stack([rotation, -first])
    image = cv2.warpAffine(view.image, onto, size.tolist(), flags=cv2.INTER_CUBIC)
    turned = find_stripe(image)
    u_px, v_px = ((np.column_stack([turned.u_px, turned.v_px]) + first) @ rotation).T
    inside = (u_px >= _BORDER_PX) & (u_px <= width - 1 - _BORDER_PX)
    inside &= (v_px >= _BORDER_PX) & (v_px <= height - 1 - _BORDER_PX)
    return Stripe(u_px=u_px[inside], v_px=v_px[inside], sigma_px=turned.sigma_px[inside])


def _clear_length_px(found: PictureStripe) -> float:
    """Root of the sum of the squared lengths of the stripe's pieces: a long one counts more than many crumbs."""
    lengths = _piece_lengths_px(found)
    return float(np.sqrt(lengths @ lengths))


def _piece_lengths_px(found: PictureStripe) -> Float[np.ndarray, "pieces"]:
    """Lengths of the pieces: points times the mean length from one to the next, taken over 16 of them against noise.

    A piece with many holes (edges of a board that happen to lie in a row) is none: 0.
    """
    piece = _pieces(found)
    if not len(piece):
        return np.zeros(1)
    count = np.bincount(piece)
    chords, of_piece = _chords(found, piece)
    chord_count = np.bincount(of_piece, minlength=len(count))
    mean_px = np.bincount(of_piece, weights=np.hypot(*chords.T), minlength=len(count)) / np.maximum(chord_count, 1)
    dense = count >= _LEAST_DENSITY * _extents_px(found, piece) / found.shrinking
    return dense * count * np.where(chord_count > 0, mean_px / _CHUNK, found.shrinking)


def _extents_px(found: PictureStripe, piece: Int[np.ndarray, "n"]) -> Float[np.ndarray, "pieces"]:
    """How far each piece reaches along the way it was followed."""
    along = _points(found) @ [np.cos(found.direction_rad), np.sin(found.direction_rad)]
    first, last = np.full(piece.max() + 1, np.inf), np.full(piece.max() + 1, -np.inf)
    np.minimum.at(first, piece, along)
    np.maximum.at(last, piece, along)
    return last - first


def _pieces(found: PictureStripe) -> Int[np.ndarray, "n"]:
    """The number of the connected piece that each point of the stripe belongs to.

    Single points beside the others (a ghost, spatter) do not break a piece; they are pieces of their own.
    """
    count = len(found.stripe.u_px)
    if count == 0:
        return np.zeros(0, np.int64)
    points = _points(found)
    broken = _broken(points, found)
    alone = np.append(True, broken) & np.append(broken, True)
    piece = np.empty(count, np.int64)
    piece[~alone] = np.append(0, np.cumsum(_broken(points[~alone], found)))[: count - alone.sum()]
    piece[alone] = piece[~alone].max(initial=-1) + 1 + np.arange(alone.sum())
    return piece


def _broken(points: Float[np.ndarray, "n 2"], found: PictureStripe) -> Bool[np.ndarray, "m"]:
    """Whether the stripe ends between each point and the next: across a gap it may go on as steeply as walls do."""
    way = np.array([np.cos(found.direction_rad), np.sin(found.direction_rad)])
    along, across = np.diff(points @ way), np.diff(points @ [-way[1], way[0]])
    gap = np.maximum(along - found.shrinking, 0)
    jump = np.abs(across) > _PIECE_JUMP_PX * found.shrinking + _STEEPEST * gap
    return (along > _PIECE_GAP_PX * found.shrinking) | jump


def _chords(found: PictureStripe, piece: Int[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "m 2"], Int[np.ndarray, "m"]]:
    """From each point to the sixteenth after it, where that is on the same piece, and the piece."""
    points = _points(found)
    same = piece[_CHUNK:] == piece[:-_CHUNK]
    return (points[_CHUNK:] - points[:-_CHUNK])[same], piece[_CHUNK:][same]


def _points(found: PictureStripe) -> Float[np.ndarray, "n 2"]:
    return np.column_stack([found.stripe.u_px, found.stripe.v_px])


def _without_crumbs(found: PictureStripe, least_px: float) -> PictureStripe:
    """The stripe without its short pieces; without any, if even its longest one is too short for a stripe."""
    piece, lengths = _pieces(found), _piece_lengths_px(found)
    longest = lengths.max()
    keep = (lengths >= max(_LEAST_PIECE_PX * found.shrinking, _LEAST_PIECE_SHARE * longest))[piece] & (
        longest >= least_px
    )
    stripe = found.stripe
    kept = Stripe(u_px=stripe.u_px[keep], v_px=stripe.v_px[keep], sigma_px=stripe.sigma_px[keep])
    return replace(found, stripe=kept)

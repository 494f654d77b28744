"""Panels of a sheet: whole pictures, magnified parts, and parts with labels drawn on top."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8
from PIL import Image, ImageDraw, ImageFont
from shots import Shot

from weldcell.sensor_sim.labels import StripeTruth
from weldcell.sensor_sim.seam_labels import Visibility

Panel = UInt8[np.ndarray, "height width 3"]

STRIPE_RGB, GHOST_RGB, FEATURE_RGB = (40, 220, 120), (70, 140, 255), (255, 215, 0)
VISIBILITY_RGB = {
    Visibility.SEEN: (40, 255, 140),
    Visibility.HIDDEN: (255, 120, 0),
    Visibility.NOT_LIT: (255, 60, 60),
}
_TINT = 0.35
_LIFTED = np.rint(255 * (np.arange(256) / 255) ** 0.5).astype(np.uint8)
_GAP_PX, _CAPTION_PX, _TEXT_PX, _TITLE_PX = 8, 24, 15, 20
_PAPER, _INK = (24, 24, 26), (225, 225, 225)
_FINE = 4  # binary digits of OpenCV's sub-pixel drawing


def whole(picture: Shaped[np.ndarray, "height width"], size: tuple[int, int]) -> Panel:
    """The whole picture, reduced to fit into `size` (width, height)."""
    scale = min(size[0] / picture.shape[1], size[1] / picture.shape[0])
    panel = _rgb(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    missing = np.array(size) - panel.shape[1::-1]
    return cv2.copyMakeBorder(panel, 0, missing[1], 0, missing[0], cv2.BORDER_CONSTANT, value=_PAPER)


def part(
    picture: Shaped[np.ndarray, "height width"], middle_px: tuple[float, float], size: tuple[int, int], zoom: int = 1
) -> Panel:
    """A part of `size` (width, height in the panel's pixels) about the middle, magnified without smoothing."""
    first, count = _window(picture, middle_px, size, zoom)
    cut = picture[first[1] : first[1] + count[1], first[0] : first[0] + count[0]]
    return _rgb(cv2.resize(cut, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST))


def labelled(shot: Shot, middle_px: tuple[float, float], size: tuple[int, int], zoom: int) -> Panel:
    """`part`, its dark parts lifted, with the labels on top.

    Masks are tinted, stripe centres coloured by visibility, the seam's features named. Columns (or rows) without a lit
    point have a tick at the panel's edge.
    """
    panel = _LIFTED[part(shot.picture, middle_px, size, zoom)]
    first, _ = _window(shot.picture, middle_px, size, zoom)
    for mask, colour in ((shot.truth.ghost_mask, GHOST_RGB), (shot.truth.stripe_mask, STRIPE_RGB)):
        covered = part(np.where(mask, np.uint8(255), np.uint8(0)), middle_px, size, zoom)[..., 0] > 0
        panel[covered] = np.rint((1 - _TINT) * panel[covered] + _TINT * np.array(colour)).astype(np.uint8)
    for kind in (Visibility.HIDDEN, Visibility.SEEN):
        chosen = shot.truth.stripe.visibility == kind
        _draw_points(panel, (shot.truth.stripe.pixels[chosen] - first + 0.5) * zoom - 0.5, VISIBILITY_RGB[kind])
    _draw_dark(panel, shot.truth.stripe, first, zoom)
    features = shot.truth.features
    for name, pixel, kind in zip(features.names, features.pixels, features.visibility, strict=True):
        if np.all(np.isfinite(pixel)):
            _draw_feature(panel, (pixel - first + 0.5) * zoom - 0.5, name, Visibility(kind))
    return panel


def captioned(panel: Panel, caption: str) -> Panel:
    """A panel with a line of text above it."""
    return np.vstack([_text_line(caption, panel.shape[1], _CAPTION_PX, _TEXT_PX), panel])


def sheet(title: str, rows: Sequence[Sequence[Panel]]) -> Panel:
    """Rows of panels of one height each, under a title if there is one."""
    lines = [_joined(row, axis=1) for row in rows]
    width = max(line.shape[1] for line in lines)
    padded = [_padded(line, width) for line in lines]
    heading = [_text_line(text, width, _TITLE_PX + 8, _TITLE_PX) for text in title.split("\n")]
    return _framed(_joined([np.vstack(heading), *padded] if title else padded, axis=0))


def _window(
    picture: Shaped[np.ndarray, "height width"], middle_px: tuple[float, float], size: tuple[int, int], zoom: int
) -> tuple[np.ndarray, np.ndarray]:
    """First pixel (u, v) and size in pixels of a part that lies within the picture."""
    count = np.array(size) // zoom
    largest = np.array(picture.shape[::-1]) - count
    return np.clip(np.rint(np.array(middle_px) - count / 2), 0, largest).astype(int), count


def _draw_points(panel: Panel, points: Float[np.ndarray, "n 2"], colour: tuple[int, int, int]) -> None:
    inside = np.all((points >= 0) & (points < np.array(panel.shape[1::-1])), axis=1)
    for point in points[inside]:
        cv2.circle(panel, np.rint(point * 2**_FINE).astype(int).tolist(), 10, colour, -1, cv2.LINE_AA, _FINE)


def _draw_dark(panel: Panel, stripe: StripeTruth, first: np.ndarray, zoom: int) -> None:
    dark = stripe.pixels[stripe.visibility == Visibility.NOT_LIT]
    axis = 0 if np.isfinite(dark[:, 0]).all() else 1
    places = np.rint((dark[:, axis] - first[axis]) * zoom).astype(int)
    places = np.unique(places[(places >= 0) & (places < panel.shape[1 - axis] - zoom)])
    colour = VISIBILITY_RGB[Visibility.NOT_LIT]
    for place in places:
        if axis == 0:
            panel[-6:, place : place + zoom] = colour
        else:
            panel[place : place + zoom, -6:] = colour


def _draw_feature(panel: Panel, point: Float[np.ndarray, "2"], name: str, kind: Visibility) -> None:
    """A cross, open in the middle so that it hides nothing, and the name."""
    for colour, thickness in (((0, 0, 0), 3), (FEATURE_RGB, 1)):
        for step in (np.array([13.0, 0.0]), np.array([0.0, 13.0])):
            for side in (-1, 1):
                ends = np.rint(np.stack([point + side * step / 3, point + side * step]) * 2**_FINE).astype(int)
                cv2.line(panel, ends[0].tolist(), ends[1].tolist(), colour, thickness, cv2.LINE_AA, _FINE)
    text = name if kind == Visibility.SEEN else f"{name} ({kind.name.lower().replace('_', ' ')})"
    image = Image.fromarray(panel)
    place = (float(point[0]) + 12, float(point[1]) - 24)
    ImageDraw.Draw(image).text(
        place, text, fill=FEATURE_RGB, font=ImageFont.load_default(_TEXT_PX), stroke_width=2, stroke_fill=(0, 0, 0)
    )
    panel[:] = np.asarray(image)


def _text_line(text: str, width: int, height: int, size: int) -> Panel:
    image = Image.new("RGB", (width, height), _PAPER)
    ImageDraw.Draw(image).text((2, height / 2), text, fill=_INK, font=ImageFont.load_default(size), anchor="lm")
    return np.asarray(image)


def _joined(panels: Sequence[Panel], axis: int) -> Panel:
    shape = list(panels[0].shape)
    shape[axis] = _GAP_PX
    gap = np.broadcast_to(np.array(_PAPER, np.uint8), shape)
    spaced = [piece for panel in panels for piece in (gap, panel)][1:]
    return np.concatenate(spaced, axis=axis)


def _padded(panel: Panel, width: int) -> Panel:
    missing = width - panel.shape[1]
    return cv2.copyMakeBorder(panel, 0, 0, 0, missing, cv2.BORDER_CONSTANT, value=_PAPER)


def _framed(panel: Panel) -> Panel:
    return cv2.copyMakeBorder(panel, *([2 * _GAP_PX] * 4), cv2.BORDER_CONSTANT, value=_PAPER)


def _rgb(picture: Shaped[np.ndarray, "height width"]) -> Panel:
    """Grey as it is; 12 bits as the 8 that a screen shows."""
    grey = picture if picture.dtype == np.uint8 else np.rint(picture / 4095 * 255).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)

"""A picture of residuals: a bar for each picture or pose, outliers in red, and where in the picture they lie."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

_WIDTH_PX, _ROW_PX, _TOP_PX, _MARGIN_PX = 620, 20, 46, 12
_NAME_PX, _VALUE_PX = 190, 90
_LONGEST_NAME = 24
_MOST_ROWS = 60
_FIELD_PX = 620
_ARROW_PX = 40.0  # length at which the largest usual residual is drawn
_FONT, _SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.42
_INK, _BAR, _OUTLIER, _FRAME, _PAPER = (40, 40, 40), (170, 110, 40), (40, 40, 220), (190, 190, 190), (255, 255, 255)
_FINE = 4  # binary digits of OpenCV's sub-pixel drawing


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One row of the picture."""

    name: str
    value: float
    """In the plot's unit; NaN where there is none."""
    outlier: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Field:
    """Residuals where they lie in the camera's picture."""

    points_px: Float[np.ndarray, "n 2"]
    residuals: Float[np.ndarray, "n 2"]
    """In the field's own unit, along the picture's axes."""
    unit: str
    width_px: int
    height_px: int


def residual_png(title: str, unit: str, bars: Sequence[Bar], field: Field | None = None) -> bytes:
    """The picture as a PNG file; of more than 60 bars the longest are drawn."""
    shown = sorted(bars, key=lambda bar: -np.nan_to_num(bar.value))[:_MOST_ROWS] if len(bars) > _MOST_ROWS else bars
    panels = [_bars(title, unit, shown, len(bars))]
    if field is not None:
        panels.append(_field(field))
    height = max(panel.shape[0] for panel in panels)
    whole = np.hstack(
        [cv2.copyMakeBorder(p, 0, height - p.shape[0], 0, 0, cv2.BORDER_CONSTANT, value=_PAPER) for p in panels]
    )
    return bytes(cv2.imencode(".png", whole)[1])


def _bars(title: str, unit: str, bars: Sequence[Bar], count: int) -> UInt8[np.ndarray, "height width 3"]:
    canvas = np.full((_TOP_PX + _ROW_PX * len(bars) + _MARGIN_PX, _WIDTH_PX, 3), 255, np.uint8)
    _text(canvas, title, (_MARGIN_PX, 20))
    more = f", the largest {len(bars)} of {count}" if count > len(bars) else ""
    _text(canvas, f"residuals [{unit}]{more}; outliers red", (_MARGIN_PX, 38))
    values = np.array([bar.value for bar in bars], float)
    largest = float(np.nanmax(values)) if np.isfinite(values).any() else 0.0
    room = _WIDTH_PX - _NAME_PX - _VALUE_PX - 2 * _MARGIN_PX
    for row, bar in enumerate(bars):
        y = _TOP_PX + _ROW_PX * row
        _text(canvas, _short(bar.name), (_MARGIN_PX, y + 14))
        length = round(room * bar.value / largest) if largest > 0 and np.isfinite(bar.value) else 0
        left = _MARGIN_PX + _NAME_PX
        cv2.rectangle(canvas, (left, y + 4), (left + length, y + 16), _OUTLIER if bar.outlier else _BAR, cv2.FILLED)
        value = f"{bar.value:.3g}" if np.isfinite(bar.value) else "left out"
        _text(canvas, value, (left + length + 6, y + 14))
    return canvas


def _field(field: Field) -> UInt8[np.ndarray, "height width 3"]:
    """Magnified residuals as strokes from their places, with the scale below."""
    scale = (_FIELD_PX - 2 * _MARGIN_PX) / max(field.width_px, field.height_px)
    size = (round(field.width_px * scale), round(field.height_px * scale))
    canvas = np.full((_TOP_PX + size[1] + 3 * _MARGIN_PX, _FIELD_PX, 3), 255, np.uint8)
    corner = np.array([_MARGIN_PX, _TOP_PX])
    far = (_MARGIN_PX + size[0], _TOP_PX + size[1])
    cv2.rectangle(canvas, (_MARGIN_PX, _TOP_PX), far, _FRAME)
    sound = np.isfinite(field.residuals).all(axis=1) & np.isfinite(field.points_px).all(axis=1)
    points, residuals = field.points_px[sound], field.residuals[sound]
    usual = float(np.quantile(np.linalg.norm(residuals, axis=1), 0.98)) if len(points) else 0.0
    largest = max(usual, 1e-12)
    starts = (points + 0.5) * scale + corner
    strokes = residuals * np.minimum(_ARROW_PX / largest, 2 * _ARROW_PX / np.maximum(_length(residuals), 1e-12))
    for start, stroke in zip(starts, strokes, strict=True):
        first, last = (np.rint(end * 2**_FINE).astype(int).tolist() for end in (start, start + stroke))
        cv2.line(canvas, first, last, _BAR, 1, cv2.LINE_AA, _FINE)
    _text(canvas, "residuals in the camera's picture, magnified", (_MARGIN_PX, 20))
    cv2.line(canvas, (_MARGIN_PX, 34), (_MARGIN_PX + round(_ARROW_PX), 34), _BAR, 2)
    _text(canvas, f"{largest:.3g} {field.unit}", (_MARGIN_PX + round(_ARROW_PX) + 8, 38))
    return canvas


def _length(vectors: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 1"]:
    return np.linalg.norm(vectors, axis=1, keepdims=True)


def _short(name: str) -> str:
    """What OpenCV's letters can show of a name."""
    plain = name.encode("ascii", "replace").decode()
    plain = "".join(letter if letter.isprintable() else "?" for letter in plain)
    return plain if len(plain) <= _LONGEST_NAME else "..." + plain[-(_LONGEST_NAME - 3) :]


def _text(canvas: UInt8[np.ndarray, "height width 3"], text: str, place: tuple[int, int]) -> None:
    cv2.putText(canvas, text, place, _FONT, _SIZE, _INK, 1, cv2.LINE_AA)

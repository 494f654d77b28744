"""The reliability diagram: what share was right, against what was claimed, and how many claimed it."""

import cv2
import numpy as np
from jaxtyping import UInt8

from benchmarks.confidence import BIN_EDGES, Reliability

_SIDE_PX, _LEFT_PX, _TOP_PX, _BELOW_PX, _COUNTS_PX = 320, 62, 40, 60, 60
_FONT, _SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.42
_INK, _GRID, _BAR, _DOT = (40, 40, 40), (215, 215, 215), (220, 190, 150), (40, 40, 220)


def reliability_diagram(held: Reliability) -> UInt8[np.ndarray, "height width 3"]:
    """A picture (BGR): dots are bins at their mean claim, bars the features in each; the diagonal is perfect."""
    size = (_TOP_PX + _SIDE_PX + _COUNTS_PX + _BELOW_PX, _LEFT_PX + _SIDE_PX + 24, 3)
    canvas = np.full(size, 255, np.uint8)
    foot_px = _TOP_PX + _SIDE_PX + _COUNTS_PX
    for share in np.linspace(0, 1, 6):
        u, v = _place(share, share)
        cv2.line(canvas, (_LEFT_PX, v), (_LEFT_PX + _SIDE_PX, v), _GRID, 1)
        cv2.line(canvas, (u, _TOP_PX), (u, foot_px), _GRID, 1)
        _text(canvas, f"{share:.1f}", (_LEFT_PX - 32, v + 4))
        _text(canvas, f"{share:.1f}", (u - 10, foot_px + 18))
    cv2.line(canvas, _place(0, 0), _place(1, 1), _INK, 1, cv2.LINE_AA)
    for low, high, count in zip(BIN_EDGES[:-1], BIN_EDGES[1:], held.count, strict=True):
        tall_px = round(0.8 * _COUNTS_PX * count / held.count.max())
        (left, _), (right, _) = _place(low, 0), _place(high, 0)
        cv2.rectangle(canvas, (left + 1, foot_px - tall_px), (right - 1, foot_px), _BAR, -1)
    for count, claimed, right_share in zip(held.count, held.claimed, held.right, strict=True):
        if count:
            scatter = np.sqrt(max(right_share * (1 - right_share), 1 / count) / count)
            low, high = _place(claimed, max(right_share - scatter, 0)), _place(claimed, min(right_share + scatter, 1))
            cv2.line(canvas, low, high, _DOT, 1)
            cv2.circle(canvas, _place(claimed, right_share), 4, _DOT, -1, cv2.LINE_AA)
    _text(canvas, f"right against claimed, {held.count.sum():.0f} features", (_LEFT_PX - 40, 18))
    words = f"calibration error {held.calibration_error:.3f}, Brier score {held.brier:.3f}"
    _text(canvas, words, (_LEFT_PX - 40, 34))
    _text(canvas, "claimed probability; bars: how many claim it", (_LEFT_PX, foot_px + 40))
    return canvas


def _place(claimed: float, right: float) -> tuple[int, int]:
    return round(_LEFT_PX + claimed * _SIDE_PX), round(_TOP_PX + (1 - right) * _SIDE_PX)


def _text(canvas: UInt8[np.ndarray, "height width 3"], words: str, at_px: tuple[int, int]) -> None:
    cv2.putText(canvas, words, at_px, _FONT, _SIZE, _INK, 1, cv2.LINE_AA)

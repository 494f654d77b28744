"""Colours and sizes of what is drawn over the cell, the same in every view."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Rgba = tuple[int, int, int, int]

LASER: Rgba = (255, 40, 30, 70)
STRIPE: Rgba = (60, 255, 120, 255)
TRUE: Rgba = (255, 255, 255, 255)
TOUCH: Rgba = (255, 210, 60, 255)
POINT: Rgba = (255, 80, 170, 255)
PROFILE: Rgba = (90, 200, 255, 255)
FRAME: Rgba = (130, 130, 135, 255)
SCALE: Rgba = (62, 64, 68, 255)
NUMBER: Rgba = (170, 172, 176, 255)

# Okabe and Ito's set, told apart by colour-blind people as well (https://jfly.uni-koeln.de/color/).
_NAMED: tuple[Rgba, ...] = (
    (86, 180, 233, 255),
    (240, 228, 66, 255),
    (213, 94, 0, 255),
    (0, 158, 115, 255),
    (204, 121, 167, 255),
    (230, 159, 0, 255),
)
_KNOWN = {
    "left": 0,
    "root": 1,
    "right": 2,
    "centre": 1,
    "before": 4,
    "after": 3,
    "centre by morphology": 4,
    "centre by morphology, lateral": 3,
}


def named_colours(names: Sequence[str]) -> list[Rgba]:
    """A colour for each name; what a joint calls left, root and right looks the same everywhere."""
    return [_NAMED[_KNOWN.get(name, k) % len(_NAMED)] for k, name in enumerate(names)]


def depth_colours(depth: Float[np.ndarray, "n"], low: float, high: float) -> UInt8[np.ndarray, "n 3"]:
    """RGB from dark (deep, `low`) to bright (`high`) for each value."""
    if len(depth) == 0:
        return np.zeros((0, 3), np.uint8)
    level = np.clip((depth - low) / max(high - low, 1e-9), 0, 1)
    grey = np.rint(40 + 215 * level).astype(np.uint8)  # the map's dark end cannot be told from the background
    coloured = cv2.applyColorMap(grey[:, None], cv2.COLORMAP_VIRIDIS)[:, 0, ::-1]
    return np.ascontiguousarray(coloured, dtype=np.uint8)

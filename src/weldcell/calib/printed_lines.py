"""Where the laser stripe crosses printed parallel lines in a picture (for `vanishing_point`).

A printed line is dark between white; its middle in each column (or row) is the centroid of the darkness, which no even
blur moves. Lines and stripe are straight in the undistorted picture of a flat board: both are fitted there and cut.
"""

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Float, Int, Shaped

from weldcell.calib.straight_line import crossing, fit_line
from weldcell.cell.optics import CameraModel

_SMOOTHING_PX = 1.5
_LEAST_LENGTH = 0.15  # of the picture, along the lines
_MOST_THICKNESS = 0.1  # of the picture, across them
_NEAR_PX = 2.0  # points of a line for a start
_BORDER_PX = 6


def line_crossings(
    image: Shaped[np.ndarray, "height width"],
    stripe_px: Float[np.ndarray, "n 2"],
    camera: CameraModel,
    *,
    lines: int,
    along: Literal["rows", "columns"],
) -> Float[np.ndarray, "lines 2"] | None:
    """Pixels where the stripe crosses the lines, in the order of rows (columns) across them; None if not all are seen.

    `along` is what the printed lines run along.
    """
    middles = find_lines(image, along=along)
    if len(middles) != lines:
        return None
    stripe = _fit_undistorted(stripe_px, camera)
    rays = np.array([[*crossing(_fit_undistorted(line, camera), stripe), 1.0] for line in middles])
    return camera.project(rays)


def find_lines(
    image: Shaped[np.ndarray, "height width"], *, along: Literal["rows", "columns"]
) -> list[Float[np.ndarray, "n 2"]]:
    """Points (px) on the middle of each dark line, a point a column (row), the lines in order across."""
    grey = np.asarray(image if along == "rows" else image.T, dtype=np.float32)
    smooth = cv2.GaussianBlur(grey, (0, 0), _SMOOTHING_PX)
    dark = (smooth < _threshold(smooth)).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(dark, connectivity=4)
    height, width = grey.shape
    found = []
    for k in range(1, count):
        length, area = int(stats[k, cv2.CC_STAT_WIDTH]), int(stats[k, cv2.CC_STAT_AREA])
        thickness = area / length
        if length > _LEAST_LENGTH * width and thickness < _MOST_THICKNESS * height:
            found.append(_middle(grey, labels == k, thickness))
    found = sorted((line for line in found if len(line) > _LEAST_LENGTH * width), key=lambda line: line[:, 1].mean())
    return [line if along == "rows" else line[:, ::-1] for line in found]


def _threshold(smooth: Float[np.ndarray, "height width"]) -> float:
    """Between black print and white board: the picture's own two levels (Otsu 1979), the stripe clipped off."""
    top = float(np.quantile(smooth, 0.98))
    levels = np.rint(255 * np.clip(smooth / max(top, 1e-6), 0, 1)).astype(np.uint8)
    return cv2.threshold(levels, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[0] / 255 * top


def _middle(
    grey: Float[np.ndarray, "height width"], mask: Shaped[np.ndarray, "height width"], thickness: float
) -> Float[np.ndarray, "n 2"]:
    """Centroids of the darkness in the columns of a component, its window twice as wide as the line."""
    columns: Int[np.ndarray, "n"] = np.flatnonzero(mask.any(axis=0))
    rough = (mask * np.arange(len(mask))[:, None]).sum(axis=0)[columns] / mask.sum(axis=0)[columns]
    curve = np.polynomial.Polynomial.fit(columns, rough, 2)(columns)
    half = int(np.ceil(thickness)) + 2
    centre = np.rint(curve).astype(int)
    inside = (centre > half + 1) & (centre < len(grey) - half - 2)
    inside &= (columns > columns[0] + _BORDER_PX) & (columns < columns[-1] - _BORDER_PX)
    columns, centre = columns[inside], centre[inside]
    offsets = np.arange(-half, half + 1)[:, None]
    window = grey[centre + offsets, columns]
    share = (offsets + half) / (2 * half)
    white = (1 - share) * window[:2].mean(axis=0) + share * window[-2:].mean(axis=0)
    darkness = white - window
    with np.errstate(divide="ignore", invalid="ignore"):
        row = centre + (darkness * offsets).sum(axis=0) / darkness.sum(axis=0)
    sound = np.abs(row - centre) < half
    return np.column_stack([columns[sound], row[sound]]).astype(float)


def _fit_undistorted(
    pixels: Float[np.ndarray, "n 2"], camera: CameraModel
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    focal_px = float(np.mean(camera.focal_px))
    middle, direction, _ = fit_line(camera.unproject(pixels)[:, :2] * focal_px, _NEAR_PX)
    return middle / focal_px, direction

"""Inner corners of a chessboard in a picture."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from weldcell.cell.errors import BadInput

FEWEST_CORNERS = 3  # along either side: OpenCV's own limit
_WINDOW_SHARE = 0.35  # of the distance to the nearest corner: half of what the refinement looks at
_WINDOW_PX = (3, 9)
_SMOOTHING_PX = 0.8  # against the gradients' error on sharp edges
_STEPS = 50
_LEAST_STEP_PX = 1e-3
_UNEVEN_RATIO = 2.5  # of the middle corner's unevenness
_UNEVEN_SHARE = 0.02  # of the contrast: always allowed
_FARTHEST_PX = 1.0  # from the first find: beyond, something else pulled


def board_points(columns: int, rows: int, square_m: float) -> Float[np.ndarray, "n 3"]:
    """Inner corners on the board (m), row by row: x along the columns, y along the rows, z = 0."""
    if columns < FEWEST_CORNERS or rows < FEWEST_CORNERS:
        raise BadInput(f"board: {columns}x{rows} inner corners, expected at least {FEWEST_CORNERS} each way")
    if not (np.isfinite(square_m) and square_m > 0):
        raise BadInput(f"board: squares of {square_m} m, expected a length above 0")
    y, x = np.divmod(np.arange(columns * rows), columns)
    return np.column_stack([x, y, np.zeros(columns * rows)]) * square_m


def find_corners(image: np.ndarray, columns: int, rows: int) -> Float[np.ndarray, "n 2"] | None:
    """Pixels of the inner corners in the order of `board_points`; None where the board is not seen whole.

    NaN for corners that something lies across, as a laser stripe does.

    Found by OpenCV's sector-based detector (Duda and Frese, Accurate detection and localization of checkerboard
    corners, BMVC 2018), which stands blur, distortion and a laser stripe but errs by 0.06 px on boards that lean; so
    each corner is then placed where the gradients around it all point past it (Foerstner and Guelch 1987; OpenCV's
    cornerSubPix).
    """
    if image.ndim != 2:
        raise BadInput(f"board: expected a grey picture, found shape {image.shape}")
    grey = (
        image
        if image.dtype == np.uint8
        else cv2.normalize(image, dst=np.empty(0), alpha=0, beta=255, norm_type=cv2.NORM_MINMAX, dtype=cv2.CV_8U)
    )
    found, pixels = cv2.findChessboardCornersSB(
        grey, (columns, rows), flags=cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    return _refined(grey, pixels.reshape(rows, columns, 2)) if found else None


def _refined(grey: UInt8[np.ndarray, "height width"], rough: Float[np.ndarray, "rows columns 2"]) -> np.ndarray:
    gaps = [np.linalg.norm(np.diff(rough, axis=axis), axis=2).min() for axis in (0, 1)]
    half = int(np.clip(_WINDOW_SHARE * min(gaps), *_WINDOW_PX))
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTHING_PX)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, _STEPS, _LEAST_STEP_PX)
    first = np.ascontiguousarray(rough.reshape(-1, 1, 2), dtype=np.float32)
    pixels = cv2.cornerSubPix(smooth, first.copy(), (half, half), (-1, -1), stop).reshape(-1, 2)
    unclear = _uneven(smooth, pixels, half) | (np.linalg.norm(pixels - first[:, 0], axis=1) > _FARTHEST_PX)
    return np.where(unclear[:, None], np.nan, pixels.astype(float))


def _uneven(smooth: Float[np.ndarray, "height width"], pixels: Float[np.ndarray, "n 2"], half: int) -> np.ndarray:
    """Whether a corner's surroundings differ from themselves turned by half a turn far more than the other corners'."""
    size = 2 * half + 1
    patches = np.array([cv2.getRectSubPix(smooth, (size, size), (float(u), float(v))) for u, v in pixels])
    apart = np.abs(patches - patches[:, ::-1, ::-1]).max(axis=(1, 2))
    contrast = float(np.median(np.ptp(patches, axis=(1, 2))))
    return apart > _UNEVEN_RATIO * np.median(apart) + _UNEVEN_SHARE * contrast

"""The laser stripe on a posed chessboard, measured where the print cannot pull it.

On a flat board the stripe is a straight line of the board. A rough find gives that line; then each column
(or row) that crosses it wholly within one white square, clear of the edges, gives a centre: the centroid of the light
above the square's own brightness. The centres' scatter about their line is their standard deviation.
"""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped
from scipy.spatial.transform import RigidTransform

from weldcell.calib.board_bundle import stripe_points_camera
from weldcell.calib.straight_line import fit_line
from weldcell.cell.optics import CameraModel

_SAMPLES = 24  # of a square's side, for the rough find
_RIM = 3  # of them at each edge are left out, where the print is blurred
_ANGLES = 360
_BRIGHT_NOISE, _BRIGHT_SHARE, _BRIGHT_QUANTILE = 6.0, 0.3, 0.995
_LIT_SHARE = 0.5  # of a line through white squares: less is no stripe
_NEAR_PX = 2.5  # of the centres' line, for a start
_HALF_PX = 7  # of the window across the stripe
_BACKGROUND_PX = 2  # at either end of the window
_CLEAR_PX = 3.0  # of the squares' edges: what lens and pixels blur
_WEIGHT_SIGMAS = 1.5  # of the weight about the centre, in sigmas of the stripe
_STRIPE_SIGMA_PX = (0.7, 3.0)
_ROUNDS = 6
_LEAST_SNR = 8.0  # of the light in a window over the noise of its background
_WHITE_SHARE = 0.5  # of the brightest squares: below, it is a black one
_LEAST_SIGMA_PX = 0.02
_OUTLYING = 4.0
_MAD = 1.4826
FEWEST_POINTS = 10


@dataclass(frozen=True, kw_only=True)
class BoardGrid:
    """A chessboard's squares."""

    columns: int
    """Inner corners along x."""
    rows: int
    square_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardStripe:
    """Centres of the stripe on one board."""

    pixels: Float[np.ndarray, "n 2"]
    sigma_px: float
    """Their scatter across the stripe, along the picture's axis that crosses it."""


def stripe_on_board(
    grey: Shaped[np.ndarray, "height width"],
    camera: CameraModel,
    T_camera_board: RigidTransform,
    board: BoardGrid,
    *,
    along: Literal["rows", "columns"],
) -> BoardStripe | None:
    """The stripe's centres on the white squares; None where there is no stripe, or too little of it.

    `along` says which of the picture's axes the stripes of the sensor run along, more or less.
    """
    line = _line_px(grey, camera, T_camera_board, board, along)
    if line is None:
        return None
    picture = np.asarray(grey if along == "rows" else grey.T, dtype=np.float32)
    cuts, centres = line
    clear = _within_one_square(cuts, centres, along, camera, T_camera_board, board)
    cuts, centres = cuts[clear], centres[clear]
    if len(cuts) < FEWEST_POINTS:
        return None
    centres, sound = _centroids(picture, cuts, centres)
    if sound.sum() < FEWEST_POINTS:
        return None
    pixels = np.column_stack([cuts, centres])[sound]
    return _settled(pixels if along == "rows" else pixels[:, ::-1], camera, axis=1 if along == "rows" else 0)


def _line_px(
    grey: Shaped[np.ndarray, "height width"],
    camera: CameraModel,
    T_camera_board: RigidTransform,
    board: BoardGrid,
    along: Literal["rows", "columns"],
) -> tuple[np.ndarray, Float[np.ndarray, "m"]] | None:
    """Cuts (columns or rows) that the stripe crosses on the squares, and roughly where."""
    ends = rough_line(grey, camera, T_camera_board, board)
    if ends is None:
        return None
    on_line = ends[0] + np.linspace(0, 1, 200)[:, None] * (ends[1] - ends[0])
    points_camera = T_camera_board.apply(np.column_stack([on_line * board.square_m, np.zeros(200)]))
    pixels = camera.project(points_camera)
    cut, across = pixels.T if along == "rows" else pixels.T[::-1]
    order = np.argsort(cut)
    size, length = (grey.shape[1], grey.shape[0]) if along == "rows" else grey.shape
    cuts = np.arange(max(int(np.ceil(cut.min())), 0), min(int(np.floor(cut.max())), size - 1) + 1)
    if len(cuts) == 0:
        return None
    centres = np.interp(cuts, cut[order], across[order])
    inside = (centres > _HALF_PX + 2) & (centres < length - _HALF_PX - 3)
    return cuts[inside], centres[inside]


def rough_line(
    grey: Shaped[np.ndarray, "height width"], camera: CameraModel, T_camera_board: RigidTransform, board: BoardGrid
) -> Float[np.ndarray, "2 2"] | None:
    """Ends of the stripe on the board, in squares; None where no line of light lies across it.

    The picture is drawn onto the board's own plane, where each square shows by how much its places are brighter than
    the square is; a line of bright places over the white squares is looked for in all directions (Radon transform).
    """
    light, places = _light_on_white(grey, camera, T_camera_board, board)
    if light is None:
        return None
    noise = _MAD * float(np.median(np.abs(light)))
    bright = light > max(_BRIGHT_NOISE * noise, _BRIGHT_SHARE * float(np.quantile(light, _BRIGHT_QUANTILE)))
    spots = places[bright]
    if len(spots) < 3 * FEWEST_POINTS:
        return None
    angles = np.linspace(0, np.pi, _ANGLES, endpoint=False)
    normals = np.column_stack([-np.sin(angles), np.cos(angles)])
    width = 2.0 / _SAMPLES
    best = (0, normals[0], 0.0)
    for normal in normals:
        offset = spots @ normal
        counts = np.bincount(((offset - offset.min()) / width).astype(int))
        if counts.max() > best[0]:
            best = (int(counts.max()), normal, offset.min() + (counts.argmax() + 0.5) * width)
    near = np.abs(spots @ best[1] - best[2]) < 2 * width
    if near.sum() < 3 * FEWEST_POINTS:
        return None
    middle, direction, kept = fit_line(spots[near], width)
    on_line = np.abs((places - middle) @ [-direction[1], direction[0]]) < 0.5 / _SAMPLES
    if not on_line.any() or np.mean(bright[on_line]) < _LIT_SHARE:
        return None
    reach = (spots[near][kept] - middle) @ direction
    return middle + np.array([[reach.min()], [reach.max()]]) * direction


def _light_on_white(
    grey: Shaped[np.ndarray, "height width"], camera: CameraModel, T_camera_board: RigidTransform, board: BoardGrid
) -> tuple[Float[np.ndarray, "n"] | None, Float[np.ndarray, "n 2"]]:
    """How much brighter places within white squares are than their square's median, and where they are (squares)."""
    share = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    x, y = ((np.arange(-1, n)[:, None] + share).ravel() for n in (board.columns, board.rows))
    places = np.stack(np.meshgrid(x, y), axis=-1)
    points = T_camera_board.apply(
        np.append(places * board.square_m, np.zeros((*places.shape[:2], 1)), axis=2).reshape(-1, 3)
    )
    u, v = camera.project(points).T.reshape(2, *places.shape[:2]).astype(np.float32)
    smooth = cv2.GaussianBlur(np.asarray(grey, dtype=np.float32), (0, 0), 1.0)
    drawn = cv2.remap(smooth, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan"))
    squares = (board.rows + 1, _SAMPLES, board.columns + 1, _SAMPLES)
    inner = slice(_RIM, _SAMPLES - _RIM)
    by_square = (
        drawn.reshape(squares)[:, inner, :, inner].transpose(0, 2, 1, 3).reshape(board.rows + 1, board.columns + 1, -1)
    )
    where = places.reshape(*squares, 2)[:, inner, :, inner].transpose(0, 2, 1, 3, 4).reshape(*by_square.shape, 2)
    level = np.median(by_square, axis=2)
    even = np.add.outer(np.arange(board.rows + 1), np.arange(board.columns + 1)) % 2 == 0
    white = even if np.nanmedian(level[even]) > np.nanmedian(level[~even]) else ~even
    white &= np.isfinite(level)
    if not white.any():
        return None, np.zeros((0, 2))
    return (by_square - level[..., None])[white].ravel(), where[white].reshape(-1, 2)


def _on_squares(
    pixels: Float[np.ndarray, "n 2"], camera: CameraModel, T_camera_board: RigidTransform, board: BoardGrid
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
    """Places on the board in squares (NaN off the squares), and distance (px) from the nearest edge of a square."""
    poses = RigidTransform.concatenate([T_camera_board])
    points_camera = stripe_points_camera(pixels, np.zeros(len(pixels), int), camera, poses)
    with np.errstate(invalid="ignore"):
        place = T_camera_board.inv().apply(points_camera)[:, :2] / board.square_m
        off = ~np.all((place > -1) & (place < [board.columns, board.rows]), axis=1) | ~(points_camera[:, 2] > 0)
    place[off] = np.nan
    away_px = np.full(len(pixels), np.inf)
    for axis in (0, 1):
        edge = place.copy()
        edge[:, axis] = np.rint(edge[:, axis])
        edge_board = np.column_stack([edge * board.square_m, np.zeros(len(edge))])
        away_px = np.minimum(away_px, np.linalg.norm(camera.project(T_camera_board.apply(edge_board)) - pixels, axis=1))
    return place, away_px


def _within_one_square(
    cuts: np.ndarray,
    centres: Float[np.ndarray, "n"],
    along: Literal["rows", "columns"],
    camera: CameraModel,
    T_camera_board: RigidTransform,
    board: BoardGrid,
) -> Bool[np.ndarray, "n"]:
    """Whether both ends of the window lie in the same square, clear of its edges (in perspective it stays convex)."""
    ends = []
    for shift in (-_HALF_PX, _HALF_PX):
        pixels = np.column_stack([cuts, centres + shift])
        place, away_px = _on_squares(pixels if along == "rows" else pixels[:, ::-1], camera, T_camera_board, board)
        ends.append((np.floor(place), away_px))
    (first, first_px), (last, last_px) = ends
    return np.all(first == last, axis=1) & (first_px > _CLEAR_PX) & (last_px > _CLEAR_PX)


def _centroids(
    picture: Float[np.ndarray, "height width"], cuts: np.ndarray, start: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
    """Centres about the start, and which are clear ones.

    The weight is a Gaussian about the estimate itself; a Gaussian stripe of variance V under a weight of variance W
    shows the share W / (V + W) of its shift.
    """
    middle = np.rint(start).astype(int)
    offsets = np.arange(-_HALF_PX, _HALF_PX + 1)[:, None]
    window = picture[middle + offsets, cuts]
    ends = np.vstack([window[:_BACKGROUND_PX], window[-_BACKGROUND_PX:]])
    background = ends.mean(axis=0)
    noise = float(np.median(ends.std(axis=0))) + 0.3
    white = background > _WHITE_SHARE * np.quantile(background, 0.95)
    light = window - background
    total = light.sum(axis=0)
    sound = white & (total > _LEAST_SNR * noise * np.sqrt(len(window)))
    if not sound.any():
        return start, sound
    centre = start - middle
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        width2 = float(np.median((light * (offsets - centre) ** 2).sum(axis=0)[sound] / total[sound]))
        sigma2 = float(np.clip(width2, _STRIPE_SIGMA_PX[0] ** 2, _STRIPE_SIGMA_PX[1] ** 2))
        weight2 = _WEIGHT_SIGMAS**2 * sigma2
        for _ in range(_ROUNDS):
            weighted = light * np.exp(-((offsets - centre) ** 2) / (2 * weight2))
            shift = (weighted * (offsets - centre)).sum(axis=0) / weighted.sum(axis=0) * (1 + sigma2 / weight2)
            centre = centre + np.clip(shift, -1, 1)
        sound &= np.abs(shift) < 0.05
    sound &= np.abs(centre) < _HALF_PX - 3
    return middle + centre, sound


def _settled(pixels: Float[np.ndarray, "n 2"], camera: CameraModel, axis: int) -> BoardStripe | None:
    """The centres that lie on one line of the undistorted picture, with their scatter along the picture's axis."""
    focal_px = float(np.mean(camera.focal_px))
    flat = camera.unproject(pixels)[:, :2] * focal_px
    middle, direction, kept = fit_line(flat, _NEAR_PX)
    if kept.sum() < FEWEST_POINTS or abs(direction[1 - axis]) < 0.1:
        return None
    away = ((flat - middle) @ [-direction[1], direction[0]]) / abs(direction[1 - axis])
    scatter = max(_MAD * float(np.median(np.abs(away[kept]))), _LEAST_SIGMA_PX)
    return BoardStripe(pixels=pixels[np.abs(away) < _OUTLYING * scatter], sigma_px=scatter)


def brightness_of(
    image: Shaped[np.ndarray, "height width *channels"], colour: Literal["red", "green", "blue", "mono"]
) -> Shaped[np.ndarray, "height width"]:
    """The grey picture in which a laser of that colour shows best: its channel, or the mean of all."""
    if image.ndim == 2:
        return image
    if colour == "mono":
        return cv2.transform(image, np.full((1, 3), 1 / 3))
    return np.ascontiguousarray(image[..., ("red", "green", "blue").index(colour)])

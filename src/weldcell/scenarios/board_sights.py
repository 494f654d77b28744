"""What pictures of boards show, put together for the estimators; the same for simulated pictures and a user's own."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Shaped

from weldcell.calib.board_bundle import Corners, StripePoints
from weldcell.calib.board_stripe import BoardGrid, BoardStripe, brightness_of, stripe_on_board
from weldcell.calib.camera import CameraProblem, CameraResult, Lens, pose_board
from weldcell.calib.camera import solve as solve_camera
from weldcell.calib.chessboard import board_points, find_corners
from weldcell.cell.errors import JobFailed
from weldcell.cell.optics import CameraModel
from weldcell.tracking.picture_stripe import LaserColour
from weldcell.tracking.stripe import Along

CORNER_SIGMA_PX = 0.04
"""A corner's standard deviation in a good picture: the detector's own 0.01 px and the camera's noise."""
_FEWEST_SHARE = 0.6  # of a board's corners: else too much lies across it
_APART_PX = 4  # between stripe points that are used: wider than the speckle's grain, so they err by themselves


@dataclass(frozen=True, kw_only=True)
class BoardSize:
    """A chessboard, as its owner describes it."""

    columns: int
    """Inner corners along one side."""
    rows: int
    square_m: float

    @property
    def points_board(self) -> Float[np.ndarray, "n 3"]:
        """All inner corners (m)."""
        return board_points(self.columns, self.rows, self.square_m)


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardSight:
    """One picture that shows the whole board."""

    grey: Shaped[np.ndarray, "height width"]
    """The picture in which the stripe is looked for."""
    corners_px: Float[np.ndarray, "n 2"]
    """All inner corners; NaN where something lies across."""

    def in_colour(self, image: Shaped[np.ndarray, "height width *channels"], colour: LaserColour) -> "BoardSight":
        """The same for a laser of that colour."""
        return replace(self, grey=brightness_of(image, colour))


def see_board(image: Shaped[np.ndarray, "height width *channels"], size: BoardSize) -> BoardSight | None:
    """What a picture shows; None where the board is not seen whole, or too much of it is covered."""
    grey = brightness_of(image, "mono")
    corners_px = find_corners(grey, size.columns, size.rows)
    if corners_px is None or np.isfinite(corners_px[:, 0]).mean() < _FEWEST_SHARE:
        return None
    return BoardSight(grey=grey, corners_px=corners_px)


def corners_of(sights: Sequence[BoardSight], size: BoardSize) -> Corners:
    """The clear corners of all pictures."""
    seen = np.array([np.isfinite(sight.corners_px[:, 0]) for sight in sights])
    return Corners(
        points_board=np.concatenate([size.points_board[own] for own in seen]),
        pixels=np.concatenate([sight.corners_px[own] for sight, own in zip(sights, seen, strict=True)]),
        picture=np.repeat(np.arange(len(sights)), seen.sum(axis=1)),
    )


def camera_from(
    corners: Corners, width_px: int, height_px: int, lens: Lens, sigma_px: float = CORNER_SIGMA_PX
) -> CameraResult:
    """Intrinsics from the corners."""
    return solve_camera(
        CameraProblem(width_px=width_px, height_px=height_px, corners=corners, lens=lens, sigma_px=sigma_px)
    )


def stripe_of(
    sights: Sequence[BoardSight], size: BoardSize, camera: CameraModel, corners: Corners, along: Along
) -> StripePoints:
    """The stripe's points on the boards' white squares; boards are posed by the camera."""
    grid = BoardGrid(columns=size.columns, rows=size.rows, square_m=size.square_m)
    found: dict[int, BoardStripe] = {}
    for k, sight in enumerate(sights):
        own = corners.picture == k
        T = pose_board(camera, corners.points_board[own], corners.pixels[own])
        stripe = stripe_on_board(sight.grey, camera, T, grid, along=along)
        if stripe is not None:
            found[k] = stripe
    if len(found) < 2:
        raise JobFailed(f"laser plane: {len(found)} pictures show the stripe on the board, expected at least 2")
    pixels = {k: _apart(stripe.pixels) for k, stripe in found.items()}
    return StripePoints(
        pixels=np.concatenate(list(pixels.values())),
        picture=np.concatenate([np.full(len(own), k) for k, own in pixels.items()]),
        sigma_px=np.concatenate([np.full(len(own), found[k].sigma_px) for k, own in pixels.items()]),
    )


def with_noise(
    corners: Corners, stripe: StripePoints, noise_px: float, axis: int, rng: np.random.Generator
) -> tuple[Corners, StripePoints]:
    """Corners (both axes) and stripe (its sub-pixel `axis`) with normal noise added."""
    pixels = stripe.pixels.copy()
    pixels[:, axis] += noise_px * rng.normal(size=len(pixels))
    return (
        replace(corners, pixels=corners.pixels + noise_px * rng.normal(size=corners.pixels.shape)),
        replace(stripe, pixels=pixels, sigma_px=np.hypot(stripe.sigma_px, noise_px)),
    )


def _apart(pixels: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 2"]:
    """Those points, in their order, that are not too near to the one before."""
    chosen: list[int] = []
    for k in range(len(pixels)):
        if not chosen or np.abs(pixels[k] - pixels[chosen[-1]]).max() >= _APART_PX:
            chosen.append(k)
    return pixels[chosen]

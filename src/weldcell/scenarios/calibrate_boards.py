"""`weldcell calibrate camera` and `laser-plane`: on the user's own pictures of a chessboard."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np

from weldcell.calib import laser_plane
from weldcell.calib.board_bundle import Corners, StripePoints, stripe_points_camera
from weldcell.calib.camera import FREE, CameraResult, Lens
from weldcell.calib.chessboard import FEWEST_CORNERS
from weldcell.calib.laser_plane import LaserPlaneResult
from weldcell.calib.plane_consensus import agreeing_pictures
from weldcell.cell.errors import BadInput, JobFailed
from weldcell.cell.optics import CameraModel
from weldcell.scenarios.atomic_file import write_bytes
from weldcell.scenarios.board_report import camera_plot, camera_report, plane_plot, plane_report
from weldcell.scenarios.board_sights import (
    CORNER_SIGMA_PX,
    BoardSight,
    BoardSize,
    camera_from,
    corners_of,
    see_board,
    stripe_of,
)
from weldcell.scenarios.calibration_file import write_report
from weldcell.scenarios.camera_file import camera_mapping, read_camera
from weldcell.scenarios.picture_file import check_picture, read_picture
from weldcell.scenarios.yaml_file import write_yaml
from weldcell.tracking.picture_stripe import LaserColour
from weldcell.tracking.stripe import Along

_BOARD = re.compile(r"(\d{1,3})[xX](\d{1,3})")
_MOST_CORNERS = 100  # along a side
_SQUARE_MM = (0.05, 1000.0)
_FEWEST_BOARDS = {"camera": 3, "laser plane": 2}
_LEAST_SIDE_PX = 32
_COLOURS: tuple[LaserColour, ...] = ("mono", "red", "green", "blue")


@dataclass(frozen=True, kw_only=True)
class BoardRequest:
    """What the command line asks for."""

    images: tuple[Path, ...]
    board: str
    """Inner corners, COLSxROWS."""
    square_mm: float
    lens: Lens = "plain"
    camera_file: Path | None = None
    along: Along | Literal["auto"] = "auto"

    def __post_init__(self) -> None:
        low, high = _SQUARE_MM
        if not low <= self.square_mm <= high:
            raise BadInput(f"--square-mm: found {self.square_mm:g}, expected {low:g} to {high:g}")
        columns, rows = (self.size.columns, self.size.rows) if _BOARD.fullmatch(self.board) else (0, 0)
        if not (min(columns, rows) >= FEWEST_CORNERS and max(columns, rows) <= _MOST_CORNERS):
            expected = f"COLSxROWS inner corners, {FEWEST_CORNERS} to {_MOST_CORNERS} each, e.g. 11x8"
            raise BadInput(f"--board: found {self.board!r}, expected {expected}")

    @cached_property
    def size(self) -> BoardSize:
        """The board."""
        columns, rows = (int(side) for side in self.board.lower().split("x"))
        return BoardSize(columns=columns, rows=rows, square_m=1e-3 * self.square_mm)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """The pictures that show the board."""

    names: tuple[str, ...]
    pictures: tuple[np.ndarray, ...]
    sights: tuple[BoardSight, ...]
    left_out: dict[str, str]
    """Why a picture is left out, by its name."""
    corners: Corners

    @property
    def shape(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        height, width = self.pictures[0].shape[:2]
        return width, height


def camera(request: BoardRequest, place: Path, *, overwrite: bool = False) -> tuple[str, tuple[str, ...]]:
    """Verdict and reasons; writes camera.yaml (unless refused), residuals.png and result.json."""
    _check_place(place, ("camera.yaml", "residuals.png", "result.json"), overwrite)
    seen = _see(request, "camera")
    found = camera_from(seen.corners, *seen.shape, request.lens)
    report = camera_report(found, seen.names, seen.left_out)
    if found.verdict != "refused":
        write_yaml(place / "camera.yaml", camera_mapping(found.camera))
    write_bytes(place / "residuals.png", camera_plot(found, seen.corners, seen.names, seen.left_out))
    write_report(place / "result.json", report)
    return report["verdict"], tuple(report["reasons"])


def plane(request: BoardRequest, place: Path, *, overwrite: bool = False) -> tuple[str, tuple[str, ...]]:
    """Verdict and reasons; writes residuals.png and result.json, and camera.yaml if intrinsics were estimated."""
    _check_place(place, ("camera.yaml", "residuals.png", "result.json"), overwrite)
    known = None if request.camera_file is None else read_camera(request.camera_file)
    seen = _see(request, "laser plane" if known else "camera")
    if known and (known.width_px, known.height_px) != seen.shape:
        found, expected = (f"{width} x {height}" for width, height in (seen.shape, (known.width_px, known.height_px)))
        raise BadInput(f"{seen.names[0]}: found {found} pixels, expected {expected} as in {request.camera_file}")
    estimated = None if known else camera_from(seen.corners, *seen.shape, request.lens)
    start = known or estimated.camera  # type: ignore[union-attr]
    stripe, wrong = _sound(_best_stripe(request, seen, start), seen, start)
    found_plane = _solve(request, start, estimated, seen.corners, stripe)
    report = plane_report(found_plane, estimated, stripe, seen.names, seen.left_out, wrong)
    if estimated is not None and report["verdict"] != "refused":
        write_yaml(place / "camera.yaml", camera_mapping(found_plane.camera))
    write_bytes(place / "residuals.png", plane_plot(found_plane, stripe, seen.names, seen.left_out, wrong))
    write_report(place / "result.json", report)
    return report["verdict"], tuple(report["reasons"])


def _solve(
    request: BoardRequest, start: CameraModel, estimated: CameraResult | None, corners: Corners, stripe: StripePoints
) -> LaserPlaneResult:
    """One adjustment of plane, boards and, if they are not known, intrinsics."""
    scatter_px = CORNER_SIGMA_PX if estimated is None else estimated.rms_px / np.sqrt(2)
    return laser_plane.solve(
        laser_plane.LaserPlaneProblem(
            camera=start,
            corners=corners,
            stripe=stripe,
            free=() if estimated is None else FREE[request.lens],
            corner_sigma_px=max(CORNER_SIGMA_PX, float(scatter_px)),
            method="bundle",
        )
    )


def _see(request: BoardRequest, what: Literal["camera", "laser plane"]) -> _Seen:
    """All pictures read, checked, and looked at."""
    for image in request.images:
        check_picture(image)
    names = _names(request.images)
    kept: list[tuple[str, np.ndarray, BoardSight]] = []
    left_out: dict[str, str] = {}
    first: tuple[Path, tuple[int, ...]] | None = None
    for name, image in zip(names, request.images, strict=True):
        picture = read_picture(image)
        first = first or (image, picture.shape[:2])
        if picture.shape[:2] != first[1]:
            (height, width), (rows, columns) = picture.shape[:2], first[1]
            raise BadInput(
                f"{image}: found {width} x {height} pixels, expected {columns} x {rows} as in {first[0]}: one camera"
            )
        sight = see_board(picture, request.size) if min(picture.shape[:2]) >= _LEAST_SIDE_PX else None
        if sight is None:
            left_out[name] = f"no board of {request.board} inner corners was found"
        else:
            kept.append((name, picture, sight))
    if len(kept) < _FEWEST_BOARDS[what]:
        missing = next(iter(left_out), "")
        raise BadInput(
            f"{missing or names[0]}: {len(kept)} of {len(names)} pictures show a board of {request.board} inner "
            f"corners, expected at least {_FEWEST_BOARDS[what]}"
        )
    return _Seen(
        names=tuple(name for name, _, _ in kept),
        pictures=tuple(picture for _, picture, _ in kept),
        sights=tuple(sight for _, _, sight in kept),
        left_out=left_out,
        corners=corners_of([sight for _, _, sight in kept], request.size),
    )


def _best_stripe(request: BoardRequest, seen: _Seen, camera: CameraModel) -> StripePoints:
    """The stripe in the colour and direction that show most of it."""
    directions: tuple[Along, ...] = ("rows", "columns") if request.along == "auto" else (request.along,)
    colours = _COLOURS if seen.pictures[0].ndim == 3 else ("mono",)
    tried: list[StripePoints] = []
    reason = ""
    for colour in colours:
        sights = [sight.in_colour(picture, colour) for sight, picture in zip(seen.sights, seen.pictures, strict=True)]
        for along in directions:
            try:
                tried.append(stripe_of(sights, request.size, camera, seen.corners, along))
            except JobFailed as failure:
                reason = str(failure)
    if not tried:
        raise JobFailed(reason)
    return max(tried, key=lambda one: float(np.sum(1 / one.sigma_px**2)))


def _sound(stripe: StripePoints, seen: _Seen, camera: CameraModel) -> tuple[StripePoints, dict[str, float]]:
    """The stripe without pictures that share no plane with the others, and how far off those are (mm rms) by name."""
    poses = laser_plane.pose_boards(camera, seen.corners)
    points = stripe_points_camera(stripe.pixels, stripe.picture, camera, poses)
    agree, rms_m = agreeing_pictures(points, stripe.picture, len(seen.names))
    kept = agree[stripe.picture]
    sound = StripePoints(pixels=stripe.pixels[kept], picture=stripe.picture[kept], sigma_px=stripe.sigma_px[kept])
    return sound, {seen.names[k]: 1e3 * float(rms_m[k]) for k in np.flatnonzero(~agree)}


def _names(images: Sequence[Path]) -> list[str]:
    """A picture's file name; its whole path where two are called the same."""
    short = [image.name for image in images]
    names = [one if short.count(one) == 1 else str(image) for one, image in zip(short, images, strict=True)]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BadInput(f"{twice}: found twice among the pictures, expected once")
    return names


def _check_place(place: Path, names: Sequence[str], overwrite: bool) -> None:
    if place.exists() and not place.is_dir():
        raise BadInput(f"{place}: found a file, expected a folder to write the result into")
    taken = [name for name in names if (place / name).exists()]
    if taken and not overwrite:
        raise BadInput(f"{place / taken[0]}: found a result, expected a free place (--overwrite replaces it)")

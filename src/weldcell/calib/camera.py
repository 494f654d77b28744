"""Intrinsics from pictures of a flat board, for plain and tilted (Scheimpflug) lenses, with covariance.

OpenCV's `calibrateCamera` gives the start; the estimate is our own bundle adjustment, robust, with the covariance of
the intrinsics once the boards' poses are integrated out. Quality is judged on pictures left out of the fit.

A tilted lens and tangential distortion are nearly the same thing: with the tilt estimated the tangential terms stay
zero.
"""

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.board_bundle import (
    Adjusted,
    Arrangement,
    Corners,
    adjust,
    outlying_pictures,
    refined_poses,
)
from weldcell.calib.least_squares import without_others
from weldcell.calib.verdict import (
    DOUBTFUL_CONDITION,
    REFUSED_CONDITION,
    Finding,
    Judged,
    Verdict,
    judge,
    weigh_convergence,
)
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel

Lens = Literal["plain", "tilted"]

FREE: dict[Lens, tuple[str, ...]] = {
    "plain": ("fx", "cx", "cy", "k1", "k2", "p1", "p2"),
    "tilted": ("fx", "cx", "cy", "k1", "k2", "tau_x", "tau_y"),
}
"""Intrinsics that are estimated; pixels are square."""

_FEWEST_PICTURES = 3
_FEWEST_CORNERS = 12
_TILT_STARTS_DEG = (0.0, -10.0, 10.0)
_OUTLYING = 4.0  # times the median picture's rms
_DOUBTFUL_RMS_PX = 1.0
_REFUSED_RMS_PX = 5.0
_FOLDS = 5  # groups of pictures left out in turn


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraProblem:
    """Board corners in pictures."""

    width_px: int
    height_px: int
    corners: Corners
    """Each picture's corners."""
    lens: Lens = "plain"
    """Whether the picture's plane may be tilted against the lens."""
    sigma_px: float = 0.1
    """Standard deviation of a corner along each axis; the covariance grows if the residuals are larger."""
    hold_out: bool = True
    """Judge the result on pictures left out of the fit (five more fits)."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma_px) and self.sigma_px > 0):
            raise BadInput(f"camera: sigma_px is {self.sigma_px}, expected above 0")
        count = np.bincount(self.corners.picture)
        if len(count) < _FEWEST_PICTURES:
            raise BadInput(f"camera: {len(count)} pictures show the board, expected at least {_FEWEST_PICTURES}")
        if count.min() < _FEWEST_CORNERS:
            raise BadInput(f"camera: a picture shows {count.min()} corners, expected at least {_FEWEST_CORNERS}")


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraResult(Judged):
    """The camera, and how well it is known.

    The condition number is that of the intrinsics, scaled to pixels at the picture's corner.
    """

    camera: CameraModel
    T_camera_board: RigidTransform
    """One a picture."""
    names: tuple[str, ...]
    """Estimated intrinsics (fy follows fx)."""
    covariance: Float[np.ndarray, "p p"]
    """Of the estimated intrinsics (px and plain numbers), with the boards' poses unknown."""
    residuals_px: Float[np.ndarray, "n 2"]
    """Found minus expected."""
    rms_px: float
    """Root mean square distance of corners in the fit."""
    held_out_rms_px: float
    """The same for pictures that were left out of the intrinsics' fit; NaN with too few pictures, or none held out."""
    picture_rms_px: Float[np.ndarray, "k"]
    outlying: tuple[int, ...]
    """Pictures that miss by far more than the others."""
    adjusted: Adjusted


def solve(problem: CameraProblem) -> CameraResult:
    """The intrinsics that explain the corners."""
    found = _estimate(problem)
    residuals = found.corner_residuals_px
    picture_rms = np.sqrt(_by_picture(np.sum(residuals**2, axis=1), problem.corners.picture))
    outlying = tuple(
        int(k)
        for k in np.flatnonzero(
            outlying_pictures(np.linalg.norm(residuals, axis=1), problem.corners.picture, _OUTLYING)
        )
    )
    information = marginal_information(found)
    condition, open_words = _observe(information, found.free, problem)
    rms_px = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    verdict, reasons = judge(
        [
            *weigh_convergence(found.fit.converged, found.fit.message),
            *_weigh_rms(rms_px),
            *_weigh_condition(condition, open_words),
            *(
                Finding(
                    verdict="doubtful", reason=f"picture {k} (counted from 0) misses by {picture_rms[k]:.3g} px rms"
                )
                for k in outlying
            ),
        ]
    )
    return CameraResult(
        camera=found.arrangement.camera,
        T_camera_board=found.arrangement.T_camera_board,
        names=found.free,
        covariance=_inverse(information) * found.fit.inflation,
        residuals_px=residuals,
        rms_px=rms_px,
        held_out_rms_px=_held_out_rms_px(problem, found.arrangement),
        picture_rms_px=picture_rms,
        outlying=outlying,
        condition_number=condition,
        observability=open_words,
        verdict=verdict,
        reasons=reasons,
        adjusted=found,
    )


def pose_board(
    camera: CameraModel, points_board: Float[np.ndarray, "n 3"], pixels: Float[np.ndarray, "n 2"]
) -> RigidTransform:
    """T_camera_board of one picture, the camera known (OpenCV's solvePnP, then least squares in pixels)."""
    rays = np.ascontiguousarray(camera.unproject(pixels)[:, :2])
    _, turn, shift = cv2.solvePnP(np.ascontiguousarray(points_board), rays, np.eye(3), np.zeros(5))
    near = rigid_from(Rotation.from_rotvec(turn.ravel()[None]), shift.reshape(1, 3))
    seen = Corners(points_board=points_board, pixels=pixels, picture=np.zeros(len(pixels), int))
    return refined_poses(camera, near, seen)[0]


def marginal_information(found: Adjusted, leading: int | None = None) -> Float[np.ndarray, "p p"]:
    """Information on the first parameters (the intrinsics, unless a number is given), all others unknown."""
    weighted = np.sqrt(found.fit.weights)[:, None, None] * found.fit.jacobian
    kept = without_others(weighted, len(found.free) if leading is None else leading)
    return kept.T @ kept


def _estimate(problem: CameraProblem) -> Adjusted:
    """The best of the starts: one, or several tilts."""
    starts = [0.0] if problem.lens == "plain" else _TILT_STARTS_DEG
    tried = [_from_tilt(problem, np.radians(x), np.radians(y)) for x in starts for y in starts if x == 0 or y == 0]
    return min(tried, key=lambda found: float(np.sum(found.fit.residuals**2)))


def _from_tilt(problem: CameraProblem, tau_x: float, tau_y: float) -> Adjusted:
    start = _start(problem, tau_x, tau_y)
    return adjust(start, problem.corners, None, free=FREE[problem.lens], corner_sigma_px=problem.sigma_px)


def _start(problem: CameraProblem, tau_x: float, tau_y: float) -> Arrangement:
    """OpenCV's calibration without lens distortion but with a given tilt."""
    size = (problem.width_px, problem.height_px)
    count = int(problem.corners.picture.max()) + 1
    chosen = [problem.corners.picture == k for k in range(count)]
    points = [problem.corners.points_board[k].astype(np.float32) for k in chosen]
    pixels = [problem.corners.pixels[k].astype(np.float32) for k in chosen]
    fixed = (
        cv2.CALIB_FIX_K1
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_ASPECT_RATIO
    )
    distortion = np.zeros(14)
    distortion[12:] = tau_x, tau_y
    if tau_x or tau_y:
        fixed |= cv2.CALIB_TILTED_MODEL | cv2.CALIB_FIX_TAUX_TAUY
    matrix = cv2.initCameraMatrix2D(points, pixels, size, 1.0)
    fixed |= cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K4 | cv2.CALIB_FIX_K5 | cv2.CALIB_FIX_K6
    try:
        _, matrix, _, turns, shifts = cv2.calibrateCamera(points, pixels, size, matrix, distortion, flags=fixed)
    except cv2.error as error:
        raise BadInput(
            f"camera: the boards give no start ({error.err or 'degenerate'}); are all pictures alike?"
        ) from error
    camera = CameraModel(
        width_px=problem.width_px,
        height_px=problem.height_px,
        focal_px=np.full(2, np.clip(abs(matrix[0, 0]), 50, 1e7)),
        principal_px=matrix[:2, 2],
        distortion=np.concatenate([np.zeros(12), [tau_x, tau_y]]),
    )
    rotation = Rotation.from_rotvec(np.array(turns).reshape(-1, 3))
    return Arrangement(camera=camera, T_camera_board=rigid_from(rotation, np.array(shifts).reshape(-1, 3)), plane=None)


def _held_out_rms_px(problem: CameraProblem, start: Arrangement) -> float:
    """Reprojection error of left-out pictures: their board is posed by half its corners, the other half is judged."""
    if not problem.hold_out or len(start.T_camera_board) < _FEWEST_PICTURES + _FOLDS - 1:
        return float("nan")
    corners, squares = problem.corners, []
    for fold in range(_FOLDS):
        out = corners.picture % _FOLDS == fold
        pictures, picture = np.unique(corners.picture[~out], return_inverse=True)
        kept = Corners(points_board=corners.points_board[~out], pixels=corners.pixels[~out], picture=picture)
        without = replace(start, T_camera_board=start.T_camera_board[pictures])
        fitted = adjust(without, kept, None, free=FREE[problem.lens], corner_sigma_px=problem.sigma_px)
        squares += _judged(corners, out, fitted.arrangement.camera)
    return float(np.sqrt(np.mean(squares)))


def _judged(corners: Corners, out: Bool[np.ndarray, "n"], camera: CameraModel) -> list[float]:
    squares: list[float] = []
    for k in np.unique(corners.picture[out]):
        rows = np.flatnonzero(corners.picture == k)
        fitted, judged = rows[::2], rows[1::2]
        T = pose_board(camera, corners.points_board[fitted], corners.pixels[fitted])
        missed = corners.pixels[judged] - camera.project(T.apply(corners.points_board[judged]))
        squares += list(np.sum(missed**2, axis=1))
    return squares


def _observe(
    information: Float[np.ndarray, "p p"], names: tuple[str, ...], problem: CameraProblem
) -> tuple[float, tuple[str, ...]]:
    """Condition number with every intrinsic scaled to a pixel at the picture's corner, and weak directions in words."""
    units = _pixel_units(names, problem)
    values, vectors = np.linalg.eigh(information / np.outer(units, units))
    roots = np.sqrt(np.maximum(values, 0))
    condition = float(roots[-1] / roots[0]) if roots[0] > 0 else np.inf
    weak = vectors[:, roots < roots[-1] / DOUBTFUL_CONDITION].T
    return condition, tuple(_words(direction, names) for direction in weak)


def _pixel_units(names: tuple[str, ...], problem: CameraProblem) -> Float[np.ndarray, "p"]:
    """Pixels by which one unit of each intrinsic moves a point in the picture's corner."""
    reach_px = np.hypot(problem.width_px, problem.height_px) / 2
    focal_px = float(_start(problem, 0.0, 0.0).camera.focal_px[0])
    r = reach_px / focal_px
    moved = {"fx": r, "cx": 1, "cy": 1, "k1": focal_px * r**3, "k2": focal_px * r**5, "p1": focal_px * 2 * r**2}
    moved |= {"p2": focal_px * 2 * r**2, "tau_x": focal_px * r**2, "tau_y": focal_px * r**2}
    return np.array([moved[name] for name in names])


def _weigh_rms(rms_px: float) -> list[Finding]:
    if rms_px <= _DOUBTFUL_RMS_PX:
        return []
    verdict: Verdict = "refused" if not rms_px <= _REFUSED_RMS_PX else "doubtful"
    return [
        Finding(verdict=verdict, reason=f"corners miss by {rms_px:.3g} px rms, expected below {_DOUBTFUL_RMS_PX:g} px")
    ]


def _weigh_condition(condition: float, words: tuple[str, ...]) -> list[Finding]:
    if condition <= DOUBTFUL_CONDITION:
        return []
    refused = not condition <= REFUSED_CONDITION
    reason = f"intrinsics: scaled condition number {condition:.3g}, {'not' if refused else 'hardly'} determined: "
    return [Finding(verdict="refused" if refused else "doubtful", reason=reason + "; ".join(words))]


def _words(direction: Float[np.ndarray, "p"], names: tuple[str, ...]) -> str:
    strong = np.abs(direction) > 0.3 * np.abs(direction).max()
    return " with ".join(name for name, named in zip(names, strong, strict=True) if named)


def _inverse(information: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    try:
        return np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    except np.linalg.LinAlgError:
        return np.full_like(information, np.inf)


def _by_picture(values: Float[np.ndarray, "n"], picture: Int[np.ndarray, "n"]) -> Float[np.ndarray, "k"]:
    return np.bincount(picture, values) / np.maximum(np.bincount(picture), 1)

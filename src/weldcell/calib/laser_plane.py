"""The light plane from boards that show the stripe: plane fit with known camera, or one bundle adjustment of all.

- `solve(problem)` with `method="board"`: camera known; each board is posed by its corners, the stripe's rays meet the
  boards in points of the light plane, a plane is fitted.
- `method="bundle"`: intrinsics (if they are to be estimated), board poses and plane together, in pixels.

The plane is given in the camera frame, which itself hangs on the intrinsics: a principal point that is off by 1 px
turns the frame by one pixel's angle, and the plane with it, while the points measured with both stay put. `agreement`
compares two sensors after turning that away.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.board_bundle import (
    Adjusted,
    Arrangement,
    Corners,
    StripePoints,
    across,
    adjust,
    plane_axes,
    pose_slopes,
    stripe_points_camera,
    tilted,
)
from weldcell.calib.camera import marginal_information, pose_board
from weldcell.calib.least_squares import fit
from weldcell.calib.verdict import (
    Block,
    Finding,
    Judged,
    Observability,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
    weigh_residual,
)
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid
from weldcell.cell.optics import CameraModel, LaserPlane

Method = Literal["board", "bundle"]

DOUBTFUL_RMS_M = 0.5e-3
REFUSED_RMS_M = 5e-3
_FEWEST_STRIPE_POINTS = 6
_PARALLEL_RAD = np.radians(5)  # boards that lean less than this from each other cannot tell the intrinsics


@dataclass(frozen=True, kw_only=True, eq=False)
class LaserPlaneProblem:
    """Boards with the stripe on them."""

    camera: CameraModel
    """Known, or a start where `free` names intrinsics."""
    corners: Corners
    stripe: StripePoints
    free: tuple[str, ...] = ()
    """Intrinsics to estimate from the same pictures (bundle only)."""
    corner_sigma_px: float = 0.1
    """Standard deviation of a corner along each axis."""
    method: Method = "bundle"

    def __post_init__(self) -> None:
        boards = np.unique(self.corners.picture)
        lit = np.unique(self.stripe.picture)
        if len(boards) < 2 or len(lit) < 2:
            raise BadInput(f"laser plane: {len(boards)} boards, {len(lit)} with a stripe, expected at least 2")
        if not np.isin(lit, boards).all():
            raise BadInput("laser plane: a picture shows the stripe but no board")
        if len(self.stripe.pixels) < _FEWEST_STRIPE_POINTS:
            raise BadInput(f"laser plane: {len(self.stripe.pixels)} stripe points, expected {_FEWEST_STRIPE_POINTS}")
        if self.free and self.method == "board":
            raise BadInput("laser plane: the board method takes the camera as known; use the bundle")


@dataclass(frozen=True, kw_only=True, eq=False)
class LaserPlaneResult(Judged):
    """The light plane, and how well it is known."""

    plane: LaserPlane
    camera: CameraModel
    """As given, or as estimated with the plane."""
    covariance: Float[np.ndarray, "3 3"]
    """Of the normal's two tilts along the laser frame's x and z (rad) and the offset (m)."""
    points_camera: Float[np.ndarray, "n 3"]
    """Stripe points on their boards (m)."""
    residuals_m: Float[np.ndarray, "n"]
    """Their distances from the plane."""
    rms_m: float
    corner_rms_px: float
    """Root mean square distance of corners from where they were expected."""
    leave_one_out_rms_m: float
    """How far a picture's stripe points lie from the plane that the other pictures give."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How far two sensors' measurements differ, their camera frames turned to let their rays agree."""

    normal_rad: float
    """Angle between the light planes."""
    plane_rms_m: float
    """Root mean square distance of the first sensor's points from the second's plane, over the picture."""
    frame_rad: float
    """How far the camera frames are turned against each other."""
    other_plane: LaserPlane
    """The second sensor's plane in the first one's camera frame."""


def solve(problem: LaserPlaneProblem) -> LaserPlaneResult:
    """The light plane by the method that the problem names."""
    poses = pose_boards(problem.camera, problem.corners)
    start = Arrangement(camera=problem.camera, T_camera_board=poses, plane=_first_plane(problem, poses))
    if start.plane is None:
        return _refused(problem, poses, "the stripe's points lie on one line: a plane through it may turn about it")
    parallel = _weigh_parallel(problem, poses)
    if parallel:
        return _refused(problem, poses, parallel[0].reason)
    if problem.method == "board":
        return _by_boards(problem, start)
    found = adjust(start, problem.corners, problem.stripe, free=problem.free, corner_sigma_px=problem.corner_sigma_px)
    return _result(problem, found, _marginal_covariance(found))


def pose_boards(camera: CameraModel, corners: Corners) -> RigidTransform:
    """T_camera_board of every picture, the camera known."""
    posed = []
    for k in range(int(corners.picture.max()) + 1):
        own = corners.picture == k
        posed.append(pose_board(camera, corners.points_board[own], corners.pixels[own]).as_matrix())
    return rigid(np.array(posed))


def plane_through(points_camera: Float[np.ndarray, "n 3"]) -> LaserPlane | None:
    """The plane nearest to points in the least squares sense; None where they lie on one line."""
    centre = points_camera.mean(axis=0)
    _, values, axes = np.linalg.svd(points_camera - centre, full_matrices=False)
    if not values[1] > 1e-3 * values[0]:
        return None
    return facing_away(axes[2], centre)


def facing_away(normal_camera: Float[np.ndarray, "3"], point_camera: Float[np.ndarray, "3"]) -> LaserPlane:
    """The plane through a point, its normal (of any length and sign) turned away from the camera."""
    normal = normal_camera / np.linalg.norm(normal_camera)
    offset_m = float(normal @ point_camera)
    return LaserPlane(normal_camera=np.copysign(1.0, offset_m) * normal, offset_m=abs(offset_m))


def angle_and_base(plane: LaserPlane) -> tuple[float, float]:
    """P1's theta (rad) and base length b (m): tan(theta) = z / (b + x), x being the axis that the depth moves along.

    x stands for the camera's y where the stripe runs along the rows; the axis counts away from the light.
    """
    normal = plane.normal_camera
    across = normal[0] if abs(normal[0]) > abs(normal[1]) else normal[1]
    if across == 0:
        return np.pi / 2, np.inf
    return float(np.arctan2(abs(across), normal[2])), float(plane.offset_m / abs(across))


def plane_blocks(lever_m: float) -> list[Block]:
    """A light plane's three parameters for `verdict.observe`; a tilt counts by what it moves at this distance."""
    return [
        Block(name="tilt along", frame="light plane", unit_m=lever_m, size=2),
        Block(name="offset along", frame="light plane's normal", size=1),
    ]


def agreement(camera: CameraModel, plane: LaserPlane, other_camera: CameraModel, other_plane: LaserPlane) -> Agreement:
    """How far the second sensor measures from the first."""
    u, v = np.meshgrid(np.linspace(0, camera.width_px - 1, 9), np.linspace(0, camera.height_px - 1, 7))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays, other_rays = camera.unproject(pixels), other_camera.unproject(pixels)
    turn, _ = Rotation.align_vectors(_unit(rays), _unit(other_rays))
    normal = turn.apply(other_plane.normal_camera)
    points = plane.intersect(rays)
    points = points[np.isfinite(points).all(axis=1)]
    return Agreement(
        normal_rad=float(
            np.arctan2(np.linalg.norm(np.cross(normal, plane.normal_camera)), normal @ plane.normal_camera)
        ),
        plane_rms_m=float(np.sqrt(np.mean((points @ normal - other_plane.offset_m) ** 2))),
        frame_rad=float(turn.magnitude()),
        other_plane=LaserPlane(normal_camera=normal / np.linalg.norm(normal), offset_m=other_plane.offset_m),
    )


def _first_plane(problem: LaserPlaneProblem, poses: RigidTransform) -> LaserPlane | None:
    points = stripe_points_camera(problem.stripe.pixels, problem.stripe.picture, problem.camera, poses)
    return plane_through(points[np.isfinite(points).all(axis=1)])


def _by_boards(problem: LaserPlaneProblem, start: Arrangement) -> LaserPlaneResult:
    """Plane fit to the points on the posed boards; the poses' own noise enters the covariance, board by board."""
    plane = start.plane
    assert plane is not None
    points = stripe_points_camera(problem.stripe.pixels, problem.stripe.picture, start.camera, start.T_camera_board)
    sigma_m = problem.stripe.sigma_px * _metres_per_pixel(problem, start, plane)
    axes, foot = plane_axes(plane), plane.offset_m * plane.normal_camera
    slopes = np.column_stack([(points - foot) @ axes.T, -np.ones(len(points))]) / sigma_m[:, None]

    def model(parameters: Float[np.ndarray, "3"]) -> tuple[np.ndarray, np.ndarray]:
        moved = tilted(plane, parameters[:2], float(parameters[2]))
        return (moved.distance_m(points) / sigma_m)[:, None], slopes[:, None, :]

    found = fit(model, np.zeros(3))
    estimate = tilted(plane, found.parameters[:2], float(found.parameters[2]))
    arrangement = Arrangement(camera=start.camera, T_camera_board=start.T_camera_board, plane=estimate)
    adjusted = Adjusted(
        arrangement=arrangement,
        fit=found,
        free=(),
        corner_residuals_px=pose_slopes(start.camera, start.T_camera_board, problem.corners)[0],
        stripe_residuals_px=found.residuals[:, 0] * problem.stripe.sigma_px,
    )
    spread = np.eye(len(points)) * found.inflation + _spread_by_poses(problem, arrangement, points, sigma_m)
    gain = np.linalg.solve(slopes.T @ slopes, slopes.T)
    return _result(problem, adjusted, gain @ spread @ gain.T)


def _metres_per_pixel(problem: LaserPlaneProblem, at: Arrangement, plane: LaserPlane) -> Float[np.ndarray, "n"]:
    """How far a stripe point moves from the plane for a pixel across the stripe."""
    step = across(problem.stripe.pixels, at.camera, plane) / 2
    before, after = (
        plane.distance_m(
            stripe_points_camera(problem.stripe.pixels + shift, problem.stripe.picture, at.camera, at.T_camera_board)
        )
        for shift in (-step, step)
    )
    return np.abs(after - before)


def _spread_by_poses(
    problem: LaserPlaneProblem, at: Arrangement, points: Float[np.ndarray, "n 3"], sigma_m: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n n"]:
    """Covariance of the whitened distances that comes from the boards' poses, which all points of a board share.

    A board that turns by w about its origin o and shifts by t meets a ray r, at p, later by the distance
    m.(w x (p - o) + t) / (m.r) along it (m: board's normal), which is n.r times that away from the light plane.
    """
    picture, T = problem.stripe.picture, at.T_camera_board.as_matrix()
    assert at.plane is not None
    board_normal, arm = T[picture, :3, 2], points - T[picture, :3, 3]
    lean = (points @ at.plane.normal_camera) / np.einsum("ni,ni->n", points, board_normal) / sigma_m
    slopes = np.hstack([np.cross(arm, board_normal), board_normal]) * lean[:, None]
    covariances = _pose_covariances(problem, at)
    spread = np.einsum("ni,nij,mj->nm", slopes, covariances[picture], slopes)
    return np.where(picture[:, None] == picture, spread, 0.0)


def _pose_covariances(problem: LaserPlaneProblem, at: Arrangement) -> Float[np.ndarray, "k 6 6"]:
    """Of each board's turn (rad) and shift (m) in the camera frame, by its corners."""
    _, slopes = pose_slopes(at.camera, at.T_camera_board, problem.corners)
    information = np.zeros((len(at.T_camera_board), 6, 6))
    np.add.at(information, problem.corners.picture, np.einsum("nci,ncj->nij", slopes, slopes))
    return np.linalg.inv(information) * problem.corner_sigma_px**2


def _marginal_covariance(found: Adjusted) -> Float[np.ndarray, "3 3"]:
    first = len(found.free)
    information = marginal_information(found, leading=first + 3)
    scale = 1 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    whole = np.linalg.pinv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return whole[first:, first:] * found.fit.inflation


def _result(problem: LaserPlaneProblem, found: Adjusted, covariance: Float[np.ndarray, "3 3"]) -> LaserPlaneResult:
    at = found.arrangement
    plane = at.plane
    assert plane is not None
    points = stripe_points_camera(problem.stripe.pixels, problem.stripe.picture, at.camera, at.T_camera_board)
    residuals = plane.distance_m(points)
    rms_m = float(np.sqrt(np.nanmean(residuals**2)))
    seen = _observe(problem, points, plane)
    verdict, reasons = judge(
        [
            *weigh_convergence(found.fit.converged, found.fit.message),
            *weigh_residual(rms_m, "stripe points", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M),
            *weigh_condition(seen, "light plane"),
        ]
    )
    return LaserPlaneResult(
        plane=plane,
        camera=at.camera,
        covariance=covariance,
        points_camera=points,
        residuals_m=residuals,
        rms_m=rms_m,
        corner_rms_px=float(np.sqrt(np.mean(np.sum(found.corner_residuals_px**2, axis=1)))),
        leave_one_out_rms_m=_left_out_rms_m(points, problem.stripe.picture),
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        verdict=verdict,
        reasons=reasons,
    )


def _observe(problem: LaserPlaneProblem, points: Float[np.ndarray, "n 3"], plane: LaserPlane) -> Observability:
    """How well the points tell the plane's tilts and offset, a tilt counted by what it moves at their distance."""
    axes = plane_axes(plane)
    foot = plane.offset_m * plane.normal_camera
    middle = np.nanmean(points, axis=0)
    lever_m = float(np.linalg.norm(middle - foot)) or plane.offset_m
    jacobian = np.column_stack([(points - foot) @ axes.T, -np.ones(len(points))])
    return observe(jacobian[np.isfinite(jacobian).all(axis=1)], plane_blocks(lever_m))


def _weigh_parallel(problem: LaserPlaneProblem, poses: RigidTransform) -> list[Finding]:
    """A refusal where intrinsics are to come from boards that are all parallel: focal length and distance trade."""
    if not problem.free:
        return []
    normals = poses.rotation.as_matrix()[:, :, 2]
    widest = np.arccos(np.clip(np.abs(normals @ normals.T).min(), 0, 1))
    if widest > _PARALLEL_RAD:
        return []
    reason = (
        f"boards lean at most {np.degrees(widest):.2g} deg from each other, expected more than "
        f"{np.degrees(_PARALLEL_RAD):.0f}: focal length and the boards' distance are not determined"
    )
    return [Finding(verdict="refused", reason=reason)]


def _left_out_rms_m(points: Float[np.ndarray, "n 3"], picture: Int[np.ndarray, "n"]) -> float:
    squares: list[float] = []
    sound = np.isfinite(points).all(axis=1)
    for k in np.unique(picture):
        plane = plane_through(points[sound & (picture != k)])
        if plane is None:
            return float("nan")
        squares += list(plane.distance_m(points[sound & (picture == k)]) ** 2)
    return float(np.sqrt(np.mean(squares)))


def _refused(problem: LaserPlaneProblem, poses: RigidTransform, reason: str) -> LaserPlaneResult:
    points = stripe_points_camera(problem.stripe.pixels, problem.stripe.picture, problem.camera, poses)
    return LaserPlaneResult(
        plane=LaserPlane(normal_camera=np.array([0.0, 0.0, 1.0]), offset_m=0.0),
        camera=problem.camera,
        covariance=np.full((3, 3), np.inf),
        points_camera=points,
        residuals_m=np.full(len(points), np.nan),
        rms_m=np.nan,
        corner_rms_px=np.nan,
        leave_one_out_rms_m=np.nan,
        condition_number=np.inf,
        observability=(reason,),
        verdict="refused",
        reasons=(reason,),
    )


def _unit(rays: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)

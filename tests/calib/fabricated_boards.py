"""Boards, lines and step targets before a sensor, observed exactly or with noise; no simulator."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.board_bundle import Corners, StripePoints, plane_axes
from weldcell.calib.chessboard import board_points
from weldcell.calib.dual_step import StepTargets
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel, LaserPlane

CAMERA = CameraModel(
    width_px=1440,
    height_px=1080,
    focal_px=np.array([3478.3, 3478.3]),
    principal_px=np.array([719.5, 539.5]),
    distortion=np.array([-0.10, 0.12, 2e-4, -1e-4, *np.zeros(10)]),
)
PLANE = LaserPlane(normal_camera=np.array([0.0, -1.0, 1.0]) / np.sqrt(2), offset_m=0.275 / np.sqrt(2))
ANGLE_P1_RAD, BASE_P1_M = np.radians(44.37), 0.09142
CAMERA_P1 = CameraModel(
    width_px=1280, height_px=1024, focal_px=np.full(2, 6759.5 / 5.2), principal_px=np.array([639.5, 511.5])
)
PLANE_P1 = LaserPlane(
    normal_camera=np.array([-np.sin(ANGLE_P1_RAD), 0.0, np.cos(ANGLE_P1_RAD)]),
    offset_m=BASE_P1_M * np.sin(ANGLE_P1_RAD),
)
BOARD = board_points(14, 10, 0.0065)
STEP_HEIGHTS_M = (0.0, 0.010, 0.020)
STEP_EDGES_M = (-0.03, -0.01, 0.01, 0.03)
_SMALLEST_SIGMA_PX = 0.01


def board_poses(rng: np.random.Generator, count: int, lean_rad: float = 0.7) -> RigidTransform:
    """Boards about the middle of the view."""
    angles = np.column_stack([rng.uniform(-lean_rad, lean_rad, (count, 2)), rng.uniform(-0.3, 0.3, count)])
    centres = rng.uniform([-0.006, -0.005, 0.265], [0.006, 0.005, 0.295], (count, 3))
    rotation = Rotation.from_euler("xyz", angles)
    return rigid_from(rotation, centres - rotation.apply(BOARD.mean(axis=0)))


def corners(rng: np.random.Generator, T_camera_board: RigidTransform, sigma_px: float, camera=CAMERA) -> Corners:
    """All corners of all boards."""
    count = len(T_camera_board)
    pixels = np.concatenate([camera.project(T_camera_board[k].apply(BOARD)) for k in range(count)])
    return Corners(
        points_board=np.tile(BOARD, (count, 1)),
        pixels=pixels + sigma_px * rng.normal(size=pixels.shape),
        picture=np.repeat(np.arange(count), len(BOARD)),
    )


def stripe(
    rng: np.random.Generator, T_camera_board: RigidTransform, sigma_px: float, camera=CAMERA, plane=PLANE, per_board=40
) -> StripePoints:
    """Points of the line in which light plane and board meet, by solving for it."""
    pixels, picture = [], []
    for k in range(len(T_camera_board)):
        normal, origin = T_camera_board[k].rotation.as_matrix()[:, 2], T_camera_board[k].translation
        along = np.cross(normal, plane.normal_camera)
        along = along / np.linalg.norm(along)
        middle = T_camera_board[k].apply(BOARD.mean(axis=0))
        foot = np.linalg.solve([normal, plane.normal_camera, along], [normal @ origin, plane.offset_m, along @ middle])
        pixels.append(camera.project(foot + np.linspace(-0.03, 0.03, per_board)[:, None] * along))
        picture.append(np.full(per_board, k))
    found = np.concatenate(pixels)
    found[:, 1] += sigma_px * rng.normal(size=len(found))
    sigma = np.full(len(found), max(sigma_px, _SMALLEST_SIGMA_PX))
    return StripePoints(pixels=found, picture=np.concatenate(picture), sigma_px=sigma)


def line_crossings(
    rng: np.random.Generator, camera, plane, distances_m, places_m, axis: int, sigma_px: float
) -> np.ndarray:
    """Pixels (boards, lines, 2) where the stripe crosses lines at `places_m` along image axis `axis`."""
    points = np.empty((len(distances_m), len(places_m), 3))
    points[..., axis], points[..., 2] = places_m, np.asarray(distances_m)[:, None]
    other, normal = 1 - axis, plane.normal_camera
    points[..., other] = (plane.offset_m - points[..., axis] * normal[axis] - points[..., 2] * normal[2]) / normal[
        other
    ]
    pixels = camera.project(points)
    return pixels + sigma_px * rng.normal(size=pixels.shape)


def step_targets(
    rng: np.random.Generator, count: int, sigma_px: float, edge_sigma_px: float, per_level: int = 15
) -> StepTargets:
    """Targets of three levels, leaning up to 0.3 rad about each axis."""
    axes, normal = plane_axes(PLANE), PLANE.normal_camera
    upright = np.column_stack([axes[0], np.cross(-axes[1], axes[0]), -axes[1]])
    pixels, picture, heights, edges = [], [], [], []
    for k in range(count):
        turn = upright @ Rotation.from_euler("xyz", rng.uniform(-0.3, 0.3, 3)).as_matrix()
        origin = PLANE.T_camera_laser.apply([0, 0, 0.19 + rng.uniform(-0.02, 0.03)]) + axes[0] * rng.uniform(
            -5e-3, 5e-3
        )
        for j, height in enumerate(STEP_HEIGHTS_M):
            inner = np.linspace(STEP_EDGES_M[j] + 1e-3, STEP_EDGES_M[j + 1] - 1e-3, per_level)
            for x in (STEP_EDGES_M[j], *inner, STEP_EDGES_M[j + 1]):
                point = origin + turn[:, 0] * x + turn[:, 2] * height
                y = (PLANE.offset_m - normal @ point) / (normal @ turn[:, 1])
                pixels.append(CAMERA.project(point + turn[:, 1] * y))
                picture.append(k)
                heights.append(height)
                edges.append(x if x in STEP_EDGES_M else np.nan)
    found, at_edge = np.array(pixels), np.isfinite(edges)
    found[:, 1] += sigma_px * rng.normal(size=len(found))
    found[at_edge, 0] += edge_sigma_px * rng.normal(size=int(at_edge.sum()))
    return StepTargets(
        pixels=found,
        picture=np.array(picture),
        height_m=np.array(heights),
        edge_m=np.array(edges),
        sigma_px=np.full(len(found), max(sigma_px, _SMALLEST_SIGMA_PX)),
        edge_sigma_px=max(edge_sigma_px, _SMALLEST_SIGMA_PX),
    )


def plane_offsets(found: LaserPlane, truth: LaserPlane) -> np.ndarray:
    """Two tilts (rad) along the true laser frame's x and z, and the offset's difference (m)."""
    tilts = plane_axes(truth) @ (found.normal_camera - truth.normal_camera)
    return np.append(tilts, found.offset_m - truth.offset_m)

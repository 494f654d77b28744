"""Where boards are held before a sensor: chosen as a person does who watches the live picture, on the drawn sensor."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import LaserPlaneConfig
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.models.board import Chessboard, LineBoard, StepTarget
from weldcell.sensor_sim.focus import Lens

_FILLED = 0.75  # of the view by a chessboard
_DEPTH_SHARE = (0.08, 0.92)  # of the picture along the depth: where the stripe may lie on boards that face the camera
_MARGIN_PX = 12.0
_LIT_SHARE = 0.6  # of the board's width that the stripe must cross
_LEAST_COS = 0.3  # between the board and the light, and the board and the view
_MOST_BLUR_PX = 2.5
_TURN_RAD = 0.3
_ATTEMPTS = 20_000
_LINE_PX = 14.0  # width of a printed line
_LINES_SHARE = 0.5  # of the view at the nearest place between the outer lines
_STEP_SHARE = 0.55  # of the view by the step target
_STEP_LEAN_RAD = 0.35


@dataclass(frozen=True, kw_only=True)
class View:
    """The sensor as drawn."""

    camera: CameraModel
    plane: LaserPlane
    lens: Lens
    along: Literal["rows", "columns"]
    """What the stripe runs along."""

    @property
    def middle_m(self) -> float:
        """Distance at which the camera's axis meets the light."""
        return float(self.plane.intersect(np.array([0.0, 0.0, 1.0]))[2])

    def size_m(self, distance_m: float) -> Float[np.ndarray, "2"]:
        """Width and height of what is seen at a distance."""
        return np.array([self.camera.width_px, self.camera.height_px]) / self.camera.focal_px * distance_m

    @property
    def depths_m(self) -> tuple[float, float]:
        """Distances of boards that face the camera and show the stripe well within the picture."""
        axis = 1 if self.along == "rows" else 0
        pixels = np.tile(self.camera.principal_px, (2, 1))
        pixels[:, axis] = np.array(_DEPTH_SHARE) * (self.camera.height_px if axis else self.camera.width_px)
        near, far = self.plane.intersect(self.camera.unproject(pixels))[:, 2]
        if not np.isfinite([near, far]).all():
            raise BadInput("sensor: its picture does not show where boards meet the light")
        return float(near), float(far)


def chessboard(plan: LaserPlaneConfig, view: View) -> Chessboard:
    """The configured board, or one of a size that suits the view."""
    fits = _FILLED * view.size_m(view.middle_m) / [plan.columns + 1, plan.rows + 1]
    square_m = 1e-3 * plan.square_mm or float(np.floor(4e3 * fits.min())) / 4e3
    return Chessboard(columns=plan.columns, rows=plan.rows, square_m=square_m)


def line_board(plan: LaserPlaneConfig, view: View) -> LineBoard:
    """A board whose lines are wide enough to be measured and long enough for all places."""
    near, far = view.depths_m
    across = view.size_m(near)[0 if view.along == "rows" else 1]
    depth_axis = 1 if view.along == "rows" else 0
    reach_m = max(abs(view.plane.intersect(view.camera.unproject(view.camera.principal_px))[depth_axis]), 0.0)
    reach_m += max(far - view.middle_m, view.middle_m - near) * abs(
        view.plane.normal_camera[2] / view.plane.normal_camera[depth_axis]
    )
    return LineBoard(
        lines=plan.lines,
        spacing_m=_LINES_SHARE * across / (plan.lines - 1),
        width_m=_LINE_PX / float(view.camera.focal_px[0]) * view.middle_m,
        length_m=2.4 * reach_m,
    )


def step_target(view: View) -> StepTarget:
    """Three levels, each a sixth of the target's width above the one before."""
    span_m = _STEP_SHARE * view.size_m(view.middle_m)[0 if view.along == "rows" else 1]
    span_m = float(np.floor(span_m * 200)) / 200
    return StepTarget(
        edges_m=(-span_m / 2, -span_m / 6, span_m / 6, span_m / 2),
        heights_m=(0.0, span_m / 6, span_m / 3),
        length_m=0.5 * span_m,
    )


def chessboard_poses(
    plan: LaserPlaneConfig, board: Chessboard, view: View, rng: np.random.Generator
) -> list[RigidTransform]:
    """T_camera_board of boards that lean every way, wholly in the picture, sharp enough, and crossed by the stripe."""
    near, far = view.depths_m
    poses: list[RigidTransform] = []
    for _ in range(_ATTEMPTS):
        lean, towards = np.radians(plan.lean_deg) * np.sqrt(rng.uniform()), rng.uniform(0, 2 * np.pi)
        rotation = Rotation.from_rotvec(lean * np.array([np.cos(towards), np.sin(towards), 0.0]))
        rotation = rotation * Rotation.from_rotvec([0, 0, rng.uniform(-_TURN_RAD, _TURN_RAD)])
        distance_m = rng.uniform(near, far)
        centre = np.append(rng.uniform(-0.35, 0.35, 2) * view.size_m(distance_m), distance_m)
        T = rigid_from(rotation, centre - rotation.apply(board.corners_board.mean(axis=0)))
        if _shows(T, board, view):
            poses.append(T)
            if len(poses) == plan.boards:
                return poses
    raise BadInput(
        f"laser_plane: {len(poses)} places of {_ATTEMPTS} tried show the whole board with the stripe, expected "
        f"{plan.boards}; is laser_plane.square_mm too large?"
    )


def facing_poses(plan: LaserPlaneConfig, view: View, rng: np.random.Generator) -> list[RigidTransform]:
    """T_camera_board of the board of lines along the camera's axis; its lines run as depth moves the stripe."""
    turned = 0.0 if view.along == "rows" else -np.pi / 2
    poses = []
    for distance_m in np.linspace(*view.depths_m, plan.positions):
        off = Rotation.from_rotvec(np.radians(plan.misfacing_deg) * np.append(rng.normal(size=2), 0))
        poses.append(rigid_from(off * Rotation.from_rotvec([0, 0, turned]), np.array([0, 0, distance_m])))
    return poses


def step_target_poses(
    plan: LaserPlaneConfig, target: StepTarget, view: View, rng: np.random.Generator
) -> list[RigidTransform]:
    """T_camera_target of targets that stand nearly upright under the light, at different depths and leans."""
    near, far = view.depths_m
    axes = view.plane.T_camera_laser.rotation.as_matrix()
    upright = Rotation.from_matrix(np.column_stack([axes[:, 0], -axes[:, 1], -axes[:, 2]]))
    middle = np.array([0.0, 0.0, np.mean(target.heights_m)])
    poses = []
    for distance_m in np.linspace(near + 0.2 * (far - near), far - 0.2 * (far - near), plan.step_targets):
        rotation = upright * Rotation.from_euler("xyz", rng.uniform(-_STEP_LEAN_RAD, _STEP_LEAN_RAD, 3))
        # straight down the light from where it meets the camera's axis
        reach_m = (distance_m - view.middle_m) / axes[2, 2]
        place = np.array([0, 0, view.middle_m]) + axes[:, 2] * reach_m
        place = place + axes[:, 0] * rng.uniform(-0.03, 0.03) * view.middle_m
        poses.append(rigid_from(rotation, place - rotation.apply(middle)))
    return poses


def _shows(T_camera_board: RigidTransform, board: Chessboard, view: View) -> bool:
    low, high = -1.5 * board.square_m, (np.array([board.columns, board.rows]) + 0.5) * board.square_m
    ring = np.array([[low, low], [high[0], low], [high[0], high[1]], [low, high[1]]])
    points = T_camera_board.apply(np.column_stack([ring, np.zeros(4)]))
    pixels = view.camera.project(points)
    size = np.array([view.camera.width_px, view.camera.height_px])
    if not np.all((pixels > _MARGIN_PX) & (pixels < size - 1 - _MARGIN_PX)):
        return False
    if view.lens.blur_sigma_px(points, pixels, view.camera).max() > _MOST_BLUR_PX:
        return False
    normal, light = T_camera_board.rotation.as_matrix()[:, 2], view.plane.T_camera_laser.rotation.as_matrix()[:, 2]
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    return min(float(normal @ light), float((rays @ normal).min())) > _LEAST_COS and _crossed(
        T_camera_board, board, view
    )


def _crossed(T_camera_board: RigidTransform, board: Chessboard, view: View) -> bool:
    """Whether the light plane cuts the squares over most of their width or height."""
    by_axis = T_camera_board.rotation.as_matrix()[:, :2].T @ view.plane.normal_camera
    offset = view.plane.offset_m - view.plane.normal_camera @ T_camera_board.translation
    sides = np.array([board.columns, board.rows]) * board.square_m
    for axis in (0, 1):
        places = np.linspace(-board.square_m, sides[axis], 50)
        other = (offset - by_axis[axis] * places) / (by_axis[1 - axis] or 1e-12)
        if np.mean((other > -board.square_m) & (other < sides[1 - axis])) > _LIT_SHARE:
            return True
    return False

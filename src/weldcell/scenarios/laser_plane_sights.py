"""The three boards before the sensor: pictures are taken, and what the methods need is found in them."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib.board_bundle import Corners, StripePoints
from weldcell.calib.camera import CameraResult
from weldcell.calib.dual_step import StepTargets
from weldcell.calib.printed_lines import line_crossings
from weldcell.calib.step_pieces import StepPieces, step_pieces
from weldcell.cell.configuration import CellConfig
from weldcell.cell.errors import JobFailed
from weldcell.cell.optics import CameraModel
from weldcell.cell.profile import Stripe
from weldcell.cell.randomness import generator
from weldcell.models.board import Chessboard, LineBoard, StepTarget
from weldcell.scenarios.board_bench import BoardBench
from weldcell.scenarios.board_poses import (
    View,
    chessboard,
    chessboard_poses,
    facing_poses,
    line_board,
    step_target,
    step_target_poses,
)
from weldcell.scenarios.board_sights import BoardSight, BoardSize, camera_from, corners_of, see_board, stripe_of
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.sensor_sim.design import nominal_camera, nominal_plane
from weldcell.sensor_sim.focus import lens
from weldcell.tracking.stripe import Along, find_stripe

_FEWEST_SHARE = 0.6  # of the pictures of a kind must show what they are taken for
_EVERY_POINT = 8  # of a step target's stripe: wider apart than the speckle's grain
_FEWEST_ENDS = 2  # of a target's levels
_EDGE_SIGMA_PX = 0.8
NO_STRIPE = Stripe(u_px=np.zeros(0), v_px=np.zeros(0), sigma_px=np.zeros(0))


@dataclass(frozen=True, kw_only=True, eq=False)
class LaserPlaneSights:
    """What all pictures show."""

    camera: CameraResult
    """From the chessboards."""
    corners: Corners
    stripe: StripePoints
    crossings_px: Float[np.ndarray, "boards lines 2"]
    """Where the stripe crosses the printed lines."""
    spacing_m: float
    """Of the printed lines."""
    targets: StepTargets
    """Stripe points and ends on the step targets."""


class Boards:
    """The boards for a sensor, and where they are held."""

    def __init__(self, config: CellConfig, seed: int) -> None:
        sensor, self._plan = config.sensor, config.laser_plane
        self.along = sensor.stripe_along
        self.tilted = any(sensor.tilt_deg)
        self.view = View(
            camera=nominal_camera(sensor), plane=nominal_plane(sensor), lens=lens(sensor), along=self.along
        )
        self.chessboard: Chessboard = chessboard(self._plan, self.view)
        self.lines: LineBoard = line_board(self._plan, self.view)
        self.steps: StepTarget = step_target(self.view)
        rng = generator(seed, "boards/places")
        self.chessboard_poses = chessboard_poses(self._plan, self.chessboard, self.view, rng)
        self.line_poses = facing_poses(self._plan, self.view, rng)
        self.step_poses = step_target_poses(self._plan, self.steps, self.view, rng)

    @property
    def all(self) -> tuple[Chessboard, LineBoard, StepTarget]:
        """Everything that is held before the sensor."""
        return self.chessboard, self.lines, self.steps

    @property
    def size(self) -> BoardSize:
        """The chessboard as its owner describes it."""
        board = self.chessboard
        return BoardSize(columns=board.columns, rows=board.rows, square_m=board.square_m)


def take_sights(bench: BoardBench, boards: Boards, recording: Recording, progress: Progress) -> LaserPlaneSights:
    """All pictures, in the order of the methods, and what was found in them."""
    recording.begin_stage("chessboards", "Chessboards", frame=bench.frame, time_s=bench.time_s)
    corners, stripe, camera = _chessboards(bench, boards, progress)
    recording.begin_stage("lines", "Board of parallel lines", frame=bench.frame, time_s=bench.time_s)
    crossings_px = _lines(bench, boards, camera.camera, progress)
    recording.begin_stage("steps", "Step target", frame=bench.frame, time_s=bench.time_s)
    return LaserPlaneSights(
        camera=camera,
        corners=corners,
        stripe=stripe,
        crossings_px=crossings_px,
        spacing_m=boards.lines.spacing_m,
        targets=_steps(bench, boards, progress),
    )


def _chessboards(bench: BoardBench, boards: Boards, progress: Progress) -> tuple[Corners, StripePoints, CameraResult]:
    sights: list[BoardSight] = []
    for T in progress.track(boards.chessboard_poses, "chessboards"):
        picture = bench.see(boards.chessboard.name, T)
        sight = see_board(picture, boards.size)
        bench.log(picture, NO_STRIPE, np.zeros((0, 2)) if sight is None else sight.corners_px)
        if sight is not None:
            sights.append(sight)
    _require(len(sights), len(boards.chessboard_poses), "the chessboard")
    corners = corners_of(sights, boards.size)
    view = boards.view.camera
    camera = camera_from(corners, view.width_px, view.height_px, "tilted" if boards.tilted else "plain")
    return corners, stripe_of(sights, boards.size, camera.camera, corners, boards.along), camera


def _lines(
    bench: BoardBench, boards: Boards, camera: CameraModel, progress: Progress
) -> Float[np.ndarray, "boards lines 2"]:
    found = []
    for T in progress.track(boards.line_poses, "parallel lines"):
        picture = bench.see(boards.lines.name, T)
        stripe = find_stripe(picture, along=boards.along)
        lines: Along = "columns" if boards.along == "rows" else "rows"
        stripe_px = np.column_stack([stripe.u_px, stripe.v_px])
        crossings = line_crossings(picture, stripe_px, camera, lines=boards.lines.lines, along=lines)
        bench.log(picture, stripe, np.zeros((0, 2)) if crossings is None else crossings)
        if crossings is not None:
            found.append(crossings)
    _require(len(found), len(boards.line_poses), "the printed lines with the stripe across")
    return np.array(found)


def _steps(bench: BoardBench, boards: Boards, progress: Progress) -> StepTargets:
    found = []
    target = boards.steps
    for T in progress.track(boards.step_poses, "step target"):
        picture = bench.see(target.name, T)
        stripe = find_stripe(picture, along=boards.along)
        pieces = step_pieces(
            picture,
            np.column_stack([stripe.u_px, stripe.v_px]),
            stripe.sigma_px,
            along=boards.along,
            forward=_forward(boards, T),
            levels=len(target.heights_m),
            ends=target.free_edges,
            every=_EVERY_POINT,
        )
        ends = np.zeros((0, 2)) if pieces is None else pieces.pixels[pieces.edge >= 0]
        bench.log(picture, stripe, ends)
        if pieces is not None and len(ends) >= _FEWEST_ENDS:
            found.append(pieces)
    _require(len(found), len(boards.step_poses), "the step target's levels")
    return _targets(found, target)


def _forward(boards: Boards, T_camera_target: RigidTransform) -> int:
    """Whether the target's x runs with growing columns (rows) of the picture: as a person sees who looks at it."""
    pixels = boards.view.camera.project(T_camera_target.apply(np.array([[0.0, 0, 0], [1e-3, 0, 0]])))
    return 1 if np.diff(pixels[:, 0 if boards.along == "rows" else 1])[0] > 0 else -1


def _targets(found: list[StepPieces], target: StepTarget) -> StepTargets:
    edges, heights = np.array(target.edges_m), np.array(target.heights_m)
    edge = np.concatenate([one.edge for one in found])
    return StepTargets(
        pixels=np.concatenate([one.pixels for one in found]),
        picture=np.repeat(np.arange(len(found)), [len(one.level) for one in found]),
        height_m=heights[np.concatenate([one.level for one in found])],
        edge_m=np.where(edge >= 0, edges[np.maximum(edge, 0)], np.nan),
        sigma_px=np.concatenate([one.sigma_px for one in found]),
        edge_sigma_px=_EDGE_SIGMA_PX,
    )


def _require(found: int, taken: int, what: str) -> None:
    if found < _FEWEST_SHARE * taken or found < 2:
        raise JobFailed(f"laser plane: {what} was found in {found} of {taken} pictures")


def noisy_targets(targets: StepTargets, noise_px: float, axis: int, rng: np.random.Generator) -> StepTargets:
    """The same with normal noise across the stripe (`axis`) and, at the ends, along it."""
    at_edge = np.isfinite(targets.edge_m)
    pixels = targets.pixels.copy()
    pixels[:, axis] += noise_px * rng.normal(size=len(pixels))
    pixels[at_edge, 1 - axis] += noise_px * rng.normal(size=int(at_edge.sum()))
    return replace(
        targets,
        pixels=pixels,
        sigma_px=np.hypot(targets.sigma_px, noise_px),
        edge_sigma_px=float(np.hypot(targets.edge_sigma_px, noise_px)),
    )

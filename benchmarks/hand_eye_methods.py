"""Hand-eye methods side by side on the same poses, many calibrations at once against a loop, and degenerate data."""

import time
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

import degenerate_problems
import synthetic
import synthetic_arm
from benchmarks.table import Figure
from benchmarks.timing import interleaved_ms
from weldcell.calib import axxb, hand_eye_batch, joint_estimate, sphere_sight
from weldcell.calib.axxb_methods import METHODS, motions
from weldcell.calib.board_bundle import Corners, pose_slopes
from weldcell.calib.chessboard import board_points
from weldcell.calib.joint_problem import Sizes
from weldcell.cell.frames import difference, rigid_from
from weldcell.cell.optics import CameraModel

TRIALS = 200
POSES = 20
BOARD = board_points(11, 8, 0.006)
CAMERA = CameraModel(
    width_px=1440, height_px=1080, focal_px=np.array([3478.3, 3478.3]), principal_px=np.array([719.5, 539.5])
)


@dataclass(frozen=True, kw_only=True)
class Level:
    """How noisy the data are."""

    words: str
    """The same in words."""
    point_m: float
    """Of a point target in the sensor, each axis."""
    corner_px: float
    """Of a board's corner, each axis."""
    robot_m: float
    """Of the flange, each axis."""
    robot_rad: float
    """Of its orientation, each axis."""


LEVELS = (
    Level(
        words="fine: point 0.02 mm, corners 0.05 px, exact robot",
        point_m=2e-5,
        corner_px=0.05,
        robot_m=0.0,
        robot_rad=0.0,
    ),
    Level(
        words="usual: point 0.05 mm, corners 0.1 px, robot 0.04 mm and 0.1 mrad",
        point_m=5e-5,
        corner_px=0.1,
        robot_m=4e-5,
        robot_rad=1e-4,
    ),
    Level(
        words="coarse: point 0.2 mm, corners 0.3 px, robot 0.2 mm and 0.5 mrad",
        point_m=2e-4,
        corner_px=0.3,
        robot_m=2e-4,
        robot_rad=5e-4,
    ),
)


def tables() -> dict[str, list[Figure]]:
    """What `python -m benchmarks hand-eye` shows."""
    shown = {}
    for level in LEVELS:
        figures = []
        for name, (angle_deg, distance_mm) in compare(level).items():
            figures += [
                Figure(name=f"{name}, rotation", value=angle_deg, unit="deg"),
                Figure(name=f"{name}, translation", value=distance_mm, unit="mm"),
            ]
        shown[f"Hand-eye methods, {level.words}"] = figures
    loop_us, batch_us = solution_times_us()
    shown["Hand-eye of 20 sights, many at once"] = [
        Figure(name="scipy.optimize.least_squares in a loop", value=loop_us, unit="us"),
        Figure(name="hand_eye_batch, 10 000 at once", value=batch_us, unit="us"),
        Figure(name="ratio", value=loop_us / batch_us, at_least=10.0),
    ]
    shown["Estimators, over one of these loop's solutions"] = [
        Figure(name=name, value=1e3 * value_ms / loop_us, at_most=most)
        for name, value_ms, most in (
            ("sphere in a profile", sphere_time_ms(), 10.0),
            ("joint estimate of arm, sensor and torch", joint_time_ms(), 200.0),
        )
    ]
    outcomes = degenerate_counts()
    shown["10 000 random degenerate problems"] = [
        Figure(name=name, value=value, at_most=0.0 if name == "silent" else None) for name, value in outcomes.items()
    ]
    return shown


def compare(level: Level, trials: int = TRIALS, seed: int = 0) -> dict[str, tuple[float, float]]:
    """Root mean square error of each method's rotation (deg) and translation (mm), on the same noisy robot poses."""
    rng = np.random.default_rng(seed)
    sights = synthetic.sights(rng, translations=POSES // 2, free=POSES // 2)
    board = _board_before(sights, rng)
    spread = _board_covariances(board, level.corner_px)
    errors: dict[str, list[tuple[float, float]]] = {}
    for _ in range(trials):
        turned = Rotation.from_rotvec(rng.normal(0, level.robot_rad, (POSES, 3))) * sights.T_base_flange.rotation
        reported = rigid_from(turned, sights.T_base_flange.translation + rng.normal(0, level.robot_m, (POSES, 3)))
        centres = sights.centres_camera + rng.normal(0, level.point_m, (POSES, 3))
        noise = np.einsum("nij,nj->ni", np.linalg.cholesky(spread), rng.normal(size=(POSES, 6)))
        seen = rigid_from(Rotation.from_rotvec(noise[:, :3]) * board.rotation, board.translation + noise[:, 3:])
        mounts = _by_point(reported, centres, sights.translations) | _by_board(reported, seen, spread, level)
        for name, mount in mounts.items():
            errors.setdefault(name, []).append(_error(mount, sights.T_flange_camera))
    rms = {name: np.sqrt(np.mean(np.square(values), axis=0)) for name, values in errors.items()}
    return {name: (float(value[0]), float(value[1])) for name, value in rms.items()}


def _by_point(reported: RigidTransform, centres: np.ndarray, translations: np.ndarray) -> dict[str, RigidTransform]:
    """The mount by the methods that see one point."""
    batch = hand_eye_batch.HandEyeBatch(T_base_flange=reported, centres_camera=centres[None], translations=translations)
    found = {
        "point, closed form (P1)": hand_eye_batch.solve(batch, refine=False),
        "point, joint": hand_eye_batch.solve(batch),
    }
    return {
        name: rigid_from(Rotation.from_matrix(one.R_flange_camera[0]), one.translation_flange[0])
        for name, one in found.items()
    }


def _by_board(
    reported: RigidTransform, seen: RigidTransform, spread: np.ndarray, level: Level
) -> dict[str, RigidTransform]:
    """The mount by the methods that see a board's pose."""
    pairs = motions(reported, seen)
    joint = axxb.solve(
        axxb.BoardHandEyeProblem(
            T_base_flange=reported,
            T_camera_board=seen,
            covariances_camera=spread,
            pose_sigma_m=max(level.robot_m, 1e-6),
            pose_sigma_rad=max(level.robot_rad, 1e-6),
        )
    )
    return {f"board, {name}": closed(pairs) for name, closed in METHODS.items()} | {
        "board, joint": joint.T_flange_camera
    }


def _error(found: RigidTransform, truth: RigidTransform) -> tuple[float, float]:
    angle_rad, distance_m = difference(found, truth)
    return float(np.rad2deg(angle_rad)), 1e3 * distance_m


def _board_before(sights: synthetic.Sights, rng: np.random.Generator) -> RigidTransform:
    """T_camera_board where a board lies at the point target: the same poses see it."""
    T_base_board = rigid_from(Rotation.from_rotvec(rng.normal(0, 0.05, 3)), sights.target_base)
    return (sights.T_base_flange * sights.T_flange_camera).inv() * T_base_board


def _board_covariances(T_camera_board: RigidTransform, corner_px: float) -> np.ndarray:
    """Of each board pose, from its corners (turn about the board's origin, then shift; camera axes)."""
    points = np.tile(BOARD - BOARD.mean(axis=0), (POSES, 1))
    picture = np.repeat(np.arange(POSES), len(BOARD))
    corners = Corners(points_board=points, pixels=np.zeros((len(points), 2)), picture=picture)
    slopes = pose_slopes(CAMERA, T_camera_board, corners)[1].reshape(POSES, -1, 6)
    return np.linalg.inv(slopes.swapaxes(1, 2) @ slopes) * corner_px**2


def solution_times_us(count: int = 10_000, looped: int = 300) -> tuple[float, float]:
    """Time of one solution (20 sights): in a loop over SciPy's least_squares from the truth, and in a batch."""
    rng = np.random.default_rng(0)
    sights = synthetic.sights(rng)
    centres = sights.centres_camera + rng.normal(0, 2e-4, (count, POSES, 3))
    R_base_flange, places = sights.T_base_flange.rotation.as_matrix(), sights.T_base_flange.translation

    def residuals(p: np.ndarray, seen: np.ndarray) -> np.ndarray:
        flange = seen @ Rotation.from_rotvec(p[:3]).as_matrix().T + p[3:6]
        return (np.einsum("nij,nj->ni", R_base_flange, flange) + places - p[6:]).ravel()

    mount = sights.T_flange_camera
    start = np.concatenate([mount.rotation.as_rotvec(), mount.translation, sights.target_base])
    begin = time.perf_counter()
    for one in centres[:looped]:
        least_squares(residuals, start, args=(one,))
    loop_us = 1e6 * (time.perf_counter() - begin) / looped
    batch = hand_eye_batch.HandEyeBatch(T_base_flange=sights.T_base_flange, centres_camera=centres)
    times = []
    for _ in range(3):
        begin = time.perf_counter()
        hand_eye_batch.solve(batch)
        times.append(1e6 * (time.perf_counter() - begin) / count)
    return loop_us, float(np.median(times))


def sphere_time_ms(repeats: int = 20) -> float:
    """Median time to find the sphere in a profile of which one point in ten is a stray."""
    rng = np.random.default_rng(7)
    off_m = np.where(rng.random(700) < 0.1, rng.uniform(-0.03, 0.03, 700), rng.normal(0, 3e-5, 700))
    light = synthetic.PLANE.T_camera_laser.rotation.apply([0.0, 0.0, 1.0])
    points_camera = synthetic.arc(0.010)[0] + off_m[:, None] * light
    problem = sphere_sight.SphereSightProblem(
        points_camera=points_camera,
        sigma_m=np.full(700, 3e-5),
        plane=synthetic.PLANE,
        radius_m=synthetic.SPHERE_RADIUS_M,
        side=1,
    )
    return interleaved_ms({"sphere": lambda: sphere_sight.solve(problem)}, repeats)["sphere"]


def joint_time_ms(repeats: int = 5) -> float:
    """Median time of the joint estimate of a session as `commission` makes it."""
    rng = np.random.default_rng(8)
    cell, plan = synthetic_arm.drawn_cell(rng, Sizes()), synthetic_arm.plan(rng)
    problem = synthetic_arm.observe(cell, plan, rng, Sizes())
    return interleaved_ms({"joint": lambda: joint_estimate.solve(problem)}, repeats)["joint"]


def degenerate_counts(count: int = 10_000) -> dict[str, float]:
    """How random degenerate problems end: `silent` must be 0."""
    outcomes = Counter(degenerate_problems.outcome(seed) for seed in range(count))
    return {name: float(outcomes[name]) for name in sorted({*outcomes, "silent"})}

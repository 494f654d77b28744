"""Predicted covariance against Monte Carlo: each standard deviation, and how often 95 % regions hold the truth."""

from collections.abc import Callable

import numpy as np
from scipy.stats import chi2

import synthetic_arm
from benchmarks.table import Figure
from calib import fabricated_boards as made
from weldcell.calib import dual_step, laser_plane, vanishing_point
from weldcell.calib.board_bundle import intrinsics_of
from weldcell.calib.camera import CameraProblem
from weldcell.calib.camera import solve as solve_camera
from weldcell.cell.optics import LaserPlane

TRIALS = 500
BOARDS = 6
Trial = Callable[[np.random.Generator], tuple[np.ndarray, np.ndarray]]
"""One calibration: its error and its covariance."""

_INTRINSICS = [0, 2, 3, 4, 5, 6, 7]  # f, cx, cy, k1, k2, p1, p2
_ROUGH = LaserPlane(normal_camera=np.array([0.02, -1.0, 1.03]) / np.linalg.norm([0.02, -1.0, 1.03]), offset_m=0.196)


def figures(trials: int = TRIALS) -> list[Figure]:
    """Worst ratio of scatter over prediction, and coverage, for each method."""
    poses = made.board_poses(np.random.default_rng(11), BOARDS)
    methods: dict[str, Trial] = {
        "camera": lambda rng: _camera(rng, poses),
        "board": lambda rng: _boards(rng, poses, "board"),
        "bundle": lambda rng: _boards(rng, poses, "bundle"),
        "vanishing point": _lines,
        "dual step": _steps,
    }
    rows = [row for name, method in methods.items() for row in _judged(name, method, trials)]
    joint = synthetic_arm.honesty(trials, adapt=False)
    for name, ratios in joint.sigma_ratio.items():
        rows += _rows(f"joint estimate, {name}", _worst(ratios), joint.coverage[name])
    return rows


def _judged(name: str, method: Trial, trials: int) -> list[Figure]:
    pairs = [method(np.random.default_rng(seed)) for seed in range(trials)]
    errors, covariances = np.array([error for error, _ in pairs]), np.array([spread for _, spread in pairs])
    predicted = np.mean(np.diagonal(covariances, axis1=1, axis2=2), axis=0)
    distances = np.einsum("ni,ni->n", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])
    coverage = float(np.mean(distances < chi2.ppf(0.95, errors.shape[1])))
    return _rows(name, _worst(np.sqrt(np.mean(errors**2, axis=0) / predicted)), coverage)


def _rows(name: str, ratio: float, coverage: float) -> list[Figure]:
    return [
        Figure(
            name=f"{name}: scatter over prediction, the worst", value=ratio, unit="ratio", at_least=0.85, at_most=1.15
        ),
        Figure(name=f"{name}: 95 % regions hold the truth", value=100 * coverage, unit="%", at_least=92, at_most=98),
    ]


def _worst(ratios: np.ndarray) -> float:
    """The ratio that is farthest from 1."""
    return float(ratios.flat[np.argmax(np.abs(np.log(ratios)))])


def _camera(rng: np.random.Generator, poses) -> tuple[np.ndarray, np.ndarray]:
    corners = made.corners(rng, poses, 0.1)
    problem = CameraProblem(width_px=1440, height_px=1080, corners=corners, sigma_px=0.1, hold_out=False)
    result = solve_camera(problem)
    return (intrinsics_of(result.camera) - intrinsics_of(made.CAMERA))[_INTRINSICS], result.covariance


def _boards(rng: np.random.Generator, poses, method: laser_plane.Method) -> tuple[np.ndarray, np.ndarray]:
    corners, stripe = made.corners(rng, poses, 0.1), made.stripe(rng, poses, 0.2)
    problem = laser_plane.LaserPlaneProblem(camera=made.CAMERA, corners=corners, stripe=stripe, method=method)
    result = laser_plane.solve(problem)
    return made.plane_offsets(result.plane, made.PLANE), result.covariance


def _lines(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    distances, places = np.linspace(0.065, 0.16, 10), np.linspace(-0.02, 0.02, 6)
    pixels = made.line_crossings(rng, made.CAMERA_P1, made.PLANE_P1, distances, places, 1, 0.2)
    result = vanishing_point.solve(
        vanishing_point.VanishingPointProblem(
            camera=made.CAMERA_P1, pixels=pixels, spacing_m=float(places[1] - places[0]), sigma_px=0.2
        )
    )
    return made.plane_offsets(result.plane, made.PLANE_P1), result.covariance


def _steps(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    targets = made.step_targets(rng, 3, 0.1, 0.3)
    result = dual_step.solve(dual_step.DualStepProblem(camera=made.CAMERA, targets=targets, start=_ROUGH))
    return made.plane_offsets(result.plane, made.PLANE), result.covariance

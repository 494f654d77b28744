"""Random degenerate calibration problems, and whether a solver gave a wrong answer without a word.

An answer is silent and wrong if it is not refused and either accepted although a direction is open, or off from the
truth by more than five of its own predicted standard deviations.
"""

from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib import axxb, hand_eye, pivot, robust_hand_eye
from weldcell.calib.axxb_methods import METHODS
from weldcell.calib.sight_model import perturbation
from weldcell.cell.frames import rigid_from

Outcome = Literal[
    "refused", "doubtful, direction named", "doubtful, within 5 sigma", "accepted, within 5 sigma", "silent"
]

KINDS = ("single axis", "translations", "duplicates", "two poses", "line", "plane", "few")
SOLVERS = ("hand-eye", "robust hand-eye", "pivot", "board", "sphere hand-eye")
_FIVE_SIGMA = 5.0
_ROUNDING = 1e-9  # m and rad
_SPHERE_SIGMAS = (0.5, 2.0, 0.5)  # the height off the light plane is the worst


def outcome(seed: int) -> Outcome:
    """How the problem with this seed ends."""
    rng = np.random.default_rng(seed)
    kind, solver = KINDS[seed % len(KINDS)], SOLVERS[(seed // len(KINDS)) % len(SOLVERS)]
    nearly_rad = rng.choice([0.0, 0.0, 1e-5, 1e-4, 1e-3, 3e-3, 1e-2])
    noise_m = rng.choice([0.0, 1e-5, 1e-4, 5e-4])
    read_rad = rng.choice([0.0, 1e-5, 1e-4])  # errors of the controller's angles
    T_base_flange, centres_camera, mount = _degenerate(kind, rng, nearly_rad)
    reported = _reported(T_base_flange, rng, noise_m / 2, read_rad)
    if solver == "pivot":
        return _pivot(reported, T_base_flange, mount, centres_camera)
    if solver == "board":
        return _board(reported, T_base_flange, mount, centres_camera, rng, noise_m)
    sigma_m = noise_m * np.array(_SPHERE_SIGMAS if solver == "sphere hand-eye" else (1.0, 1.0, 1.0))
    seen = centres_camera + rng.normal(size=centres_camera.shape) * sigma_m
    given = hand_eye.HandEyeProblem(
        T_base_flange=reported,
        centres_camera=seen,
        covariances_camera=np.tile(np.diag(sigma_m**2), (len(seen), 1, 1)) if solver == "sphere hand-eye" else None,
        pose_sigma_m=max(noise_m / 2, 1e-7),
    )
    found = (robust_hand_eye if solver == "robust hand-eye" else hand_eye).solve(given)
    error = perturbation(mount, found.T_flange_camera)
    return _weighed(found.verdict, found.observability, found.reasons, error, found.covariance)


def _degenerate(
    kind: str, rng: np.random.Generator, nearly_rad: float
) -> tuple[RigidTransform, np.ndarray, RigidTransform]:
    """Poses, the target in the camera, and the mount: 10 translations and 10 free poses with something amiss.

    `nearly_rad` is how far the poses stray from being exactly degenerate.
    """
    mount = rigid_from(Rotation.random(rng=rng), rng.normal(0, 0.15, 3))
    start, target = Rotation.random(rng=rng), rng.uniform(-1, 1, 3)
    moves, tilts = rng.uniform(-0.03, 0.03, (20, 3)), rng.uniform(-0.6, 0.6, (20, 3))
    tilts[:10] = 0
    stray = rng.normal(0, nearly_rad, (20, 3)) * (np.arange(20) >= 10)[:, None]
    rows = np.arange(20)
    if kind == "single axis":
        axis = rng.normal(size=3)
        tilts = tilts[:, :1] * axis / np.linalg.norm(axis)
    elif kind == "translations":
        tilts = np.zeros((20, 3))
    elif kind == "duplicates":
        rows = np.sort(rng.choice(rng.choice(20, 2, replace=False), 20))
    elif kind == "two poses":
        rows = rng.choice(20, 2, replace=False)
    elif kind == "line":
        axis = rng.normal(size=3)
        moves[:10] = moves[:10, :1] * axis / np.linalg.norm(axis) + rng.normal(0, 0.03 * nearly_rad, (10, 3))
    elif kind == "plane":  # sound for a point's rotation, and with a single axis of turns
        moves[:10, 2] = 0
        tilts = tilts[:, :1] * np.array([0.0, 0.0, 1.0])
    elif kind == "few":
        rows = rng.choice(20, int(rng.integers(1, 6)), replace=False)
    turned = start * Rotation.from_rotvec(tilts + stray)
    seen_camera = np.array([0.0, 0.0, 0.3]) + moves
    R_base_camera = turned * mount.rotation
    T_base_camera = rigid_from(R_base_camera, target - R_base_camera.apply(seen_camera))
    return (T_base_camera * mount.inv())[rows], seen_camera[rows], mount


def _reported(T: RigidTransform, rng: np.random.Generator, shift_m: float, turn_rad: float) -> RigidTransform:
    """What the controller says, with errors of its own."""
    turns = Rotation.from_rotvec(rng.normal(0, turn_rad, (len(T), 3))) * T.rotation
    return rigid_from(turns, T.translation + rng.normal(0, shift_m, (len(T), 3)))


def _pivot(
    reported: RigidTransform, actual: RigidTransform, mount: RigidTransform, centres_camera: np.ndarray
) -> Outcome:
    """The same turns about a tip at the mount's place."""
    point = np.array([0.9, 0.1, 0.4])
    noise = reported.translation - actual.translation
    T = rigid_from(reported.rotation, point - actual.rotation.apply(mount.translation) + noise)
    found = pivot.solve(pivot.PivotProblem(T_base_flange=T))
    error = found.tip_flange - mount.translation
    return _weighed(found.verdict, found.observability, found.reasons, error, found.covariance[:3, :3])


def _board(
    reported: RigidTransform,
    actual: RigidTransform,
    mount: RigidTransform,
    centres_camera: np.ndarray,
    rng: np.random.Generator,
    noise_m: float,
) -> Outcome:
    """A board at the target, seen with noise, solved by any method."""
    T_base_board = rigid_from(Rotation.random(rng=rng), actual[0].apply(mount.apply(centres_camera[0])))
    exact = (actual * mount).inv() * T_base_board
    turned = Rotation.from_rotvec(rng.normal(0, 3 * noise_m, (len(exact), 3))) * exact.rotation
    seen = rigid_from(turned, exact.translation + rng.normal(0, noise_m, (len(exact), 3)))
    method = [*METHODS, "joint"][int(rng.integers(6))]
    found = axxb.solve(axxb.BoardHandEyeProblem(T_base_flange=reported, T_camera_board=seen, method=method))
    error = perturbation(mount, found.T_flange_camera)
    return _weighed(found.verdict, found.observability, found.reasons, error, found.covariance)


def _weighed(
    verdict: str, directions: tuple[str, ...], reasons: tuple[str, ...], error: np.ndarray, covariance: np.ndarray
) -> Outcome:
    if verdict == "refused":
        return "refused" if reasons else "silent"
    sigma = np.sqrt(np.diag(covariance))
    within = bool(np.all(np.abs(error) <= _FIVE_SIGMA * sigma + _ROUNDING))
    if not within:
        return "silent"
    if verdict == "doubtful":
        return "doubtful, direction named" if directions else "doubtful, within 5 sigma"
    return "accepted, within 5 sigma"

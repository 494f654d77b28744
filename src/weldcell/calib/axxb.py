"""Hand-eye calibration from a board: A X = X B, the rivals of the papers' point methods, and one joint estimate.

A camera that knows its intrinsics sees a fixed board from several poses. The closed forms (see `axxb_methods`) take
motions between poses. The joint estimate minimises how far each picture's board pose T_camera_board misses
(T_base_flange T_flange_camera)^-1 T_base_board, each in its own sigmas: the board pose's covariance from its corners in
pixels, which makes it the same as a bundle adjustment in pixels to first order, and the robot's error for each pose.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.axxb_methods import LARGEST_TURN_RAD, METHODS, SMALLEST_TURN_RAD, Method, motions, park
from weldcell.calib.axxb_model import board_derivatives, board_model, board_moved, board_residuals
from weldcell.calib.consensus import WRONG_SHARE
from weldcell.calib.least_squares import Fit, fit
from weldcell.calib.sight_model import cross_matrix, perturbation, perturbed
from weldcell.calib.turns import weigh_turns
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
    weigh_spare,
)
from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.cell.frames import rigid_from

DOUBTFUL_RMS_M = 3e-3
REFUSED_RMS_M = 20e-3
_WHAT = "hand-eye from a board"
_FEWEST = 3
_LARGEST_MOUNT_M = 5.0
_SOUND_WEIGHT = 0.35  # of a picture that misses by 8 sigmas
_STEP = 1e-6  # rad and m, for differences of the closed forms


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardHandEyeProblem:
    """Pictures of one fixed board."""

    T_base_flange: RigidTransform
    """Flange in the base for each picture, as the controller reported it (n transforms)."""
    T_camera_board: RigidTransform
    """Board in the camera for each picture (n transforms), e.g. from `camera.pose_board`."""
    method: Method | Literal["joint"] = "joint"
    covariances_camera: Float[np.ndarray, "n 6 6"] | None = None
    """Of the board poses: turn (rad), then shift (m), camera axes. None: the robot's error alone weighs."""
    pose_sigma_m: float = 1e-4
    """The robot's error for a single pose, each axis."""
    pose_sigma_rad: float = 2e-4
    """The same of its orientation: 0.1 mm at half a metre."""

    def __post_init__(self) -> None:
        count = 1 if self.T_base_flange.single else len(self.T_base_flange)
        if self.T_base_flange.single or self.T_camera_board.single or len(self.T_camera_board) != count:
            raise BadInput(f"{_WHAT}: {count} flange poses, expected as many board poses, a stack of each")
        if not all(np.isfinite(T.as_matrix()).all() for T in (self.T_base_flange, self.T_camera_board)):
            raise BadInput(f"{_WHAT}: expected finite poses, found NaN or infinity")
        if self.method != "joint" and self.method not in METHODS:
            raise BadInput(f"{_WHAT}: method {self.method!r}, expected joint, {', '.join(METHODS)}")
        covariances = self.covariances_camera
        if covariances is not None and not (
            np.shape(covariances) == (count, 6, 6) and np.all(np.isfinite(covariances))
        ):
            raise BadInput(f"{_WHAT}: expected finite covariances of shape ({count}, 6, 6)")
        if not (0 < self.pose_sigma_m < np.inf and 0 < self.pose_sigma_rad < np.inf):
            raise BadInput(f"{_WHAT}: expected pose_sigma_m and pose_sigma_rad above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardHandEyeResult(Judged):
    """The camera on the flange.

    In the condition number rotations count by what they move at the mean board distance.
    """

    T_flange_camera: RigidTransform
    T_base_board: RigidTransform
    sound: Bool[np.ndarray, "n"]
    """The pictures that the joint estimate rests on; the others are outliers (a closed form takes them all)."""
    covariance: Float[np.ndarray, "6 6"]
    """Rotation vector (rad, camera axes), then translation (m, flange axes); infinite if a direction is open."""
    residuals_camera: Float[np.ndarray, "n 6"]
    """Each board pose against the expected one: turn (rad), then shift (m), camera axes."""
    rms_m: float
    """Root mean square length of the residuals' shifts."""
    converged: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class _Joint:
    """The joint estimate."""

    T_flange_camera: RigidTransform
    T_base_board: RigidTransform
    sound: Bool[np.ndarray, "n"]
    found: Fit
    """Of the sound pictures."""


def solve(problem: BoardHandEyeProblem) -> BoardHandEyeResult:
    """The camera on the flange by the problem's method."""
    given = motions(problem.T_base_flange, problem.T_camera_board)
    still = weigh_turns(problem.T_base_flange.rotation, _WHAT)
    if len(problem.T_base_flange) < _FEWEST or not len(given) or still:
        return _refused(problem, still or [_too_few(problem)])
    try:
        closed = (park if problem.method == "joint" else METHODS[problem.method])(given)
    except (BadGeometry, np.linalg.LinAlgError) as error:
        return _refused(problem, [Finding(verdict="refused", reason=f"{_WHAT}: {error}")])
    distance_m = float(np.linalg.norm(closed.translation))
    if distance_m > _LARGEST_MOUNT_M:
        reason = f"{_WHAT}: the camera lies {distance_m:.3g} m from the flange, expected below {_LARGEST_MOUNT_M:g} m"
        return _refused(problem, [Finding(verdict="refused", reason=f"{reason} (mixed units or inverted transforms?)")])
    return _judged(problem, closed, _fit(problem, closed))


def _fit(problem: BoardHandEyeProblem, T_flange_camera: RigidTransform) -> _Joint:
    """The joint estimate near a closed form: robust first, then plain least squares of the pictures that agree."""
    T_base_board = _mean_board(problem, T_flange_camera)
    sound = np.ones(len(problem.T_base_flange), dtype=bool)
    for robust in (True, False):
        kept = _only(problem, sound)
        whitening = _whitening(kept, T_flange_camera)
        found = fit(
            board_model(kept.T_base_flange, kept.T_camera_board, T_flange_camera, T_base_board, whitening),
            np.zeros(12),
            robust=robust,
        )
        T_flange_camera = perturbed(T_flange_camera, found.parameters[:6])
        T_base_board = board_moved(T_base_board, found.parameters)
        if robust and np.sum(found.weights > _SOUND_WEIGHT) >= _FEWEST:
            sound = found.weights > _SOUND_WEIGHT
    return _Joint(T_flange_camera=T_flange_camera, T_base_board=T_base_board, sound=sound, found=found)


def _judged(problem: BoardHandEyeProblem, closed: RigidTransform, joint: _Joint) -> BoardHandEyeResult:
    seen = _observe(_only(problem, joint.sound), joint.T_flange_camera, joint.T_base_board)
    found, covariance = joint.found, joint.found.covariance[:6, :6]
    findings = weigh_condition(seen, _WHAT) + weigh_turns(problem.T_base_flange.rotation[joint.sound], _WHAT)
    findings += weigh_convergence(found.converged, found.message)
    T_flange_camera, T_base_board, counted = joint.T_flange_camera, joint.T_base_board, joint.sound
    if problem.method != "joint":
        T_flange_camera, T_base_board = closed, _mean_board(problem, closed)
        covariance = _carried(problem, found, closed) if np.all(np.isfinite(covariance)) else covariance
        counted = np.ones_like(counted)
    residuals = board_residuals(problem.T_base_flange, problem.T_camera_board, T_flange_camera, T_base_board)
    shifts_m = np.linalg.norm(residuals[:, 3:], axis=1)
    rms_m = float(np.sqrt(np.mean(shifts_m[counted] ** 2)))
    findings += weigh_residual(rms_m, _WHAT, doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += _weigh_pictures(joint.sound, shifts_m) + weigh_spare(6 * int(np.sum(joint.sound)), 12)
    verdict, reasons = judge(findings)
    return BoardHandEyeResult(
        T_flange_camera=T_flange_camera,
        T_base_board=T_base_board,
        sound=joint.sound,
        covariance=covariance,
        residuals_camera=residuals,
        rms_m=rms_m,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        converged=found.converged,
        verdict=verdict,
        reasons=reasons,
    )


def _only(problem: BoardHandEyeProblem, sound: Bool[np.ndarray, "n"]) -> BoardHandEyeProblem:
    covariances = problem.covariances_camera
    return replace(
        problem,
        T_base_flange=problem.T_base_flange[sound],
        T_camera_board=problem.T_camera_board[sound],
        covariances_camera=None if covariances is None else covariances[sound],
    )


def _weigh_pictures(sound: Bool[np.ndarray, "n"], shifts_m: Float[np.ndarray, "n"]) -> list[Finding]:
    """Pictures that miss by far more than the others: a doubt each, a refusal where there are too many."""
    wrong = np.flatnonzero(~sound)
    if len(wrong) > WRONG_SHARE * len(sound):
        reason = f"{len(wrong)} of {len(sound)} pictures disagree with the rest, expected at most {WRONG_SHARE:.0%}"
        return [Finding(verdict="refused", reason=reason)]
    return [
        Finding(verdict="doubtful", reason=f"picture {k} (counted from 0) misses by {shifts_m[k] * 1e3:.3g} mm")
        for k in wrong
    ]


def _too_few(problem: BoardHandEyeProblem) -> Finding:
    reason = (
        f"{_WHAT}: {len(problem.T_base_flange)} poses, expected at least {_FEWEST}, of which some pairs turn by "
        f"{np.rad2deg(SMALLEST_TURN_RAD):.1f} to {np.rad2deg(LARGEST_TURN_RAD):.0f} degrees"
    )
    return Finding(verdict="refused", reason=reason)


def _refused(problem: BoardHandEyeProblem, findings: list[Finding]) -> BoardHandEyeResult:
    """No answer, and why."""
    count = len(problem.T_base_flange)
    given = motions(problem.T_base_flange, problem.T_camera_board)
    turned = park(given).rotation if len(given) else Rotation.identity()  # right but for what the motions leave open
    T_turned = rigid_from(turned, np.zeros(3))
    seen = _observe(problem, T_turned, problem.T_base_flange[0] * T_turned * problem.T_camera_board[0])
    verdict, reasons = judge([*findings, *weigh_condition(seen, _WHAT)])
    return BoardHandEyeResult(
        T_flange_camera=RigidTransform.identity(),
        T_base_board=RigidTransform.identity(),
        sound=np.ones(count, dtype=bool),
        covariance=np.full((6, 6), np.inf),
        residuals_camera=np.full((count, 6), np.nan),
        rms_m=np.nan,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        converged=False,
        verdict=verdict,
        reasons=reasons,
    )


def _mean_board(problem: BoardHandEyeProblem, T_flange_camera: RigidTransform) -> RigidTransform:
    """The board in the base as all pictures see it, on average."""
    seen = problem.T_base_flange * T_flange_camera * problem.T_camera_board
    return rigid_from(seen.rotation.mean(), seen.translation.mean(axis=0))


def _whitening(problem: BoardHandEyeProblem, T_flange_camera: RigidTransform) -> Float[np.ndarray, "n 6 6"]:
    """For each picture the matrix that turns its residual into sigmas: the board pose's error, and the robot's.

    The robot's turn e (about the flange's origin, with its shift d) shows in the camera as a turn of the board by -e
    and a shift of it by (board - flange) x e - d.
    """
    arms = problem.T_camera_board.translation - T_flange_camera.inv().translation
    spread = np.zeros((len(arms), 6, 6))
    spread[:, :3, :3], spread[:, 3:, 3:] = -np.eye(3), -np.eye(3)
    spread[:, 3:, :3] = cross_matrix(arms)
    robot = np.diag(np.repeat([problem.pose_sigma_rad**2, problem.pose_sigma_m**2], 3))
    covariances = spread @ robot @ spread.swapaxes(1, 2)
    if problem.covariances_camera is not None:
        covariances = covariances + problem.covariances_camera
    return np.linalg.inv(np.linalg.cholesky(covariances))


def _observe(
    problem: BoardHandEyeProblem, T_flange_camera: RigidTransform, T_base_board: RigidTransform
) -> Observability:
    """What the flange's motions can tell; those of the camera would let its noise pass for a direction."""
    lever_m = float(np.sqrt(np.mean(np.sum(problem.T_camera_board.translation**2, axis=1))))
    R_camera_base = (problem.T_base_flange * T_flange_camera).rotation.inv().as_matrix()
    places = (problem.T_base_flange * T_flange_camera).inv().apply(T_base_board.translation)
    jacobian = board_derivatives(
        R_camera_base, T_flange_camera.rotation.as_matrix(), T_base_board.rotation.as_matrix(), places
    )
    jacobian[:, :3] *= lever_m
    return observe(
        jacobian.reshape(-1, 12),
        [
            Block(name="rotation about", frame="camera", unit_m=lever_m),
            Block(name="translation along", frame="flange"),
            Block(name="the board's rotation about", frame="board", unit_m=lever_m),
            Block(name="the board along", frame="base"),
        ],
    )


def _carried(problem: BoardHandEyeProblem, found: Fit, closed: RigidTransform) -> Float[np.ndarray, "6 6"]:
    """Covariance of a closed form: each board pose's error carried through it by differences."""
    method, board = METHODS[problem.method], problem.T_camera_board  # type: ignore[index]  # not called for `joint`
    errors = np.linalg.inv(_whitening(problem, closed))
    gain = np.zeros((6, len(board), 6))
    for picture in range(len(board)):
        for axis in range(6):
            step = np.zeros((len(board), 6))
            step[picture, axis] = _STEP
            turned = Rotation.from_rotvec(step[:, :3]) * board.rotation
            moved = rigid_from(turned, board.translation + step[:, 3:])
            gain[:, picture, axis] = perturbation(closed, method(motions(problem.T_base_flange, moved))) / _STEP
    whole = (gain.transpose(1, 0, 2) @ errors).transpose(1, 0, 2).reshape(6, -1)
    return found.inflation * whole @ whole.T

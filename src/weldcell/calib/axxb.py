"""Hand-eye calibration from a board: A X = X B, the rivals of the papers' point methods, and one joint estimate.

A camera that knows its intrinsics sees a fixed board from several poses. The closed forms (see `axxb_methods`) take
motions between poses. The joint estimate minimises how far each picture's board pose T_camera_board misses
(T_base_flange T_flange_camera)^-1 T_base_board, each in its own sigmas: the board pose's covariance from its corners in
pixels, which makes it the same as a bundle adjustment in pixels to first order, and the robot's error for each pose.

Parameters: the six of `sight_model` for the camera, then the board's turn (board axes, rad) and shift (base axes, m).
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.axxb_methods import LARGEST_TURN_RAD, METHODS, SMALLEST_TURN_RAD, Method, motions, park
from weldcell.calib.least_squares import Fit, Model, fit
from weldcell.calib.sight_model import ROTATION, TRANSLATION, cross_matrix, perturbation, perturbed, right_jacobian
from weldcell.calib.turns import weigh_turns
from weldcell.calib.verdict import (
    Block,
    Finding,
    Observability,
    Verdict,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
    weigh_outliers,
    weigh_residual,
    weigh_spare,
)
from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.cell.frames import rigid_from

DOUBTFUL_RMS_M = 3e-3
REFUSED_RMS_M = 20e-3
_FEWEST = 3
_BOARD_TURN, _BOARD_SHIFT = slice(6, 9), slice(9, 12)
_ROUNDS = 2  # the second starts its perturbation anew from zero, where the covariance is defined
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
            raise BadInput(f"hand-eye from a board: {count} flange poses, expected as many board poses, a stack of each")
        if not all(np.isfinite(T.as_matrix()).all() for T in (self.T_base_flange, self.T_camera_board)):
            raise BadInput("hand-eye from a board: expected finite poses, found NaN or infinity")
        if self.method != "joint" and self.method not in METHODS:
            raise BadInput(f"hand-eye from a board: method {self.method!r}, expected joint, {', '.join(METHODS)}")
        covariances = self.covariances_camera
        if covariances is not None and not (
            np.shape(covariances) == (count, 6, 6) and np.all(np.isfinite(covariances))
        ):
            raise BadInput(f"hand-eye from a board: expected finite covariances of shape ({count}, 6, 6)")
        if not (0 < self.pose_sigma_m < np.inf and 0 < self.pose_sigma_rad < np.inf):
            raise BadInput("hand-eye from a board: expected pose_sigma_m and pose_sigma_rad above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class BoardHandEyeResult:
    """The camera on the flange, and what speaks for and against it. Where refused, it is not an answer."""

    T_flange_camera: RigidTransform
    T_base_board: RigidTransform
    covariance: Float[np.ndarray, "6 6"]
    """Rotation vector (rad, camera axes), then translation (m, flange axes); infinite if a direction is open."""
    residuals_camera: Float[np.ndarray, "n 6"]
    """Each board pose against the expected one: turn (rad), then shift (m), camera axes."""
    rms_m: float
    """Root mean square length of the residuals' shifts."""
    condition_number: float
    """Of the scaled Jacobian (rotations count by what they move at the mean board distance)."""
    observability: tuple[str, ...]
    """Directions that the poses hardly determine, in words; empty if none."""
    converged: bool
    verdict: Verdict
    reasons: tuple[str, ...]


def solve(problem: BoardHandEyeProblem) -> BoardHandEyeResult:
    """The camera on the flange by the problem's method."""
    given = motions(problem.T_base_flange, problem.T_camera_board)
    if len(problem.T_base_flange) < _FEWEST or not len(given):
        return _refused(problem)
    try:
        closed = (park if problem.method == "joint" else METHODS[problem.method])(given)
    except (BadGeometry, np.linalg.LinAlgError, ValueError):
        return _refused(problem)
    found = _fit(problem, closed)
    return _judged(problem, closed, *found)


def _fit(problem: BoardHandEyeProblem, T_flange_camera: RigidTransform) -> tuple[RigidTransform, RigidTransform, Fit]:
    """The joint estimate near a closed form: camera, board, and the fit that gave them."""
    T_base_board = _mean_board(problem, T_flange_camera)
    for _ in range(_ROUNDS):
        whitening = _whitening(problem, T_flange_camera)
        found = fit(_model(problem, T_flange_camera, T_base_board, whitening), np.zeros(12))
        T_flange_camera = perturbed(T_flange_camera, found.parameters[:6])
        T_base_board = _board_moved(T_base_board, found.parameters)
    return T_flange_camera, T_base_board, found


def _judged(
    problem: BoardHandEyeProblem, closed: RigidTransform, T_joint: RigidTransform, T_board: RigidTransform, found: Fit
) -> BoardHandEyeResult:
    seen = _observe(problem, T_joint, T_board)
    findings = weigh_condition(seen, "hand-eye from a board") + weigh_convergence(found.converged, found.message)
    findings += weigh_turns(problem.T_base_flange.rotation, "hand-eye from a board")
    covariance = found.covariance[:6, :6]
    T_flange_camera, T_base_board = T_joint, T_board
    if problem.method != "joint":
        T_flange_camera, T_base_board = closed, _mean_board(problem, closed)
        covariance = _carried(problem, found, closed) if np.all(np.isfinite(covariance)) else covariance
    residuals = _residuals(problem, T_flange_camera, T_base_board)
    shifts_m = np.linalg.norm(residuals[:, 3:], axis=1)
    rms_m = float(np.sqrt(np.mean(shifts_m**2)))
    findings += weigh_residual(rms_m, "hand-eye from a board", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_outliers(shifts_m, "picture") + weigh_spare(residuals.size, 12)
    verdict, reasons = judge(findings)
    return BoardHandEyeResult(
        T_flange_camera=T_flange_camera,
        T_base_board=T_base_board,
        covariance=covariance,
        residuals_camera=residuals,
        rms_m=rms_m,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        converged=found.converged,
        verdict=verdict,
        reasons=reasons,
    )


def _refused(problem: BoardHandEyeProblem) -> BoardHandEyeResult:
    """No answer: there is no motion to take one from."""
    count = len(problem.T_base_flange)
    seen = _observe(problem, RigidTransform.identity(), problem.T_base_flange[0] * problem.T_camera_board[0])
    reason = (
        f"hand-eye from a board: {count} poses, expected at least {_FEWEST}, of which some pairs turn by "
        f"{np.rad2deg(SMALLEST_TURN_RAD):.1f} to {np.rad2deg(LARGEST_TURN_RAD):.0f} degrees"
    )
    verdict, reasons = judge([Finding(verdict="refused", reason=reason), *weigh_condition(seen, "poses")])
    return BoardHandEyeResult(
        T_flange_camera=RigidTransform.identity(),
        T_base_board=RigidTransform.identity(),
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


def _residuals(
    problem: BoardHandEyeProblem, T_flange_camera: RigidTransform, T_base_board: RigidTransform
) -> Float[np.ndarray, "n 6"]:
    expected = (problem.T_base_flange * T_flange_camera).inv() * T_base_board
    turn = (problem.T_camera_board.rotation * expected.rotation.inv()).as_rotvec()
    return np.concatenate([turn, problem.T_camera_board.translation - expected.translation], axis=1)


def _model(
    problem: BoardHandEyeProblem, T_start: RigidTransform, T_board: RigidTransform, whitening: Float[np.ndarray, "n 6 6"]
) -> Model:
    """Whitened residuals and their derivatives by the twelve parameters about a start (plain arrays, for speed)."""
    R_flange_base, flange_base = problem.T_base_flange.rotation.inv().as_matrix(), problem.T_base_flange.translation
    R_seen, seen_camera = problem.T_camera_board.rotation.as_matrix(), problem.T_camera_board.translation
    R_start, start_flange = T_start.rotation.as_matrix(), T_start.translation
    R_board, board_base = T_board.rotation.as_matrix(), T_board.translation

    def model(parameters: Float[np.ndarray, "12"]) -> tuple[np.ndarray, np.ndarray]:
        turns = Rotation.from_rotvec(parameters.reshape(4, 3)[::2]).as_matrix()
        R_camera_base = (R_start @ turns[0]).T @ R_flange_base
        R_base_board = R_board @ turns[1]
        arms_flange = np.einsum("nij,nj->ni", R_flange_base, board_base + parameters[_BOARD_SHIFT] - flange_base)
        places = (arms_flange - start_flange - parameters[TRANSLATION]) @ R_start @ turns[0]
        missed = R_seen @ (R_camera_base @ R_base_board).swapaxes(1, 2)
        residuals = np.concatenate([Rotation.from_matrix(missed).as_rotvec(), seen_camera - places], axis=1)
        jacobian = _derivatives(R_camera_base, R_start @ turns[0], R_base_board, places)
        jacobian[:, :3] = _of_turned_logarithm(residuals[:, :3]) @ jacobian[:, :3]
        jacobian[..., ROTATION] = jacobian[..., ROTATION] @ right_jacobian(parameters[ROTATION])
        jacobian[..., _BOARD_TURN] = jacobian[..., _BOARD_TURN] @ right_jacobian(parameters[_BOARD_TURN])
        return np.einsum("nij,nj->ni", whitening, residuals), whitening @ jacobian

    return model


def _derivatives(
    R_camera_base: Float[np.ndarray, "n 3 3"],
    R_flange_camera: Float[np.ndarray, "3 3"],
    R_base_board: Float[np.ndarray, "3 3"],
    places_camera: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 6 12"]:
    """Of the residuals, where their turns are small, with the board at `places_camera`."""
    jacobian = np.zeros((len(R_camera_base), 6, 12))
    jacobian[:, :3, ROTATION] = np.eye(3)
    jacobian[:, :3, _BOARD_TURN] = -R_camera_base @ R_base_board
    jacobian[:, 3:, ROTATION] = -cross_matrix(places_camera)
    jacobian[:, 3:, TRANSLATION] = R_flange_camera.T
    jacobian[:, 3:, _BOARD_SHIFT] = -R_camera_base
    return jacobian


def _of_turned_logarithm(turns: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """d log(exp(v) exp(w)) / dw at 0, to third order in v (Sola, Deray, Atchuthan 2018, eq. 144)."""
    cross = cross_matrix(turns)
    return np.asarray(np.eye(3) + cross / 2 + cross @ cross / 12)


def _board_moved(T_base_board: RigidTransform, parameters: Float[np.ndarray, "12"]) -> RigidTransform:
    rotation = T_base_board.rotation * Rotation.from_rotvec(parameters[_BOARD_TURN])
    return rigid_from(rotation, T_base_board.translation + parameters[_BOARD_SHIFT])


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
    jacobian = _derivatives(
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



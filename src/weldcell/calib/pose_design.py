"""Which poses to measure next for a hand-eye calibration, and how many are enough.

Candidates come from outside: flange poses within reach and free of collisions, and where the target would be seen from
each. They are ordered greedily (see `pose_choice.choose`), so that each next one makes the smallest singular value of
the scaled Jacobian as large as possible. For each number of poses the covariance of the joint estimate
(`joint_hand_eye`) is predicted, J'WJ inverted with the target eliminated, before anything is measured.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.calib.hand_eye import check_sights
from weldcell.calib.pose_choice import choose, sight_candidates
from weldcell.calib.sight_model import ROTATION, TRANSLATION, lever_m, sight_covariances_base, sight_jacobian
from weldcell.cell.errors import BadInput

_SINGULAR = 1e-12  # relative eigenvalue below which a direction is open


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseDesignProblem:
    """Poses that could be taken, and the accuracy that is wanted."""

    T_base_flange: RigidTransform
    """Candidate flange poses (n transforms), all of them within reach, view and free of collisions."""
    centres_camera: Float[np.ndarray, "n 3"]
    """Where the target would be seen from each (m)."""
    T_flange_camera: RigidTransform
    """The mount as far as it is known."""
    covariances_camera: Float[np.ndarray, "n 3 3"] | None = None
    """Expected of the sights (m^2); None: the robot's error alone."""
    pose_sigma_m: float = 1e-4
    """The robot's error for a single pose, each axis."""
    most: int = 30
    """Number of poses to plan at most."""
    wanted_turn_rad: float | None = None
    """Largest standard deviation of the mount's rotation about any axis; None: any."""
    wanted_shift_m: float | None = None
    """The same of its translation along any direction."""
    measured: Int[np.ndarray, "m"] | None = None
    """Candidates that were measured already, by index; they count but are not chosen again."""

    def __post_init__(self) -> None:
        check_sights("pose design", self.T_base_flange, self.centres_camera, self.covariances_camera, self.pose_sigma_m)
        for name in ("wanted_turn_rad", "wanted_shift_m"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise BadInput(f"pose design: {name} is {value}, expected above 0")
        if self.most < 1:
            raise BadInput(f"pose design: most is {self.most}, expected 1 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseDesign:
    """The poses in the order to take them."""

    order: Int[np.ndarray, "k"]
    """Indices of candidates."""
    turn_sigma_rad: Float[np.ndarray, "k"]
    """Predicted largest standard deviation of the mount's rotation after each pose; infinite while one is open."""
    shift_sigma_m: Float[np.ndarray, "k"]
    """The same of its translation."""
    covariance: Float[np.ndarray, "6 6"]
    """Predicted with all of them: rotation vector (rad, camera axes), translation (m, flange axes)."""
    enough: int | None
    """How many of the order meet the wanted accuracy; None where not even all do."""
    reason: str
    """What falls short, in words; empty if nothing does."""


def design(problem: PoseDesignProblem) -> PoseDesign:
    """The poses to take next, with the accuracy to expect after each."""
    measured = np.zeros(0, dtype=int) if problem.measured is None else problem.measured
    left = np.setdiff1d(np.arange(len(problem.T_base_flange)), measured)
    candidates = sight_candidates(
        problem.T_base_flange, problem.T_flange_camera, problem.centres_camera, lever_m(problem.centres_camera)
    )
    order = left[choose(candidates[left], min(problem.most, len(left)), already=candidates[measured])]
    informations = _informations(problem)
    running = np.cumsum(informations[order], axis=0) + informations[measured].sum(axis=0)
    covariances = np.array([_covariance(information) for information in running])
    turn_rad, shift_m = _largest(covariances[:, ROTATION, ROTATION]), _largest(covariances[:, TRANSLATION, TRANSLATION])
    enough = _first(problem, turn_rad, shift_m)
    return PoseDesign(
        order=order,
        turn_sigma_rad=turn_rad,
        shift_sigma_m=shift_m,
        covariance=covariances[-1],
        enough=enough,
        reason="" if enough is not None else _shortfall(problem, float(turn_rad[-1]), float(shift_m[-1]), len(order)),
    )


def predicted_covariance(problem: PoseDesignProblem, chosen: Int[np.ndarray, "k"]) -> Float[np.ndarray, "6 6"]:
    """Of the mount, from some of the candidates; infinite where a direction is open."""
    return _covariance(_informations(problem)[chosen].sum(axis=0))


def _informations(problem: PoseDesignProblem) -> Float[np.ndarray, "n 9 9"]:
    """What each sight tells of mount and target."""
    jacobians = sight_jacobian(problem.T_base_flange, problem.T_flange_camera, problem.centres_camera)
    errors = sight_covariances_base(
        problem.T_base_flange, problem.T_flange_camera, problem.covariances_camera, problem.pose_sigma_m
    )
    return jacobians.swapaxes(1, 2) @ np.linalg.inv(errors) @ jacobians


def _covariance(information: Float[np.ndarray, "9 9"]) -> Float[np.ndarray, "6 6"]:
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    values = np.linalg.eigvalsh(scaled)
    if not values[0] > _SINGULAR * values[-1]:
        return np.full((6, 6), np.inf)
    return (np.linalg.inv(scaled) / np.outer(scale, scale))[:6, :6]


def _largest(covariances: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k"]:
    """Standard deviation along each covariance's worst direction."""
    open_ones = ~np.isfinite(covariances).all(axis=(1, 2))
    known = np.where(open_ones[:, None, None], np.eye(3), covariances)
    return np.where(open_ones, np.inf, np.sqrt(np.linalg.eigvalsh(known)[:, -1]))


def _first(problem: PoseDesignProblem, turn_rad: Float[np.ndarray, "k"], shift_m: Float[np.ndarray, "k"]) -> int | None:
    met = np.isfinite(turn_rad)
    if problem.wanted_turn_rad is not None:
        met &= turn_rad <= problem.wanted_turn_rad
    if problem.wanted_shift_m is not None:
        met &= shift_m <= problem.wanted_shift_m
    return int(np.argmax(met)) + 1 if met.any() else None


def _shortfall(problem: PoseDesignProblem, turn_rad: float, shift_m: float, count: int) -> str:
    if not np.isfinite(turn_rad):
        return f"{count} poses leave a direction of the mount open, expected turns about two axes and other places"
    parts = []
    if problem.wanted_turn_rad is not None and turn_rad > problem.wanted_turn_rad:
        parts.append(f"{np.rad2deg(turn_rad):.3g} deg, wanted {np.rad2deg(problem.wanted_turn_rad):.3g}")
    if problem.wanted_shift_m is not None and shift_m > problem.wanted_shift_m:
        parts.append(f"{shift_m * 1e3:.3g} mm, wanted {problem.wanted_shift_m * 1e3:.3g}")
    return f"{count} poses reach {' and '.join(parts)}"

"""Hand-eye calibration from one fixed target seen in many poses: papers P1 and P2, in two closed-form steps.

1. Poses that keep the flange's orientation give the rotation: R dM = b, with dM the target's moves in the
   camera and b the flange's moves, turned round, in flange axes (P1 Eq. 12). Moves are taken from the
   group's mean: least squares over all pairs, and no pose is preferred. With sum dM b' = U S V' the answer is
   R = V diag(1, 1, det(V U')) U' (Eq. 13 leaves the determinant out; a point target on a laser line lies in
   the light plane, the sum then has rank 2, and without it the answer may be a reflection).
2. All poses give the translation: R_bf t - M_b = -(R_bf R M_c + t_bf), linear in t and the target M_b.
   Solved for both at once. It is the same as least squares over all pairs of poses (P1 Eq. 14, 15), where
   M_b drops out: the sum of |e_i - e_j|^2 over all pairs is n times that of |e_i - mean e|^2, and the best
   M_b is what makes the mean residual zero.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.sight_model import (
    ROTATION,
    TARGET,
    lever_m,
    sight_blocks,
    sight_covariances_base,
    sight_jacobian,
    targets_base,
)
from weldcell.calib.turns import weigh_turns
from weldcell.calib.verdict import (
    Finding,
    Judged,
    Observability,
    judge,
    observe,
    weigh_condition,
    weigh_outliers,
    weigh_residual,
    weigh_spare,
)
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from

DOUBTFUL_RMS_M = 3e-3  # a robot that is this far off wants repair before calibration
REFUSED_RMS_M = 20e-3  # no robot is: inverted transforms, mixed units, another target
_SAME_ORIENTATION_RAD = np.deg2rad(0.05)  # moves a target 0.4 m from the flange by 0.35 mm
_TURNED_RAD = np.deg2rad(1.0)
_LENGTH_RATIO = 1.1  # between the target's moves and the flange's
_MIRROR_SHARE = 0.1  # third singular value over the second: below, the moves lie in a plane
_UNITS = {1e3: "mm and m", 1e2: "cm and m", 25.4: "inches and mm"}


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEyeProblem:
    """Sights of one fixed target."""

    T_base_flange: RigidTransform
    """Flange in the base for each sight, as the controller reported it (n transforms)."""
    centres_camera: Float[np.ndarray, "n 3"]
    """The target in the camera for each sight (m)."""
    translations: Bool[np.ndarray, "n"] | None = None
    """Which poses keep one orientation; None: the largest group that does (within 0.05 degrees)."""
    covariances_camera: Float[np.ndarray, "n 3 3"] | None = None
    """Of the centres (m^2); they go into the covariance, not into the estimate. None: from the residuals."""
    pose_sigma_m: float = 1e-4
    """The robot's error for a single pose, each axis; used where `covariances_camera` is given."""

    def __post_init__(self) -> None:
        check_sights("hand-eye", self.T_base_flange, self.centres_camera, self.covariances_camera, self.pose_sigma_m)
        if self.translations is not None and not (
            np.shape(self.translations) == (len(self.centres_camera),) and np.any(self.translations)
        ):
            raise BadInput(f"hand-eye: translations must mark at least one of {len(self.centres_camera)} poses")

    @cached_property
    def group(self) -> Bool[np.ndarray, "n"]:
        """The poses that keep one orientation, as given or as found."""
        if self.translations is not None:
            return np.asarray(self.translations, dtype=bool)
        return same_orientation(self.T_base_flange.rotation)


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEyeResult(Judged):
    """The camera on the flange."""

    T_flange_camera: RigidTransform
    target_base: Float[np.ndarray, "3"]
    """The fixed target (m)."""
    covariance: Float[np.ndarray, "6 6"]
    """Rotation vector (rad, camera axes), then translation (m, flange axes); infinite if a direction is open."""
    target_covariance_base: Float[np.ndarray, "3 3"]
    """Of the target (m^2)."""
    residuals_base: Float[np.ndarray, "n 3"]
    """Where each sight puts the target, less `target_base` (m)."""
    residual_m: Float[np.ndarray, "n"]
    """Length of each residual."""
    rms_m: float
    """Root mean square length of the residuals."""
    rotation_condition: float
    """Scaled condition number of the first step (rotations count by what they move at the mean sight distance)."""
    translation_condition: float
    """Condition number of the second step; `condition_number` is the larger of the two."""
    converged: bool
    """Both steps are closed forms: false only where they have no unique solution."""


def solve(problem: HandEyeProblem) -> HandEyeResult:
    """The camera on the flange by the two steps."""
    R_flange_camera, findings = _solve_rotation(problem)
    T_flange_camera, target_base = _solve_translation(problem, R_flange_camera)
    residuals_base = targets_base(problem.T_base_flange, T_flange_camera, problem.centres_camera) - target_base
    residual_m = np.linalg.norm(residuals_base, axis=1)
    rms_m = float(np.sqrt(np.mean(residual_m**2)))
    rotation_seen, translation_seen = observe_steps(problem, T_flange_camera)
    findings += weigh_condition(rotation_seen, "rotation") + weigh_condition(translation_seen, "translation")
    findings += weigh_turns(problem.T_base_flange.rotation, "translation")
    findings += weigh_residual(rms_m, "hand-eye", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_outliers(residual_m, "sight") + weigh_spare(3 * len(residual_m), 9)
    covariance = _covariance(problem, T_flange_camera, residuals_base)
    verdict, reasons = judge(findings)
    return HandEyeResult(
        T_flange_camera=T_flange_camera,
        target_base=target_base,
        covariance=covariance[:6, :6],
        target_covariance_base=covariance[6:, 6:],
        residuals_base=residuals_base,
        residual_m=residual_m,
        rms_m=rms_m,
        rotation_condition=rotation_seen.condition_number,
        translation_condition=translation_seen.condition_number,
        condition_number=max(rotation_seen.condition_number, translation_seen.condition_number),
        observability=rotation_seen.weak_directions + translation_seen.weak_directions,
        converged=rotation_seen.rank == translation_seen.rank == 6,
        verdict=verdict,
        reasons=reasons,
    )


def same_orientation(R_base_flange: Rotation) -> Bool[np.ndarray, "n"]:
    """The largest set of poses within 0.05 degrees of one of them; the first such set if several are largest."""
    quaternions = R_base_flange.as_quat().reshape(-1, 4)
    half_chord = np.minimum(  # of q and -q the nearer; a chord keeps small angles exact, an arc cosine does not
        np.linalg.norm(quaternions[:, None] - quaternions, axis=-1),
        np.linalg.norm(quaternions[:, None] + quaternions, axis=-1),
    )
    near = 4 * np.arcsin(np.minimum(half_chord / 2, 1)) < _SAME_ORIENTATION_RAD
    return near[np.argmax(near.sum(axis=1))]


def rotation_between(
    moves_camera: Float[np.ndarray, "n 3"], moves_flange: Float[np.ndarray, "n 3"]
) -> tuple[Rotation, Float[np.ndarray, "3"]]:
    """The rotation R nearest to R moves_camera = moves_flange, and the singular values with the sign of det.

    Never a reflection; a negative third value says that a reflection would fit better (P1 Eq. 13, mended).
    """
    U, values, Vt = np.linalg.svd(moves_camera.T @ moves_flange)
    sign = np.linalg.det(U) * np.linalg.det(Vt)
    rotation = Rotation.from_matrix(Vt.T @ np.diag([1, 1, sign]) @ U.T)
    return rotation, values * [1, 1, np.sign(sign)]


def check_sights(
    what: str,
    T_base_flange: RigidTransform,
    centres_camera: Float[np.ndarray, "n 3"],
    covariances_camera: Float[np.ndarray, "n 3 3"] | None,
    pose_sigma_m: float,
) -> None:
    """Raises BadInput unless poses, centres and covariances are finite and belong together."""
    if T_base_flange.single or np.shape(centres_camera) != (len(T_base_flange), 3):
        poses = 1 if T_base_flange.single else len(T_base_flange)
        raise BadInput(f"{what}: {poses} poses and centres of shape {np.shape(centres_camera)}, expected n and (n, 3)")
    if not (np.isfinite(centres_camera).all() and np.isfinite(T_base_flange.as_matrix()).all()):
        raise BadInput(f"{what}: expected finite poses and centres, found NaN or infinity")
    if covariances_camera is not None and np.shape(covariances_camera) != (len(centres_camera), 3, 3):
        raise BadInput(f"{what}: covariances of shape {np.shape(covariances_camera)}, expected (n, 3, 3)")
    if covariances_camera is not None and not np.isfinite(covariances_camera).all():
        raise BadInput(f"{what}: expected finite covariances, found NaN or infinity")
    if not (np.isfinite(pose_sigma_m) and pose_sigma_m > 0):
        raise BadInput(f"{what}: pose_sigma_m is {pose_sigma_m}, expected a length above 0")


def _solve_rotation(problem: HandEyeProblem) -> tuple[Rotation, list[Finding]]:
    group = problem.group
    rotations = problem.T_base_flange.rotation[group]
    turned_rad = float((rotations.mean().inv() * rotations).magnitude().max())
    moves_camera, moves_flange = group_moves(problem)
    rotation, values = rotation_between(moves_camera, moves_flange)
    return rotation, weigh_moves(moves_camera, moves_flange, values, turned_rad)


def group_moves(problem: HandEyeProblem) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """The target's moves in the camera and the flange's, turned round, in flange axes; both from their means."""
    group = problem.group
    flange_base = problem.T_base_flange.translation[group]
    centres_camera = problem.centres_camera[group]
    R_base_flange = problem.T_base_flange.rotation[group].mean().as_matrix()
    return centres_camera - centres_camera.mean(axis=0), (flange_base.mean(axis=0) - flange_base) @ R_base_flange


def weigh_moves(
    moves_camera: Float[np.ndarray, "k 3"],
    moves_flange: Float[np.ndarray, "k 3"],
    values: Float[np.ndarray, "3"],
    turned_rad: float,
) -> list[Finding]:
    """What speaks against the two sets of moves being one set in two frames."""
    findings = []
    if turned_rad > _SAME_ORIENTATION_RAD:
        reason = f"rotation: the flange turns by {np.rad2deg(turned_rad):.2g} deg among the translations, expected none"
        findings.append(Finding(verdict="refused" if turned_rad > _TURNED_RAD else "doubtful", reason=reason))
    if values[2] < -_MIRROR_SHARE * values[1]:
        reason = (
            "rotation: the target's moves are the mirror image of the flange's (an axis or a transform is inverted)"
        )
        findings.append(Finding(verdict="refused", reason=reason))
    lengths = np.sqrt([np.sum(moves_camera**2), np.sum(moves_flange**2)])
    if lengths.min() > 0 and lengths.max() > _LENGTH_RATIO * lengths.min():
        ratio = lengths[0] / lengths[1]
        hint = next((f" (are {units} mixed?)" for scale, units in _UNITS.items() if _is_ratio(ratio, scale)), "")
        reason = f"rotation: the target moves {ratio:.3g} times as far in the camera as the flange does{hint}"
        findings.append(Finding(verdict="refused", reason=reason))
    return findings


def _is_ratio(ratio: float, scale: float) -> bool:
    return bool(abs(abs(np.log(ratio)) - np.log(scale)) < np.log(_LENGTH_RATIO))


def _solve_translation(
    problem: HandEyeProblem, R_flange_camera: Rotation
) -> tuple[RigidTransform, Float[np.ndarray, "3"]]:
    """Translation and target by linear least squares; the shortest where they are not determined."""
    turned = rigid_from(R_flange_camera, np.zeros(3))
    jacobian = sight_jacobian(problem.T_base_flange, turned, problem.centres_camera)[..., 3:].reshape(-1, 6)
    known = targets_base(problem.T_base_flange, turned, problem.centres_camera).ravel()
    solution = np.linalg.lstsq(jacobian, -known, rcond=1e-10)[0]
    return rigid_from(R_flange_camera, solution[:3]), solution[3:]


def observe_steps(problem: HandEyeProblem, T_flange_camera: RigidTransform) -> tuple[Observability, Observability]:
    """What the poses tell of the rotation (with the group's common offset) and of translation and target.

    The first uses the flange's moves, not the camera's: noise of the sights would pass for a direction.
    """
    group = problem.group
    rotation_block, translation_block, target_block = sight_blocks(lever_m(problem.centres_camera))
    _, moves_flange = group_moves(problem)
    centres = problem.centres_camera[group].mean(axis=0) + T_flange_camera.rotation.inv().apply(moves_flange)
    jacobian = sight_jacobian(problem.T_base_flange[group], T_flange_camera, centres)
    rotation_rows = np.concatenate([jacobian[..., ROTATION], jacobian[..., TARGET]], axis=-1).reshape(-1, 6)
    jacobian = sight_jacobian(problem.T_base_flange, T_flange_camera, problem.centres_camera)
    translation_rows = jacobian[..., 3:].reshape(-1, 6)
    return (
        observe(rotation_rows, [rotation_block, target_block]),
        observe(translation_rows, [translation_block, target_block]),
    )


def _covariance(
    problem: HandEyeProblem, T_flange_camera: RigidTransform, residuals_base: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "9 9"]:
    """Of all nine parameters of `sight_model`, by carrying each sight's error through both steps.

    Where the residuals are larger than promised, they count.
    """
    count, group = len(residuals_base), problem.group
    jacobian = sight_jacobian(problem.T_base_flange, T_flange_camera, problem.centres_camera)
    of_rotation, of_rest = jacobian[..., ROTATION].reshape(-1, 3), jacobian[..., 3:].reshape(-1, 6)
    centring = np.kron(np.diag(group.astype(float)) - np.outer(group, group) / group.sum(), np.eye(3))
    if np.linalg.matrix_rank(centring @ of_rotation, 1e-9) < 3 or np.linalg.matrix_rank(of_rest, 1e-9) < 6:
        return np.full((9, 9), np.inf)
    to_rotation = -np.linalg.pinv(centring @ of_rotation) @ centring
    to_rest = -np.linalg.pinv(of_rest) @ (np.eye(3 * count) + of_rotation @ to_rotation)
    gain = np.vstack([to_rotation, to_rest])
    freedom = max(3 * count - 9, 1)
    if problem.covariances_camera is None:
        return gain @ gain.T * np.sum(residuals_base**2) / freedom
    errors_base = sight_covariances_base(
        problem.T_base_flange, T_flange_camera, problem.covariances_camera, problem.pose_sigma_m
    )
    chi2 = np.einsum("ni,nij,nj->", residuals_base, np.linalg.inv(errors_base), residuals_base)
    blocks = gain.reshape(9, count, 3)
    return max(1.0, chi2 / freedom) * np.einsum("pni,nij,qnj->pq", blocks, errors_base, blocks)

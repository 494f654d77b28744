"""Hand-eye calibration from recorded sights of a fixed target: wrong rows are found, pose groups are compared.

The rows that keep one orientation (the translations) and the free ones are searched for wrong rows apart from
each other: the first by `hand_eye`'s closed form for the rotation, the second by its linear one for translation
and target. Then all sound rows give one joint least squares estimate. It has a target of its own for either
group where these disagree: the translations then tell the rotation only, and the free poses all the rest.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.special import fdtrc

from weldcell.calib import hand_eye
from weldcell.calib.consensus import FEWEST_AGREEING, WRONG_SHARE, Misses, agreeing, most_wrong
from weldcell.calib.hand_eye import DOUBTFUL_RMS_M, REFUSED_RMS_M, HandEyeProblem
from weldcell.calib.joint_hand_eye import SIGMA_M, JointEstimate, joint_estimate
from weldcell.calib.sight_model import targets_base
from weldcell.calib.turns import weigh_turns
from weldcell.calib.verdict import (
    REFUSED_CONDITION,
    Finding,
    Judged,
    judge,
    weigh_condition,
    weigh_convergence,
    weigh_residual,
    weigh_spare,
)

_CHANCE = 1e-3  # of groups said to disagree that do not
_GAP_RATIO = 3.0  # times the residuals: a robot's errors differ between groups, too
_FEWEST = 3  # poses of one orientation, or free ones with a target of their own


@dataclass(frozen=True, kw_only=True, eq=False)
class RobustHandEyeResult(Judged):
    """The camera on the flange from the sound rows.

    The condition number is the largest of the joint estimate's and of the two steps'.
    """

    T_flange_camera: RigidTransform
    targets_base: Float[np.ndarray, "g 3"]
    """The target (m): one, or that of the translations and that of the free poses where they disagree."""
    group: Bool[np.ndarray, "n"]
    """The rows that keep one orientation."""
    sound: Bool[np.ndarray, "n"]
    """The rows that the estimate rests on; the others are outliers."""
    covariance: Float[np.ndarray, "6 6"]
    """Rotation vector (rad, camera axes), then translation (m, flange axes); infinite if a direction is open."""
    residuals_base: Float[np.ndarray, "n 3"]
    """Where each row puts the target, less its group's target (m); outliers too."""
    rms_m: float
    """Root mean square length of the sound rows' residuals."""
    leave_one_out_rms_m: float
    """The same of each sound row against the estimate without it; NaN where one row is indispensable."""


def solve(problem: HandEyeProblem) -> RobustHandEyeResult:
    """The camera on the flange from the rows that agree with each other; deterministic."""
    if len(problem.centres_camera) < _FEWEST:
        return _closed_form(problem)
    sound = _sound_rows(problem, problem.group)
    checked = _only(problem, sound)
    start = hand_eye.solve(checked).T_flange_camera
    common = joint_estimate(checked, start, np.zeros(int(np.sum(sound)), dtype=int))
    apart = _apart(checked, start)
    gap_findings, disagree = _weigh_gap(apart, common)
    joint = apart if disagree and apart is not None else common
    return _judged(problem, sound, checked, joint, gap_findings)


def _sound_rows(problem: HandEyeProblem, group: Bool[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """The rows that agree with their kind: translations by the rotation, free poses by translation and target."""
    sound = np.ones(len(group), dtype=bool)
    rows, free = np.flatnonzero(group), np.flatnonzero(~group)
    if len(rows) < _FEWEST or not len(free):
        return sound
    sound[rows] = agreeing(_turn_misses(problem, rows), len(rows))
    rotation, _ = hand_eye.rotation_between(*hand_eye.group_moves(_only(problem, sound & group)))
    sound[free] = agreeing(_shift_misses(problem, rotation, free), len(free))
    return sound


def _turn_misses(problem: HandEyeProblem, rows: Int[np.ndarray, "k"]) -> Misses:
    """By how much each translation misses the rotation (and offset) that the chosen ones give."""
    R_base_flange = problem.T_base_flange.rotation[rows].mean().as_matrix()
    seen_camera = problem.centres_camera[rows]
    moved_flange = -problem.T_base_flange.translation[rows] @ R_base_flange

    def misses(chosen: Int[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        seen = seen_camera - seen_camera[chosen].mean(axis=0)
        moved = moved_flange - moved_flange[chosen].mean(axis=0)
        rotation, _ = hand_eye.rotation_between(seen[chosen], moved[chosen])
        return np.asarray(np.linalg.norm(rotation.apply(seen) - moved, axis=1))

    return misses


def _shift_misses(problem: HandEyeProblem, rotation: Rotation, rows: Int[np.ndarray, "k"]) -> Misses:
    """By how much each free pose misses the translation and target that the chosen ones give."""
    T_base_flange = problem.T_base_flange[rows]
    R_base_flange = T_base_flange.rotation.as_matrix()
    jacobian = np.concatenate([R_base_flange, np.broadcast_to(-np.eye(3), R_base_flange.shape)], axis=-1)
    known = T_base_flange.apply(rotation.apply(problem.centres_camera[rows]))

    def misses(chosen: Int[np.ndarray, "m"]) -> Float[np.ndarray, "k"]:
        solution = np.linalg.lstsq(jacobian[chosen].reshape(-1, 6), -known[chosen].ravel(), rcond=1e-6)[0]
        return np.asarray(np.linalg.norm(jacobian @ solution + known, axis=1))

    return misses


def _only(problem: HandEyeProblem, rows: Bool[np.ndarray, "n"]) -> HandEyeProblem:
    covariances = problem.covariances_camera
    return replace(
        problem,
        T_base_flange=problem.T_base_flange[rows],
        centres_camera=problem.centres_camera[rows],
        translations=problem.group[rows] if np.any(problem.group[rows]) else None,
        covariances_camera=None if covariances is None else covariances[rows],
    )


def _apart(problem: HandEyeProblem, start: RigidTransform) -> JointEstimate | None:
    """The estimate with a target for either group; None where the rows do not determine it."""
    free = ~problem.group
    if np.sum(free) < _FEWEST or np.sum(~free) < _FEWEST:
        return None
    joint = joint_estimate(problem, start, free.astype(int))
    return joint if joint.seen.condition_number < REFUSED_CONDITION else None


def _weigh_gap(apart: JointEstimate | None, common: JointEstimate) -> tuple[list[Finding], bool]:
    """Whether the two groups put the target in different places: F test, and clear of the residuals' size."""
    if apart is None:
        return [], False
    gap = apart.targets_base[1] - apart.targets_base[0]
    to_gap = np.hstack([-np.eye(3), np.eye(3)])
    spread = to_gap @ apart.found.covariance[6:, 6:] @ to_gap.T
    chance = fdtrc(3, max(apart.freedom, 1), gap @ np.linalg.solve(spread, gap) / 3)
    gap_m = float(np.linalg.norm(gap))
    if chance > _CHANCE or gap_m < _GAP_RATIO * apart.rms_m or common.rms_m < SIGMA_M:
        return [], False
    numbers = ", ".join(f"{value * 1e3:.1f}" for value in gap)
    reason = (
        f"target: the poses of one orientation and the free poses disagree about its place by {gap_m * 1e3:.3g} mm "
        f"({numbers}) of the base; each group has its own target, and the free poses alone tell the translation "
        f"(one target for both would miss by {common.rms_m * 1e3:.3g} mm rms instead of {apart.rms_m * 1e3:.3g} mm)"
    )
    return [Finding(verdict="doubtful", reason=reason)], True


def _judged(
    problem: HandEyeProblem,
    sound: Bool[np.ndarray, "n"],
    checked: HandEyeProblem,
    joint: JointEstimate,
    findings: list[Finding],
) -> RobustHandEyeResult:
    rotation_seen, translation_seen = hand_eye.observe_steps(checked, joint.T_flange_camera)
    seen = (joint.seen, rotation_seen, translation_seen)
    findings = findings + _weigh_rows(problem.group, sound) + _weigh_turn(checked)
    by_step = weigh_condition(rotation_seen, "rotation") + weigh_condition(translation_seen, "translation")
    findings += by_step or weigh_condition(joint.seen, "joint estimate")  # the steps say the same in fewer words
    findings += weigh_turns(checked.T_base_flange.rotation, "translation")
    findings += weigh_residual(joint.rms_m, "hand-eye", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M)
    findings += weigh_spare(joint.found.residuals.size, len(joint.found.parameters))
    findings += weigh_convergence(joint.found.converged, joint.found.message)
    places = (~problem.group).astype(int) if len(joint.targets_base) > 1 else np.zeros(len(sound), dtype=int)
    where_base = targets_base(problem.T_base_flange, joint.T_flange_camera, problem.centres_camera)
    verdict, reasons = judge(findings)
    return RobustHandEyeResult(
        T_flange_camera=joint.T_flange_camera,
        targets_base=joint.targets_base,
        group=problem.group,
        sound=sound,
        covariance=joint.found.covariance[:6, :6],
        residuals_base=where_base - joint.targets_base[places],
        rms_m=joint.rms_m,
        leave_one_out_rms_m=_leave_one_out_rms_m(joint),
        condition_number=max(one.condition_number for one in seen),
        observability=tuple(dict.fromkeys(words for one in seen for words in one.weak_directions)),
        verdict=verdict,
        reasons=reasons,
    )


def _closed_form(problem: HandEyeProblem) -> RobustHandEyeResult:
    """What the two steps say of too few rows for a joint estimate."""
    found = hand_eye.solve(problem)
    verdict, reasons = judge([Finding(verdict="refused", reason=reason) for reason in found.reasons])
    return RobustHandEyeResult(
        T_flange_camera=found.T_flange_camera,
        targets_base=found.target_base[None],
        group=problem.group,
        sound=np.ones(len(problem.centres_camera), dtype=bool),
        covariance=np.full((6, 6), np.inf),
        residuals_base=found.residuals_base,
        rms_m=found.rms_m,
        leave_one_out_rms_m=np.nan,
        condition_number=found.condition_number,
        observability=found.observability,
        verdict=verdict,
        reasons=reasons,
    )


def _weigh_turn(problem: HandEyeProblem) -> list[Finding]:
    """Mirror images, mixed units, and translations that turn."""
    rotations = problem.T_base_flange.rotation[problem.group]
    turned_rad = float((rotations.mean().inv() * rotations).magnitude().max())
    moves = hand_eye.group_moves(problem)
    return hand_eye.weigh_moves(*moves, hand_eye.rotation_between(*moves)[1], turned_rad)


def _weigh_rows(group: Bool[np.ndarray, "n"], sound: Bool[np.ndarray, "n"]) -> list[Finding]:
    """Doubts where wrong rows could not be told, refusal where there are too many of them."""
    findings = []
    for name, rows in (("poses of one orientation", group), ("free poses", ~group)):
        count, wrong = int(np.sum(rows)), int(np.sum(rows & ~sound))
        if wrong > WRONG_SHARE * count:
            reason = f"{wrong} of {count} {name} disagree with the rest, expected at most {WRONG_SHARE:.0%}"
            findings.append(Finding(verdict="refused", reason=reason))
        elif most_wrong(count) == 0:
            reason = f"{count} {name}: too few to tell a wrong one from the others (from {FEWEST_AGREEING + 1} on)"
            findings.append(Finding(verdict="doubtful", reason=reason))
    return findings


def _leave_one_out_rms_m(joint: JointEstimate) -> float:
    """Each row against the estimate without it: (I - H_ii)^-1 r_i with H the hat matrix (exact for linear models)."""
    jacobian = joint.found.jacobian
    flat = jacobian.reshape(-1, jacobian.shape[-1])
    hat = np.einsum("nip,pq,njq->nij", jacobian, np.linalg.pinv(flat.T @ flat), jacobian)
    rest = np.eye(3) - hat
    if np.linalg.svd(rest, compute_uv=False).min() < 1e-9:
        return float("nan")
    left_out = np.linalg.solve(rest, joint.found.residuals[..., None])[..., 0]
    return float(np.sqrt(np.mean(np.sum(left_out**2, axis=1)))) * SIGMA_M

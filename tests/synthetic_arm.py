"""An imperfect arm and what it sees and touches, fabricated without the simulator and without `calib`'s arm model.

A chain of bodies with frames of their own (origin in the parent, a turn, a joint about z or y), masses on
them, and gravity's torques from the slope of the potential energy.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

import synthetic
from weldcell.calib.calibrated_arm import CalibratedArm
from weldcell.calib.joint_estimate import JointResult, solve
from weldcell.calib.joint_problem import JointProblem, PointSights, Sizes, SphereSights, TargetDistance, Touches
from weldcell.calib.sight_model import perturbation
from weldcell.cell.arm import NominalArm
from weldcell.cell.frames import rigid_from

ORIGINS = np.array([[0, 0, 0.4], [0.18, 0, 0], [0, 0, 0.6], [-0.12, 0, 0.62], [0, 0, 0], [0, 0, 0]])
AXES = np.array([[0, 0, -1], [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 1, 0], [0, 0, -1.0]])
TURNS = Rotation.from_rotvec(np.array([[0, 0, 0], [0, np.pi / 2, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]))
FLANGE = np.array([0, 0, 0.115])
MASSES_KG = np.array([35.0, 25.0, 20.0, 12.0, 4.0, 5.0])
CENTRES = np.array(
    [[0.1, 0.02, -0.1], [0, 0.05, 0.28], [-0.06, 0.01, 0.1], [0, 0, -0.2], [0, 0.01, 0.03], [0, 0, 0.15]]
)
HOME_RAD = np.radians([11.7, -75.7, 76.3, -34.4, 96.1, -80.0])
SECTION_SIGMA_M = np.array([2e-6, 4e-6, 8e-6])
"""Noise of a section's x and z, and of its radius."""
NEAR_BASE = synthetic.SPHERE_BASE + np.array([[0.06, -0.05, 0.02], [-0.07, 0.03, 0.04], [0.02, 0.08, -0.02]])
FAR_BASE = synthetic.SPHERE_BASE + np.array([[-0.13, 0.32, 0.06], [-0.15, -0.33, 0.0], [0.12, 0.29, 0.16]])


@dataclass(frozen=True, kw_only=True)
class ActualArm:
    """An arm with errors."""

    link_m: np.ndarray
    twist_rad: np.ndarray
    zero_rad: np.ndarray
    compliance_rad_per_nm: np.ndarray

    def flanges(self, joints_rad: np.ndarray) -> RigidTransform:
        """T_base_flange for n readings."""
        rotation, origin = self._bodies(joints_rad - self.compliance_rad_per_nm * held_torques_nm(joints_rad))[-1]
        return rigid_from(Rotation.from_matrix(rotation), origin + rotation @ FLANGE)

    def _bodies(self, angles_rad: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Turn and origin of each body."""
        rotation, origin = np.broadcast_to(np.eye(3), (len(angles_rad), 3, 3)), np.zeros((len(angles_rad), 3))
        bodies = []
        for k in range(6):
            origin = origin + rotation @ (ORIGINS[k] + self.link_m[k])
            turn = TURNS[k] * Rotation.from_rotvec(self.twist_rad[k])
            joint = Rotation.from_rotvec((angles_rad[:, [k]] + self.zero_rad[k]) * AXES[k])
            rotation = rotation @ (turn * joint).as_matrix()
            bodies.append((rotation, origin))
        return bodies


EXACT = ActualArm(
    link_m=np.zeros((6, 3)), twist_rad=np.zeros((6, 3)), zero_rad=np.zeros(6), compliance_rad_per_nm=np.zeros(6)
)


def held_torques_nm(joints_rad: np.ndarray) -> np.ndarray:
    """What joints of the nominal arm hold: the slope of its potential energy."""
    # an energy is sines and cosines of each angle: over 2 sin(step) its central difference is the slope itself
    step = 1e-3
    moved = joints_rad + step * np.concatenate([np.eye(6), -np.eye(6)])[:, None]
    bodies = EXACT._bodies(moved.reshape(-1, 6))
    energy_j = 9.81 * sum(
        mass * (origin + rotation @ centre)[:, 2]
        for mass, centre, (rotation, origin) in zip(MASSES_KG, CENTRES, bodies, strict=True)
    )
    ahead, behind = energy_j.reshape(2, 6, -1)
    return (ahead - behind).T / (2 * np.sin(step))


@cache
def nominal_arm() -> NominalArm:
    """What the controller believes."""
    bodies = EXACT._bodies(np.zeros((1, 6)))
    return NominalArm(
        axes_base=np.array([rotation[0] @ axis for (rotation, _), axis in zip(bodies, AXES, strict=True)]),
        anchors_base=np.array([origin[0] for _, origin in bodies]),
        T_base_flange_zero=EXACT.flanges(np.zeros((1, 6)))[0],
        link_masses_kg=MASSES_KG,
        link_centres_base=np.array(
            [origin[0] + rotation[0] @ centre for (rotation, origin), centre in zip(bodies, CENTRES, strict=True)]
        ),
    )


def nominal_readings(T_base_flange: RigidTransform, near_rad: np.ndarray) -> np.ndarray:
    """Joint readings of the nominal arm, by Newton steps; checked against the fabricated arm."""
    joints_rad = CalibratedArm(nominal=nominal_arm(), errors=np.zeros(48)).readings(T_base_flange, near_rad)
    assert np.abs(EXACT.flanges(joints_rad).as_matrix() - T_base_flange.as_matrix()).max() < 1e-9
    return joints_rad


def drawn_arm(rng: np.random.Generator, sizes: Sizes) -> ActualArm:
    """An arm whose errors have these sizes."""
    wrist = np.array([1, 1, 1, 4, 4, 4])
    return ActualArm(
        link_m=rng.normal(0, sizes.offset_m, (6, 3)),
        twist_rad=rng.normal(0, sizes.twist_rad, (6, 3)),
        zero_rad=rng.normal(0, sizes.zero_rad, 6),
        compliance_rad_per_nm=rng.normal(0, sizes.compliance_rad_per_nm, 6) * wrist,
    )


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Where the arm looks at spheres and touches them."""

    sights_rad: np.ndarray
    sight_targets: np.ndarray
    touches_rad: np.ndarray
    touch_targets: np.ndarray
    inward_rad_per_m: np.ndarray
    """Moves each touch towards its sphere."""
    spheres_base: np.ndarray


@dataclass(frozen=True, kw_only=True)
class ActualCell:
    """Everything that an estimate wants to know."""

    arm: ActualArm
    T_flange_camera: RigidTransform
    tip_flange: np.ndarray


def plan(
    rng: np.random.Generator,
    *,
    sights: int = 20,
    touches: int = 60,
    tilt_deg: float = 30.0,
    spheres_base: np.ndarray = synthetic.SPHERE_BASE[None],
) -> Plan:
    """Sights from free poses, that show sections of useful size, and touches in varied orientations, of each sphere."""
    T_flange_camera = synthetic.camera_on_flange()
    looks, pokes, inward = [], [], []
    for centre_base in spheres_base:
        seen = synthetic.sights(rng, translations=0, free=sights, tilt_deg=tilt_deg, target_base=centre_base)
        centres = synthetic.PLANE.T_camera_laser.inv().apply(seen.centres_camera)
        centres[:, 1] = -rng.uniform(0.4, 0.7, sights) * synthetic.SPHERE_RADIUS_M
        centres_camera = synthetic.PLANE.T_camera_laser.apply(centres)
        rotation = seen.T_base_flange.rotation
        T_base_flange = rigid_from(rotation, centre_base - rotation.apply(T_flange_camera.apply(centres_camera)))
        looks.append(readings(_turned(T_base_flange, centre_base)))
        touching = _turned(synthetic.touch_poses(rng, touches, centre_base=centre_base, tilt_deg=tilt_deg), centre_base)
        pokes.append(readings(touching))
        towards = centre_base - touching.apply(synthetic.TIP_FLANGE)
        closer = rigid_from(touching.rotation, touching.translation + 0.01 * towards)
        step_m = 0.01 * np.linalg.norm(towards, axis=1, keepdims=True)
        inward.append((nominal_readings(closer, pokes[-1]) - pokes[-1]) / step_m)
    return Plan(
        sights_rad=np.concatenate(looks),
        sight_targets=np.repeat(np.arange(len(spheres_base)), sights),
        touches_rad=np.concatenate(pokes),
        touch_targets=np.repeat(np.arange(len(spheres_base)), touches),
        inward_rad_per_m=np.concatenate(inward),
        spheres_base=spheres_base,
    )


def readings(T_base_flange: RigidTransform) -> np.ndarray:
    """Nominal joint readings for a stack of poses over the table, from the home posture."""
    joints_rad = np.tile(HOME_RAD, (len(T_base_flange), 1))
    home = EXACT.flanges(HOME_RAD[None])[0]
    turn = (T_base_flange.rotation * home.rotation.inv()).as_rotvec()
    for share in np.linspace(0.1, 1, 10):  # Newton's method needs a near start
        between = home.translation + share * (T_base_flange.translation - home.translation)
        rotation = Rotation.from_rotvec(share * turn) * home.rotation
        joints_rad = nominal_readings(rigid_from(rotation, between), joints_rad)
    return joints_rad


def observe(
    cell: ActualCell,
    planned: Plan,
    rng: np.random.Generator,
    actual: Sizes,
    *,
    noise: float = 1.0,
    believed: float = 1.0,
    **changes,
) -> JointProblem:
    """What is measured: sections of the spheres, and readings at which the tip touches them.

    The noise is `noise` times that of `actual`, and `believed` times is what the estimate is told of it.
    """
    count = len(planned.sights_rad)
    T_laser_base = (
        cell.arm.flanges(_missed(planned.sights_rad, rng, noise * actual.joint_noise_rad))
        * (cell.T_flange_camera * synthetic.PLANE.T_camera_laser)
    ).inv()
    x, y, z = T_laser_base.apply(planned.spheres_base[planned.sight_targets]).T
    circles = np.column_stack([x, z, np.sqrt(synthetic.SPHERE_RADIUS_M**2 - y**2)])
    circles = circles + noise * rng.normal(size=(count, 3)) * np.hypot(SECTION_SIGMA_M, actual.sight_noise_m)
    sum_m = synthetic.SPHERE_RADIUS_M + synthetic.TIP_RADIUS_M
    given = {
        "arm": nominal_arm(),
        "sights": SphereSights(
            joints_rad=planned.sights_rad,
            circles_laser=circles,
            covariances_laser=np.tile(np.diag((believed * SECTION_SIGMA_M) ** 2), (count, 1, 1)),
            targets=planned.sight_targets,
            radii_m=np.full(count, synthetic.SPHERE_RADIUS_M),
            sides=np.ones(count, dtype=int),
            T_camera_laser=synthetic.PLANE.T_camera_laser,
        ),
        "touches": Touches(
            joints_rad=_touching(cell, planned, rng, noise * actual.joint_noise_rad),
            targets=planned.touch_targets,
            sums_m=np.full(len(planned.touches_rad), sum_m),
            sigma_m=1e-7 * believed,
        ),
        "tip_flange": synthetic.TIP_FLANGE,
        "tip_sigma_m": 1e-3,
        "T_flange_camera": synthetic.camera_on_flange(),
        "sizes": replace(
            actual,
            joint_noise_rad=believed * actual.joint_noise_rad,
            sight_noise_m=believed * actual.sight_noise_m,
        ),
    }
    return JointProblem(**{**given, **changes})


def drawn_cell(rng: np.random.Generator, sizes: Sizes, *, tip_sigma_m: float = 1e-3) -> ActualCell:
    """A cell whose arm and tip are off, and whose camera is anywhere near its drawing."""
    turn = Rotation.from_rotvec(rng.normal(0, 0.001, 3))
    drawn = synthetic.camera_on_flange()
    return ActualCell(
        arm=drawn_arm(rng, sizes),
        T_flange_camera=rigid_from(drawn.rotation * turn, drawn.translation + rng.normal(0, 4e-4, 3)),
        tip_flange=synthetic.TIP_FLANGE + rng.normal(0, tip_sigma_m, 3),
    )


@dataclass(frozen=True, kw_only=True)
class Views:
    """Points of the base, seen with readings of the arm."""

    joints_rad: np.ndarray
    points_base: np.ndarray


def views(rng: np.random.Generator, points_base: np.ndarray, *, each: int = 3, tilt_deg: float = 15.0) -> Views:
    """Views of points in varied orientations, as a torch at work has them."""
    found = []
    for point in points_base:
        seen = synthetic.sights(rng, translations=0, free=each, tilt_deg=tilt_deg, target_base=point)
        found.append(readings(_turned(seen.T_base_flange, point)))
    return Views(joints_rad=np.concatenate(found), points_base=np.repeat(points_base, each, axis=0))


def misses_base(cell: ActualCell, result: JointResult, seen: Views) -> tuple[np.ndarray, np.ndarray]:
    """By what the actual tip misses points when it is sent where the sensor saw them, without noise; and what was sent.

    The flange keeps the orientation of the view.
    """
    T_base_camera = cell.arm.flanges(seen.joints_rad) * cell.T_flange_camera
    points_camera = T_base_camera.inv().apply(seen.points_base)
    T_base_flange = result.arm.flanges(seen.joints_rad)
    points_base = (T_base_flange * result.T_flange_camera).apply(points_camera)
    rotation = T_base_flange.rotation
    sent = result.arm.readings(
        rigid_from(rotation, points_base - rotation.apply(result.tip_flange)), near_rad=seen.joints_rad
    )
    tips_base = cell.arm.flanges(sent).apply(cell.tip_flange)
    covariances = result.miss_covariances(seen.joints_rad, points_camera, sent)
    return tips_base - seen.points_base, covariances


@dataclass(frozen=True, kw_only=True)
class Honesty:
    """Predicted against actual errors over many cells drawn from what is believed."""

    sigma_ratio: dict[str, np.ndarray]
    """Actual over predicted standard deviation of each parameter."""
    coverage: dict[str, float]
    """How often the 95 % region contained the truth."""


def honesty(trials: int, seed: int = 0, sizes: Sizes | None = None, **changes) -> Honesty:
    """Monte Carlo over arms, cameras, tips and noise, with one plan of sights and touches."""
    sizes = Sizes() if sizes is None else sizes
    planned = plan(np.random.default_rng(seed))
    near, far = (views(np.random.default_rng(seed + k), base, each=1) for k, base in ((1, NEAR_BASE), (2, FAR_BASE)))
    errors: dict[str, list[np.ndarray]] = {name: [] for name in ("camera", "tip", "near", "far")}
    predicted: dict[str, list[np.ndarray]] = {name: [] for name in errors}
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        cell = drawn_cell(rng, sizes)
        result = solve(observe(cell, planned, rng, sizes, **changes))
        found = {
            "camera": (perturbation(result.T_flange_camera, cell.T_flange_camera), result.covariance),
            "tip": (cell.tip_flange - result.tip_flange, result.tip_covariance),
        }
        for name, each in (("near", near), ("far", far)):
            misses, covariances = misses_base(cell, result, each)
            found[name] = (misses[trial % 3], covariances[trial % 3])
        for name, (error, covariance) in found.items():
            errors[name].append(error)
            predicted[name].append(covariance)
    ratio, coverage = {}, {}
    for name in errors:
        error, covariance = np.array(errors[name]), np.array(predicted[name])
        variances = np.diagonal(covariance, axis1=1, axis2=2)
        ratio[name] = np.sqrt(np.mean(error**2, axis=0) / np.mean(variances, axis=0))
        distances = np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        coverage[name] = float(np.mean(distances < chi2.ppf(0.95, error.shape[1])))
    return Honesty(sigma_ratio=ratio, coverage=coverage)


def two_spheres(rng: np.random.Generator, apart_m: float = 0.3) -> tuple[Plan, TargetDistance]:
    """A plan on two spheres whose distance is known."""
    first, second = synthetic.SPHERE_BASE, synthetic.SPHERE_BASE + [0.0, apart_m, 0.0]
    return plan(rng, spheres_base=np.array([first, second])), TargetDistance(first=0, second=1, distance_m=apart_m)


def as_points(problem: JointProblem, sigma_m: float = 8e-6) -> JointProblem:
    """The same with the centres that the sections show, as a point target gives them."""
    sights = problem.sights
    covariances = np.tile(sigma_m**2 * np.eye(3), (len(sights.joints_rad), 1, 1))
    points = PointSights(
        joints_rad=sights.joints_rad,
        centres_camera=sights.lifted(),
        covariances_camera=covariances,
        targets=sights.targets,
    )
    return replace(problem, sights=points)


def _turned(T_base_flange: RigidTransform, point_base: np.ndarray) -> RigidTransform:
    """The poses turned to the left by 90 degrees about a point: travel along y keeps the wrist well bent."""
    turn = Rotation.from_euler("z", 90, degrees=True)
    return rigid_from(turn, point_base - turn.apply(point_base)) * T_base_flange


def _missed(joints_rad: np.ndarray, rng: np.random.Generator, sigma_rad: float) -> np.ndarray:
    return joints_rad + rng.normal(size=joints_rad.shape) * sigma_rad


def _touching(cell: ActualCell, planned: Plan, rng: np.random.Generator, sigma_rad: float) -> np.ndarray:
    """Readings at which the actual tip touches: the planned ones, moved along the line from tip to sphere."""
    misses = rng.normal(size=planned.touches_rad.shape) * sigma_rad
    centres_base = planned.spheres_base[planned.touch_targets]
    joints_rad = planned.touches_rad
    for _ in range(8):  # each shrinks the gap some thirtyfold, in the worst posture tenfold
        tips_base = cell.arm.flanges(joints_rad + misses).apply(cell.tip_flange)
        gaps_m = np.linalg.norm(tips_base - centres_base, axis=1) - synthetic.SPHERE_RADIUS_M - synthetic.TIP_RADIUS_M
        joints_rad = joints_rad + gaps_m[:, None] * planned.inward_rad_per_m
    assert np.abs(gaps_m).max() < 1e-7
    return joints_rad

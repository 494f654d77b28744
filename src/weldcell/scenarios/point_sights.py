"""Views of a fixed point: the apex of a pyramid, on which the operator jogs the laser line in each pose."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.apex_sight import ApexSightProblem, ApexSightResult
from weldcell.calib.apex_sight import solve as solve_apex_sight
from weldcell.calib.pose_choice import choose, sight_candidates, translation_candidates
from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import rigid_from
from weldcell.cell.randomness import generator
from weldcell.models.pyramid import Pyramid
from weldcell.scenarios.candidates import gathered
from weldcell.scenarios.sphere_sights import Spread, lit_and_in_picture
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at

AIM_SIGMA_M = 1e-4
"""How far the jogged light plane misses the apex: a miss of d shows as a flat of 2 d between the flanks."""
SPREAD = Spread(tilt_rad=np.radians(25), turn_rad=np.radians(25))
"""The line may not turn to the pyramid's edges, 45 degrees from its faces."""
_ACROSS_M, _DEPTH_M = (
    0.012,
    0.020,
)  # of the apex from the crossing of camera axis and light, along the line and the light
_FLANK_M = 0.010  # of the pyramid to either side that must be seen
_JOGS = 3


@dataclass(frozen=True, kw_only=True)
class PointSight:
    """A view of the apex."""

    T_base_flange: RigidTransform
    """As reported."""
    apex: ApexSightResult


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    joints_rad: Float[np.ndarray, "6"]
    T_base_flange: RigidTransform
    apex_camera: Float[np.ndarray, "3"]


def plan_point_views(
    station: Station, apex_base: Float[np.ndarray, "3"], translations: int, free: int
) -> tuple[list[Float[np.ndarray, "6"]], list[Float[np.ndarray, "6"]]]:
    """Postures with the working orientation that see the apex from all over the light plane, and free ones."""
    rng = generator(station.seed, "plan/point")
    working = station.rotation_base_flange(station.heading_rad)

    def leaning() -> Rotation:
        heading_rad = station.heading_rad + SPREAD.turn_rad * rng.uniform(-1, 1)
        return station.rotation_base_flange(heading_rad, SPREAD.tilt_rad * rng.uniform(), rng.uniform(0, 2 * np.pi))

    still = _candidates(station, apex_base, translations, lambda: working, rng)
    turned = _candidates(station, apex_base, free, leaning, rng)
    return (
        _choose(station, still, translations, translation_candidates),
        _choose(station, turned, free, sight_candidates),
    )


def take_point_sights(
    station: Station, target: Pyramid, postures: Sequence[Float[np.ndarray, "6"]], stage: str, title: str
) -> list[PointSight]:
    """The views from these postures, the line jogged onto the apex in each; those without an apex are left out."""
    sights = []
    for index, joints_rad in enumerate(station.progress.track(postures, title)):
        station.go(joints_rad)
        aimed_rad = _jogged(station, target, joints_rad, stage, index)
        station.stand_at(aimed_rad, station.time_s + 1.0)
        sight = station.see(stage, index)
        station.log_sight(sight, station.head.T_flange_camera)
        apex = solve_apex_sight(
            ApexSightProblem(
                points_camera=sight.profile.points_camera[sight.profile.valid],
                sigma_m=sight.profile.sigma_m[sight.profile.valid],
                plane=station.belief.plane,
                aim_sigma_m=AIM_SIGMA_M,
            )
        )
        if apex.valid:
            sights.append(PointSight(T_base_flange=sight.shot.T_base_flange, apex=apex))
        else:
            station.note(f"{stage}, view {index + 1}: no apex, {apex.reason}")
        station.stand_at(joints_rad, station.time_s + 1.0)
    return sights


def _jogged(
    station: Station, target: Pyramid, joints_rad: Float[np.ndarray, "6"], stage: str, index: int
) -> Float[np.ndarray, "6"]:
    """Readings at which the actual light plane misses the actual apex by the aim's error alone.

    The operator sees the flat between the flanks and moves the flange across the light until it is gone.
    """
    aim_m = AIM_SIGMA_M * generator(station.seed, f"{stage}/aim", index).normal()
    plane = station.actual_plane
    for _ in range(_JOGS):
        station.cell.take(joints_rad, generator(station.seed, f"{stage}/pose", index))
        apex_camera = station.cell.T_base("camera").inv().apply(station.cell.T_base_part(target.name).translation)
        T_base_flange = station.controller.forward(joints_rad)
        R_base_camera = T_base_flange.rotation * station.head.T_flange_camera.rotation
        step_base = R_base_camera.apply(plane.normal_camera) * (float(plane.distance_m(apex_camera)) - aim_m)
        moved = rigid_from(T_base_flange.rotation, T_base_flange.translation + step_base)
        joints_rad = station.controller.inverse(moved, joints_rad)
    return joints_rad


def _candidates(
    station: Station,
    apex_base: Float[np.ndarray, "3"],
    count: int,
    orientation: Callable[[], Rotation],
    rng: np.random.Generator,
) -> list[_Candidate]:
    """Random postures that see the apex and are clear of everything, several times `count`."""
    return gathered(lambda: _candidate(station, apex_base, orientation(), rng), count, "point")


def _candidate(
    station: Station, apex_base: Float[np.ndarray, "3"], rotation: Rotation, rng: np.random.Generator
) -> _Candidate | None:
    T_camera_laser = station.belief.plane.T_camera_laser
    crossing_laser = T_camera_laser.inv().apply([0, 0, station.head.stand_off_m])
    apex_laser = crossing_laser + rng.uniform(-1, 1, 3) * [_ACROSS_M, 0, _DEPTH_M]
    seen_laser = apex_laser + np.array([[-_FLANK_M, 0, _FLANK_M], [0, 0, 0], [_FLANK_M, 0, _FLANK_M]])
    if not lit_and_in_picture(station, T_camera_laser.apply(seen_laser)):
        return None
    apex_camera = T_camera_laser.apply(apex_laser)
    T_base_flange = flange_at(apex_base, rotation, station.head.T_flange_camera.apply(apex_camera))
    try:
        joints_rad = station.controller.inverse(T_base_flange, station.planner.home_rad)
    except OutOfReach:
        return None
    if not station.planner.working(joints_rad):
        return None
    return _Candidate(joints_rad=joints_rad, T_base_flange=T_base_flange, apex_camera=apex_camera)


def _choose(
    station: Station, candidates: list[_Candidate], count: int, jacobians_of: Callable[..., np.ndarray]
) -> list[Float[np.ndarray, "6"]]:
    """The postures that together see the parameters best."""
    jacobians = jacobians_of(
        RigidTransform.concatenate([candidate.T_base_flange for candidate in candidates]),
        station.head.T_flange_camera,
        np.array([candidate.apex_camera for candidate in candidates]),
        station.head.stand_off_m,
    )
    return [candidates[k].joints_rad for k in choose(jacobians, count)]

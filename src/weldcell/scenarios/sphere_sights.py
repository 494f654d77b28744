"""Views of the standard sphere: chosen on what is known, taken by the actual cell."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.pose_choice import choose, sight_candidates, translation_candidates
from weldcell.calib.pose_design import PoseDesignProblem, design
from weldcell.calib.sphere_sight import SphereSightProblem, SphereSightResult
from weldcell.calib.sphere_sight import solve as solve_sphere_sight
from weldcell.cell.errors import OutOfReach
from weldcell.cell.randomness import generator
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.candidates import gathered
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How far orientations vary about the working one (torch down, travelling along the seam)."""

    tilt_rad: float
    """Largest lean from the vertical, in any direction."""
    turn_rad: float
    """Largest turn about the vertical, to either side."""


SIDE = 1
"""The sphere's centre lies beyond the light plane, seen from the camera: the lit arc faces the camera."""

_ACROSS_M = 0.024  # the sphere's centre from the camera's axis, to either side, as far as its arc is seen
_DEPTH_M = 0.024  # and from the working distance along the light
_ARC = np.array([[np.sin(a), 0, -np.cos(a)] for a in np.radians([-70, -35, 0, 35, 70])])  # what a good fit needs to see
_ARC_MARGIN_M = 0.003  # the mount may be off the drawing by as much
_OFF_PLANE = (0.40, 0.70)  # |y| over the radius: above 1/4 sigma_y is sound; the mount may be 2 to 3 mm off the drawing
CALIBRATING = Spread(tilt_rad=np.radians(25), turn_rad=np.radians(40))
"""Wide enough to tell rotation from translation."""
WORKING = Spread(tilt_rad=np.radians(15), turn_rad=np.radians(30))
"""As far as a torch leans and turns from its course along a seam."""


@dataclass(frozen=True, kw_only=True)
class SphereSight:
    """A view of the sphere and the centre found in it."""

    joints_rad: Float[np.ndarray, "6"]
    """Joint readings from which it was taken."""
    T_base_flange: RigidTransform
    """As reported."""
    profile: SphereSightProblem
    """The profile in which the sphere was looked for."""
    centre: SphereSightResult

    @property
    def arc_camera(self) -> Float[np.ndarray, "k 3"]:
        """The profile's points on the sphere (m)."""
        return self.profile.points_camera[self.centre.inliers]


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    joints_rad: Float[np.ndarray, "6"]
    T_base_flange: RigidTransform
    centre_camera: Float[np.ndarray, "3"]


def plan_translations(station: Station, centre_base: Float[np.ndarray, "3"], count: int) -> list[np.ndarray]:
    """Postures with the working orientation that see the sphere from places spread over all three axes."""
    rng = generator(station.seed, "plan/translations")
    working = station.rotation_base_flange(station.heading_rad)
    candidates = _candidates(station, centre_base, count, rng, lambda: working)
    return _choose(station, candidates, count, translation_candidates)


def plan_free(
    station: Station, centre_base: Float[np.ndarray, "3"], count: int, spread: Spread, stage: str
) -> list[np.ndarray]:
    """Postures with varied orientations that see the sphere; all six joints move.

    No more of them than the wanted accuracy takes, where one is asked for.
    """
    rng = generator(station.seed, f"plan/{stage}")

    def orientation() -> Rotation:
        heading_rad = station.heading_rad + spread.turn_rad * rng.uniform(-1, 1)
        return station.rotation_base_flange(heading_rad, spread.tilt_rad * rng.uniform(), rng.uniform(0, 2 * np.pi))

    candidates = _candidates(station, centre_base, count, rng, orientation)
    wanted_m = 1e-3 * station.config.calibration.wanted_shift_mm
    if wanted_m == 0:
        return _choose(station, candidates, count, sight_candidates)
    planned = design(
        PoseDesignProblem(
            T_base_flange=RigidTransform.concatenate([candidate.T_base_flange for candidate in candidates]),
            centres_camera=np.array([candidate.centre_camera for candidate in candidates]),
            T_flange_camera=station.head.T_flange_camera,
            pose_sigma_m=1e-3 * station.config.calibration.robot_sigma_mm,
            most=count,
            wanted_shift_m=wanted_m,
        )
    )
    enough = planned.enough or count
    predicted_mm = 1e3 * planned.shift_sigma_m[enough - 1]
    station.note(planned.reason or f"{stage}: {enough} views are enough for {predicted_mm:.3g} mm (predicted)")
    return [candidates[k].joints_rad for k in planned.order[:enough]]


def take_sights(
    station: Station,
    postures: Sequence[Float[np.ndarray, "6"]],
    T_flange_camera: RigidTransform,
    stage: str,
    title: str,
) -> list[SphereSight]:
    """The views from these postures, in turn; views in which no sphere was found are left out.

    `T_flange_camera` places the profiles in the recording, nothing more.
    """
    sights = []
    for index, joints_rad in enumerate(station.progress.track(postures, title)):
        station.go(joints_rad)
        sight = station.see(stage, index)
        profile = SphereSightProblem(
            points_camera=sight.profile.points_camera[sight.profile.valid],
            sigma_m=sight.profile.sigma_m[sight.profile.valid],
            plane=station.belief.plane,
            radius_m=station.parts.sphere_radius_m,
            side=SIDE,
        )
        centre = solve_sphere_sight(profile)
        station.log_sight(sight, T_flange_camera)
        if not centre.valid:
            station.note(f"{stage}, view {index + 1}: no sphere, {centre.reason}")
            continue
        T_base_flange = sight.shot.T_base_flange
        seen = SphereSight(joints_rad=sight.joints_rad, T_base_flange=T_base_flange, profile=profile, centre=centre)
        sights.append(seen)
    return sights


def flanges_of(sights: Sequence[SphereSight], alignment: Alignment) -> RigidTransform:
    """Where the flange was in these views (a stack)."""
    reported = RigidTransform.concatenate([seen.T_base_flange for seen in sights])
    return alignment.flanges(np.array([seen.joints_rad for seen in sights]), reported)


def centres_base(station: Station, sights: Sequence[SphereSight], alignment: Alignment) -> Float[np.ndarray, "n 3"]:
    """Where these views put the sphere's centre (m)."""
    centres = np.array([_centre_camera(station, seen, alignment) for seen in sights])
    return (flanges_of(sights, alignment) * alignment.T_flange_camera).apply(centres)


def _centre_camera(station: Station, seen: SphereSight, alignment: Alignment) -> Float[np.ndarray, "3"]:
    if not alignment.sensor.any():
        return seen.centre.centre_camera
    points_camera = alignment.corrected(seen.profile.points_camera, station.belief)
    plane = alignment.corrected_belief(station.belief).plane
    centre = solve_sphere_sight(replace(seen.profile, points_camera=points_camera, plane=plane))
    return centre.centre_camera if centre.valid else seen.centre.centre_camera


def _choose(
    station: Station, candidates: list[_Candidate], count: int, jacobians_of: Callable[..., np.ndarray]
) -> list[np.ndarray]:
    """The postures that together see the parameters best."""
    jacobians = jacobians_of(
        RigidTransform.concatenate([candidate.T_base_flange for candidate in candidates]),
        station.head.T_flange_camera,
        np.array([candidate.centre_camera for candidate in candidates]),
        1e-3 * station.config.sensor.working_distance_mm,
    )
    return [candidates[k].joints_rad for k in choose(jacobians, count)]


def _candidates(
    station: Station,
    centre_base: Float[np.ndarray, "3"],
    count: int,
    rng: np.random.Generator,
    orientation: Callable[[], Rotation],
) -> list[_Candidate]:
    """Random postures that see the sphere and are clear of everything, several times `count`."""
    return gathered(lambda: _candidate(station, centre_base, orientation(), rng), count, "sphere")


def _candidate(
    station: Station, centre_base: Float[np.ndarray, "3"], rotation_base_flange: Rotation, rng: np.random.Generator
) -> _Candidate | None:
    centre_camera = _centre_in_view(station, rng)
    if centre_camera is None:
        return None
    T_base_flange = flange_at(centre_base, rotation_base_flange, station.head.T_flange_camera.apply(centre_camera))
    try:
        joints_rad = station.controller.inverse(T_base_flange, station.planner.home_rad)
    except OutOfReach:
        return None
    if not station.planner.working(joints_rad):
        return None
    return _Candidate(joints_rad=joints_rad, T_base_flange=T_base_flange, centre_camera=centre_camera)


def _centre_in_view(station: Station, rng: np.random.Generator) -> Float[np.ndarray, "3"] | None:
    """A place of the sphere's centre in the camera frame that gives a good arc; None if this draw gives none."""
    T_camera_laser = station.belief.plane.T_camera_laser
    crossing_laser = T_camera_laser.inv().apply([0, 0, station.head.stand_off_m])
    across, _, depth = crossing_laser + rng.uniform(-1, 1, 3) * [_ACROSS_M, 0, _DEPTH_M]
    off_plane = -SIDE * rng.uniform(*_OFF_PLANE) * station.parts.sphere_radius_m
    outer_m = np.sqrt(station.parts.sphere_radius_m**2 - off_plane**2) + _ARC_MARGIN_M
    arc_laser = np.array([across, 0, depth]) + outer_m * _ARC
    good = lit_and_in_picture(station, T_camera_laser.apply(arc_laser))
    return T_camera_laser.apply([across, off_plane, depth]) if good else None


def lit_and_in_picture(station: Station, points_camera: Float[np.ndarray, "n 3"]) -> bool:
    """Whether points of the light plane lie in the picture and within the fan."""
    crossing_camera = np.array([0, 0, station.head.stand_off_m])
    light = (crossing_camera - station.head.source_camera) / station.head.laser_range_m
    rays = points_camera - station.head.source_camera
    half_fan_rad = np.radians(station.config.sensor.laser_fan_deg / 2)
    lit = rays @ light > np.cos(half_fan_rad) * np.linalg.norm(rays, axis=1)
    camera = station.belief.camera
    return bool(np.all(lit & camera.in_picture(camera.project(points_camera))))

"""Observations fabricated from a known truth, without the simulator: no mesh, no picture, no robot model."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.frames import axes_rotation, rigid_from
from weldcell.cell.optics import LaserPlane

SPHERE_RADIUS_M = 0.020
TIP_RADIUS_M = 0.0006
SPHERE_BASE = np.array([0.930, 0.0, 0.430])
TIP_FLANGE = np.array([-0.0688, 0.0, 0.3183])
PLANE = LaserPlane(normal_camera=np.array([0.0, -1.0, 1.0]) / np.sqrt(2), offset_m=0.275 / np.sqrt(2))


def torch_on_flange() -> RigidTransform:
    """T_flange_torch of the nominal mounting: a neck bent by 35 degrees."""
    bend = np.deg2rad(35)
    x, z = np.array([np.cos(bend), 0, np.sin(bend)]), np.array([-np.sin(bend), 0, np.cos(bend)])
    return rigid_from(axes_rotation(x, z), TIP_FLANGE)


def camera_on_flange() -> RigidTransform:
    """T_flange_camera of the nominal mounting: the camera's axis meets the light 60 mm ahead of the tip."""
    columns = np.column_stack([[0, -1, 0], np.array([1, 0, 1]) / np.sqrt(2), np.array([-1, 0, 1]) / np.sqrt(2)])
    rotation = Rotation.from_matrix(columns)
    return torch_on_flange() * rigid_from(rotation, np.array([0.060 + 0.1945, 0.0, -0.1945]))


def torch_down() -> Rotation:
    """R_base_flange at which the torch points straight down and its travel direction is the base's x."""
    return Rotation.from_euler("x", 180, degrees=True) * torch_on_flange().rotation.inv()


@dataclass(frozen=True, kw_only=True)
class Sights:
    """A fixed target seen from a camera on the flange."""

    T_base_flange: RigidTransform
    centres_camera: np.ndarray
    translations: np.ndarray
    target_base: np.ndarray
    T_flange_camera: RigidTransform


def sights(
    rng: np.random.Generator,
    *,
    translations: int = 10,
    free: int = 10,
    spread_m: float = 0.020,
    tilt_deg: float = 30.0,
    target_base: np.ndarray = SPHERE_BASE,
    T_flange_camera: RigidTransform | None = None,
) -> Sights:
    """Exact sights: some from one orientation, some from free ones, the target within the sensor's field."""
    T_flange_camera = camera_on_flange() if T_flange_camera is None else T_flange_camera
    count = translations + free
    group = np.arange(count) < translations
    tilts = rng.uniform(-1, 1, (count, 3)) * np.deg2rad(tilt_deg)
    tilts[group] = 0.0
    R_base_camera = Rotation.from_rotvec(tilts) * torch_down() * T_flange_camera.rotation
    centres_camera = np.array([0.0, 0.0, 0.275]) + rng.uniform(-1, 1, (count, 3)) * np.sqrt(3) * spread_m
    T_base_camera = rigid_from(R_base_camera, target_base - R_base_camera.apply(centres_camera))
    return Sights(
        T_base_flange=T_base_camera * T_flange_camera.inv(),
        centres_camera=centres_camera,
        translations=group,
        target_base=target_base,
        T_flange_camera=T_flange_camera,
    )


def touch_poses(
    rng: np.random.Generator,
    count: int = 60,
    *,
    tip_flange: np.ndarray = TIP_FLANGE,
    centre_base: np.ndarray = SPHERE_BASE,
    tilt_deg: float = 30.0,
    yaw_deg: float = 0.0,
    lowest_deg: float = 0.0,
) -> RigidTransform:
    """Flange poses at which the tip touches the sphere exactly, all over it above a latitude."""
    height = rng.uniform(np.sin(np.deg2rad(lowest_deg)), 1, count)
    longitude = rng.uniform(0, 2 * np.pi, count)
    flat = np.sqrt(1 - height**2)
    outward = np.column_stack([flat * np.cos(longitude), flat * np.sin(longitude), height])
    tips_base = centre_base + (SPHERE_RADIUS_M + TIP_RADIUS_M) * outward
    tilts = rng.uniform(-1, 1, (count, 3)) * np.deg2rad(tilt_deg)
    R_base_flange = Rotation.from_rotvec(tilts) * Rotation.from_euler("z", yaw_deg, degrees=True) * torch_down()
    return rigid_from(R_base_flange, tips_base - R_base_flange.apply(tip_flange))


def moved(T_base_flange: RigidTransform, rng: np.random.Generator, sigma_m: float) -> RigidTransform:
    """The poses displaced at random, each axis by sigma: the robot's repeatability."""
    noise = rng.normal(0, sigma_m, (len(T_base_flange), 3))
    return rigid_from(T_base_flange.rotation, T_base_flange.translation + noise)


def arc(
    height_m: float,
    *,
    centre_section: tuple[float, float] = (0.003, 0.0),
    radius_m: float = SPHERE_RADIUS_M,
    half_arc_deg: float = 60.0,
    count: int = 700,
    side: int = 1,
    plane: LaserPlane = PLANE,
) -> tuple[np.ndarray, np.ndarray]:
    """Points of the sphere's section in the light plane, and the sphere's centre, both in the camera.

    `height_m` is the centre's distance from the plane; the arc faces the light, evenly spaced across it.
    """
    section_radius_m = np.sqrt(radius_m**2 - height_m**2)
    across = np.linspace(-1, 1, count) * np.sin(np.deg2rad(half_arc_deg)) * section_radius_m
    depth = -np.sqrt(section_radius_m**2 - across**2)
    x, z = centre_section
    points_laser = np.column_stack([x + across, np.zeros(count), z + depth])
    centre_laser = np.array([x, -side * height_m, z])
    return plane.T_camera_laser.apply(points_laser), plane.T_camera_laser.apply(centre_laser)


@dataclass(frozen=True, kw_only=True)
class BoardSights:
    """A fixed board seen from a camera on the flange."""

    T_base_flange: RigidTransform
    T_camera_board: RigidTransform
    T_flange_camera: RigidTransform
    T_base_board: RigidTransform


def board_sights(
    rng: np.random.Generator,
    count: int = 12,
    *,
    tilt_deg: float = 30.0,
    turn_sigma_rad: float = 0.0,
    shift_sigma_m: float = 0.0,
    T_flange_camera: RigidTransform | None = None,
) -> BoardSights:
    """A board 0.3 m before the camera, which looks down on it from leaning poses; noise on the boards' poses."""
    T_flange_camera = camera_on_flange() if T_flange_camera is None else T_flange_camera
    T_base_board = rigid_from(Rotation.from_rotvec([0.1, 0.2, 0.3]), np.array([0.9, 0.0, 0.4]))
    tilts = Rotation.from_rotvec(rng.uniform(-1, 1, (count, 3)) * np.deg2rad(tilt_deg))
    R_base_camera = tilts * Rotation.from_euler("x", 180, degrees=True)
    seen_camera = np.array([0.0, 0.0, 0.3]) + rng.uniform(-0.03, 0.03, (count, 3))
    T_base_camera = rigid_from(R_base_camera, T_base_board.translation - R_base_camera.apply(seen_camera))
    exact = T_base_camera.inv() * T_base_board
    turned = Rotation.from_rotvec(rng.normal(0, turn_sigma_rad, (count, 3))) * exact.rotation
    return BoardSights(
        T_base_flange=T_base_camera * T_flange_camera.inv(),
        T_camera_board=rigid_from(turned, exact.translation + rng.normal(0, shift_sigma_m, (count, 3))),
        T_flange_camera=T_flange_camera,
        T_base_board=T_base_board,
    )


def pivot_poses(
    rng: np.random.Generator,
    count: int = 8,
    *,
    tip_flange: np.ndarray = TIP_FLANGE,
    point_base: np.ndarray = SPHERE_BASE,
    tilt_deg: float = 40.0,
) -> RigidTransform:
    """Flange poses in which the tip is at one point exactly."""
    tilts = rng.uniform(-1, 1, (count, 3)) * np.deg2rad(tilt_deg)
    R_base_flange = Rotation.from_rotvec(tilts) * torch_down()
    return rigid_from(R_base_flange, point_base - R_base_flange.apply(tip_flange))

"""The boss scanned in one pass, cut into planes, and measured."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import JobFailed
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.scanning import ScanPath, scan
from weldcell.scenarios.station import Sight, Station
from weldcell.scenarios.torch_poses import torch_rotation
from weldcell.tracking.boss import BossMeasure, measure_boss
from weldcell.tracking.planes import fit_planes

_MARGIN_M = 0.012  # of the base slab that is scanned before and behind the slopes
_LEAN_RAD = np.radians(25)  # camera 20 deg and light 25 deg off the vertical: neither passes under a slope of 53 deg
_TIP_ABOVE_M = 0.013  # the boss: the leaning torch passes clear of it
_CELL_M = 1e-3  # of the cloud's grid; never finer than the scan lines
_COLUMN_STEP = 2  # every other column: neighbouring stripe centres share their blur, so little is lost


def scan_boss(station: Station, alignment: Alignment) -> BossMeasure:
    """The boss measured from its planes; raises JobFailed if they were not found.

    The torch leans, for upright the camera, which looks back, would not see the slope that faces away. (Two passes from
    two sides would see it, but the robot errs otherwise in each, and the faces seen twice would not agree.)
    """
    station.begin("boss", "Boss")
    station.place_boss()
    path = _path(station)
    cloud = []
    for sight in scan(station, path, "boss"):
        station.log_sight(sight, alignment.T_flange_camera)
        cloud.append(_points_base(station, sight, alignment))
    spacing_m = float(np.linalg.norm(path.points_base[1] - path.points_base[0]))
    measure = measure_boss(fit_planes(np.concatenate(cloud), cell_m=max(_CELL_M, spacing_m)))
    if not measure.valid:
        raise JobFailed(f"boss: {measure.reason}")
    return measure


def boss_metrics(station: Station, measure: BossMeasure) -> dict[str, float]:
    """Mean errors of the four slanted edges and of the four dihedral angles."""
    config = station.config.boss
    edges_mm = 1e3 * measure.edge_lengths_m - config.slant_edge_mm
    angles_deg = np.degrees(measure.dihedral_angles_rad) - config.slope_deg
    ring = np.arange(5) % 4
    edges = {f"edge {k + 1}": np.stack([measure.base_corners[k], measure.top_corners[k]]) for k in range(4)}
    rings = {"top": measure.top_corners[ring], "base": measure.base_corners[ring]}
    station.recording.log_lines("measured", edges | rings, frame=station.frame, time_s=station.time_s)
    return {
        "boss_edge_mean_error_mm": float(np.abs(edges_mm).mean()),
        "boss_angle_mean_error_deg": float(np.abs(angles_deg).mean()),
    }


def _path(station: Station) -> ScanPath:
    """A straight pass over the middle of the boss, where the controller was told it lies."""
    config, corners = station.config.boss, station.parts.boss.corners_part
    half_m = float(np.abs(corners["foot"][:, :2]).max()) + _MARGIN_M
    top_m, foot_m = float(corners["top"][0, 2]), float(corners["foot"][0, 2])
    head = station.head
    tip_below_m = head.look_ahead_m * np.sin(_LEAN_RAD) - head.below_tip_m * np.cos(_LEAN_RAD)  # the crossing
    crossing_m = top_m + _TIP_ABOVE_M + tip_below_m
    ahead_m = (crossing_m - foot_m) * np.tan(_LEAN_RAD)  # so far on the leaning light meets the base
    centre_base = station.planner.known_cell.T_base_part("boss").translation
    forward = np.array([np.cos(station.heading_rad), np.sin(station.heading_rad), 0.0])
    leaning = torch_rotation(station.heading_rad, _LEAN_RAD, station.heading_rad - np.pi / 2)
    along_m = np.linspace(-half_m, half_m, config.frames) - ahead_m
    return ScanPath(
        points_base=centre_base + [0, 0, crossing_m] + along_m[:, None] * forward,
        torch_rotations=Rotation.concatenate([leaning] * config.frames),
        speed_m_s=1e-3 * config.speed_mm_s,
    )


def _points_base(station: Station, sight: Sight, alignment: Alignment) -> Float[np.ndarray, "n 3"]:
    reported = RigidTransform.concatenate([sight.shot.T_base_flange])
    T_base_camera = alignment.flanges(sight.joints_rad[None], reported)[0] * alignment.T_flange_camera
    points_camera = sight.profile.points_camera[sight.profile.valid][::_COLUMN_STEP]
    return T_base_camera.apply(alignment.corrected(points_camera, station.belief))

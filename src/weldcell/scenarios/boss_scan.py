"""The boss scanned from two opposite sides, cut into planes, and measured."""

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import JobFailed
from weldcell.scenarios.scanning import ScanPath, scan
from weldcell.scenarios.seam_tracking import CROSSING_ABOVE_M
from weldcell.scenarios.station import Sight, Station
from weldcell.scenarios.verification import Alignment
from weldcell.tracking.boss import BossMeasure, measure_boss
from weldcell.tracking.planes import fit_planes

_MARGIN_M = 0.012  # of the base slab that is scanned before and behind the slopes
_CELL_M = 1e-3  # of the cloud's grid; never finer than the scan lines
_COLUMN_STEP = 2  # every other column: neighbouring stripe centres share their blur, so little is lost


def scan_boss(station: Station, alignment: Alignment) -> BossMeasure:
    """The boss measured from its planes; raises JobFailed if they were not found.

    The camera looks against the direction of travel, so that one pass does not see the slope that faces away:
    the second pass comes from the other side.
    """
    station.begin("boss", "Boss")
    station.place_boss()
    frames = station.config.boss.frames
    cloud = []
    for number, (heading_rad, count) in enumerate(
        ((station.heading_rad, frames - frames // 2), (station.heading_rad - np.pi, frames // 2))
    ):
        path = _path(station, heading_rad, count)
        for sight in scan(station, path, "boss", first_index=number * frames):
            station.log_sight(sight, alignment.T_flange_camera)
            cloud.append(_points_base(sight, alignment))
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


def _path(station: Station, heading_rad: float, count: int) -> ScanPath:
    """A straight pass over the middle of the boss, where the controller was told it lies."""
    corners = station.parts.boss.corners_part
    half_m = float(np.abs(corners["foot"][:, :2]).max()) + _MARGIN_M
    top_m = float(corners["top"][0, 2])
    centre_base = station.planner.known_cell.T_base_part("boss").translation
    forward = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    along_m = np.linspace(-half_m, half_m, count)
    return ScanPath(
        points_base=centre_base + [0, 0, top_m + CROSSING_ABOVE_M] + along_m[:, None] * forward,
        headings_rad=np.full(count, heading_rad),
        speed_m_s=1e-3 * station.config.boss.speed_mm_s,
    )


def _points_base(sight: Sight, alignment: Alignment) -> Float[np.ndarray, "n 3"]:
    T_base_camera = sight.shot.T_base_flange * alignment.T_flange_camera
    points_camera = sight.profile.points_camera[sight.profile.valid]
    return T_base_camera.apply(points_camera[::_COLUMN_STEP])

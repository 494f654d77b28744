"""The V-groove scanned along its taught path, its seam fitted, and the fit compared with the exact one."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import JobFailed
from weldcell.cell.profile import JointFeatures
from weldcell.cell.randomness import generator
from weldcell.cell.seam import Seam, distance_to_polyline
from weldcell.scenarios.scanning import ScanPath, scan
from weldcell.scenarios.station import Station
from weldcell.scenarios.verification import Alignment
from weldcell.tracking.joint import find_joint
from weldcell.tracking.seam_fit import fit_seam

FEATURES = ("left", "root", "right")

_END_MARGIN_M = 0.015  # at the ends the section, square to the slanting path, would miss the plate's corners


@dataclass(frozen=True, kw_only=True)
class TrackedSeam:
    """A scanned seam."""

    T_base_flange: RigidTransform
    """Stack of n reported flange poses, one a frame."""
    points_base: dict[str, Float[np.ndarray, "n 3"]]
    """Features measured in each frame, NaN where not found."""
    valid: Bool[np.ndarray, "n"]
    seam: Seam
    """The fitted seam in the base, sampled at the frames."""


def track_seam(station: Station, alignment: Alignment) -> TrackedSeam:
    """Scans the plate and fits its seam; raises JobFailed if the seam was not found."""
    station.place_plate()
    T_base_flange, found = [], []
    previous: JointFeatures | None = None
    for sight in scan(station, taught_path(station), "seam"):
        joint = find_joint(sight.profile, "v", station.belief.plane, previous)
        previous = joint if joint.valid else previous
        station.logbook.joint(sight, joint, alignment.T_flange_camera)
        T_base_flange.append(sight.shot.T_base_flange)
        found.append(joint)
    flanges = RigidTransform.concatenate(T_base_flange)
    T_base_camera = flanges * alignment.T_flange_camera
    points = np.stack([joint.points_camera for joint in found], axis=1)
    points_base = {name: T_base_camera.apply(points[k]) for k, name in enumerate(FEATURES)}
    valid = np.array([joint.valid for joint in found])
    if valid.sum() < len(valid) / 2:
        raise JobFailed(f"seam: found in {valid.sum()} of {len(valid)} frames only; last reason: {found[-1].reason}")
    return TrackedSeam(
        T_base_flange=flanges, points_base=points_base, valid=valid, seam=fit_seam(points_base, valid)
    )


def taught_path(station: Station) -> ScanPath:
    """The seam's centre line as drawn, on the plate as the controller was told it lies."""
    config, plate = station.config.seam, station.parts.plate
    T_base_part = station.planner.known_cell.T_base_part("plate")
    line = plate.centre_line_part(config.frames, _END_MARGIN_M)
    points_base = T_base_part.apply(line)
    steps = np.gradient(points_base, axis=0)
    points_base[:, 2] += station.scan_height_m
    return ScanPath(
        points_base=points_base,
        headings_rad=np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])),
        speed_m_s=1e-3 * config.speed_mm_s,
    )


def seam_metrics(station: Station, tracked: TrackedSeam, alignment: Alignment) -> dict[str, float]:
    """Torch errors of the fitted seam against the exact one, over all frames."""
    metrics: dict[str, float] = {
        "frames_count": len(tracked.valid),
        "frames_valid_count": int(tracked.valid.sum()),
    }
    exact = exact_seam_base(station)
    for name in FEATURES:
        errors_m = distance_to_polyline(_tips_base(station, tracked, alignment, name), exact[name])
        station.logbook.seam_errors(name, errors_m)
        metrics[f"seam_{name}_mean_error_mm"] = 1e3 * float(errors_m.mean())
        metrics[f"seam_{name}_max_error_mm"] = 1e3 * float(errors_m.max())
    return metrics


def exact_seam_base(station: Station) -> dict[str, Float[np.ndarray, "m 3"]]:
    """The exact feature lines where the plate actually lies."""
    T_base_part = station.cell.T_base_part("plate")
    return {name: T_base_part.apply(line) for name, line in station.parts.plate.seam.points.items()}


def _tips_base(station: Station, tracked: TrackedSeam, alignment: Alignment, name: str) -> Float[np.ndarray, "n 3"]:
    """Where the actual tip goes when it is sent along one line of the fitted seam."""
    tips = []
    for index, point_base in enumerate(tracked.seam.points[name]):
        rng = generator(station.seed, f"seam/send/{name}", index)
        rotation = tracked.T_base_flange[index].rotation
        tips.append(station.send_torch(point_base, rotation, alignment.tip_flange, rng))
    return np.array(tips)

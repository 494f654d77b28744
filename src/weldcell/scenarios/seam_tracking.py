"""A seam scanned along its taught path, fitted, and compared with the exact one: sensor alone, and torch."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import JobFailed
from weldcell.cell.randomness import generator
from weldcell.cell.seam import Seam, distance_to_polyline
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.scanning import ScanPath, first_carried, scan
from weldcell.scenarios.seam_view import view_paths
from weldcell.scenarios.station import Sight, Station
from weldcell.tracking.joint import JOINT_KINDS
from weldcell.tracking.joint_follower import SEARCH_M, JointFollower
from weldcell.tracking.seam_fit import fit_seam


@dataclass(frozen=True, kw_only=True)
class TrackedSeam:
    """A scanned seam."""

    frames: Int[np.ndarray, "n"]
    """Numbers of the pictures."""
    times_s: Float[np.ndarray, "n"]
    """When they were taken."""
    T_base_flange: RigidTransform
    """Stack of n flange poses, one a frame, as far as the arm is known."""
    points_camera: dict[str, Float[np.ndarray, "n 3"]]
    """Features measured in each frame, NaN where not found."""
    T_base_camera_actual: RigidTransform
    """Stack of n poses where the camera really was: for comparison only."""
    points_base: dict[str, Float[np.ndarray, "n 3"]]
    """The same placed by hand-eye transform and arm."""
    valid: Bool[np.ndarray, "n"]
    seam: Seam
    """The fitted seam in the base, sampled at the frames."""


def track_seam(
    station: Station,
    alignment: Alignment,
    misplacement: RigidTransform | None = None,
    watch: Callable[[Sight], None] | None = None,
) -> TrackedSeam:
    """Scans the plate, which is off by so much (drawn unless given), and fits its seam.

    `watch` gets each sight once it is logged. Raises JobFailed if the seam was not found.
    """
    station.begin("seam", "Seam")
    station.place_plate(misplacement)
    frames, times_s, joints_rad, T_base_flange, cameras, found = [], [], [], [], [], []
    kind = joint_kind(station)
    follower = JointFollower(kind, station.belief.plane, search_m=SEARCH_M)
    for sight in scan(station, taught_path(station), "seam"):
        joint = follower.find(sight.profile)
        station.log_sight(sight, alignment.T_flange_camera, joint)
        if watch is not None:
            watch(sight)
        frames.append(sight.frame)
        times_s.append(sight.shot.time_s)
        joints_rad.append(sight.joints_rad)
        T_base_flange.append(sight.shot.T_base_flange)
        cameras.append(station.cell.T_base("camera"))
        found.append(joint)
    flanges = alignment.flanges(np.array(joints_rad), RigidTransform.concatenate(T_base_flange))
    T_base_camera = flanges * alignment.T_flange_camera
    names = JOINT_KINDS[kind].names
    seen = np.stack([joint.points_camera for joint in found], axis=1)
    points = alignment.corrected(seen, station.belief)
    points_base = {name: T_base_camera.apply(points[k]) for k, name in enumerate(names)}
    sigma_m = {name: np.array([joint.sigma_m[k] for joint in found]) for k, name in enumerate(names)}
    valid = np.array([joint.valid for joint in found])
    if valid.sum() < len(valid) / 2:
        raise JobFailed(f"seam: found in {valid.sum()} of {len(valid)} frames only; last reason: {found[-1].reason}")
    return TrackedSeam(
        frames=np.array(frames),
        times_s=np.array(times_s),
        T_base_flange=flanges,
        points_camera=dict(zip(names, points, strict=True)),
        T_base_camera_actual=RigidTransform.concatenate(cameras),
        points_base=points_base,
        valid=valid,
        seam=_sampled(fit_seam(points_base, sigma_m=sigma_m), len(valid)),
    )


def joint_kind(station: Station) -> str:
    """What to look for: the configuration's joint, a V with a gap if it has one."""
    seam = station.config.seam
    gapped = max(seam.root_gap_mm, seam.root_gap_end_mm) > 0
    return "v-gap" if seam.joint == "v" and gapped else seam.joint


def taught_path(station: Station) -> ScanPath:
    """Along the seam as drawn, in the first view of it that the arm can take; raises OutOfReach if there is none."""
    return first_carried(station, view_paths(station), "seam")


def seam_metrics(station: Station, tracked: TrackedSeam, alignment: Alignment) -> dict[str, float]:
    """Torch errors of the fitted seam against the exact one over all frames, and the sensor's own in single frames."""
    exact = exact_seam_base(station)
    names = [name for name in tracked.points_base if name in exact]
    errors_mm = {}
    for name in names:
        tips_base = tips_along(station, tracked, alignment, tracked.seam.points[name], name)
        errors_mm[name] = 1e3 * distance_to_polyline(tips_base, exact[name])
    for kind, lines in (("true", exact), ("measured", tracked.seam.points)):
        station.recording.log_lines(kind, lines, frame=station.frame, time_s=station.time_s)
    station.recording.log_errors(tracked.frames, tracked.times_s, errors_mm)
    metrics = {"frames_count": float(len(tracked.valid)), "frames_valid_count": float(tracked.valid.sum())}
    for name, errors in errors_mm.items():
        metrics[f"seam_{name}_mean_error_mm"] = float(errors.mean())
        metrics[f"seam_{name}_max_error_mm"] = float(errors.max())
    for name in names:
        seen_base = tracked.T_base_camera_actual.apply(tracked.points_camera[name])[tracked.valid]
        errors = 1e3 * distance_to_polyline(seen_base, exact[name])
        metrics[f"seam_{name}_sensor_mean_error_mm"] = float(errors.mean())
        metrics[f"seam_{name}_sensor_max_error_mm"] = float(errors.max())
    return metrics


def exact_seam_base(station: Station) -> dict[str, Float[np.ndarray, "m 3"]]:
    """The exact feature lines where the plate actually lies."""
    T_base_part, seam_part = station.cell.T_base_part("plate"), station.parts.plate.seam_part
    assert seam_part is not None
    return {name: T_base_part.apply(line) for name, line in seam_part.points.items()}


def tips_along(
    station: Station, tracked: TrackedSeam, alignment: Alignment, line_base: Float[np.ndarray, "n 3"], name: str
) -> Float[np.ndarray, "n 3"]:
    """Where the actual tip goes when it is sent along a line, each point with the flange turned as in its frame.

    `name` tells this line's repeatability errors from those of others.
    """
    tips = []
    for index, point_base in enumerate(line_base):
        rng = generator(station.seed, f"seam/send/{name}", index)
        rotation = tracked.T_base_flange[index].rotation
        tips.append(station.send_torch(point_base, rotation, alignment.tip_flange, rng, alignment.arm))
    return np.array(tips)


def _sampled(seam: Seam, count: int) -> Seam:
    """The seam at this many even steps of its arc length."""
    arc_length_m = np.linspace(seam.arc_length_m[0], seam.arc_length_m[-1], count)
    return Seam(arc_length_m=arc_length_m, points={name: seam.at(name, arc_length_m) for name in seam.points})

"""Scans: the sensor carried along a line, one picture after the other."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import OutOfReach
from weldcell.cell.world.motion import Motion
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.station import Sight, Station
from weldcell.scenarios.torch_poses import flange_at

_LARGEST_STEP_RAD = 0.6  # between two pictures; more means that the arm changed its configuration


@dataclass(frozen=True, kw_only=True)
class ScanPath:
    """Where the light plane meets the camera's axis for each picture, and how the torch is turned."""

    points_base: Float[np.ndarray, "n 3"]
    """The crossing, m."""
    torch_rotations: Rotation
    """R_base_torch for each picture: the torch's x is where it travels, its z along the wire (and the light)."""
    speed_m_s: float

    @property
    def times_s(self) -> Float[np.ndarray, "n"]:
        """When each picture is taken, from the first one on."""
        steps_m = np.linalg.norm(np.diff(self.points_base, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps_m)]) / self.speed_m_s


def scan(station: Station, path: ScanPath, stage: str) -> Iterator[Sight]:
    """The pictures along a path, one by one; raises OutOfReach, before moving, if the arm cannot follow it."""
    motion = _motion(station, path, stage)
    _require_speeds(station, motion)
    station.go(motion.joints_rad[0])
    start_s = station.time_s
    rates_rad_s = np.gradient(motion.joints_rad, motion.times_s, axis=0)
    for index in station.progress.track(range(len(motion.times_s)), f"scan {stage}"):
        station.stand_at(motion.joints_rad[index], start_s + motion.times_s[index])
        yield station.see(stage, index, rates_rad_s[index])


def _motion(station: Station, path: ScanPath, stage: str) -> Motion:
    rotations = path.torch_rotations * T_FLANGE_TORCH.rotation.inv()
    crossing_flange = station.head.crossing_flange
    along = zip(path.points_base, rotations, strict=True)
    poses = [flange_at(point_base, rotation, crossing_flange) for point_base, rotation in along]
    for start_rad in station.controller.all_inverse(poses[0]):
        joints_rad = _followed(station, poses, start_rad)
        if joints_rad is not None:
            return Motion(times_s=path.times_s, joints_rad=joints_rad)
    raise OutOfReach(
        f"{stage}: the arm cannot carry the sensor along the path within its limits and clear of the parts"
    )


def _require_speeds(station: Station, motion: Motion) -> None:
    """Refuses a scan that is faster than the arm's joints."""
    speeds = np.abs(np.diff(motion.joints_rad, axis=0)) / np.diff(motion.times_s)[:, None]
    share = float(np.max(speeds / station.controller.speeds_rad_s))
    if share > 1:
        raise OutOfReach(f"scan: the path takes {share:.1f} times the joints' largest speed, expected a slower scan")


def _followed(
    station: Station, poses: list[RigidTransform], start_rad: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "n 6"] | None:
    """Readings along all poses in one configuration of the arm, or None."""
    joints_rad = [start_rad]
    for T_base_flange in poses[1:]:
        try:
            joints_rad.append(station.controller.inverse(T_base_flange, joints_rad[-1]))
        except OutOfReach:
            return None
        if np.abs(joints_rad[-1] - joints_rad[-2]).max() > _LARGEST_STEP_RAD:
            return None
    return np.array(joints_rad) if all(station.planner.free(q) for q in joints_rad) else None

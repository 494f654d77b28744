"""Scans: the sensor carried along a line, one picture after the other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import OutOfReach
from weldcell.cell.seam import length_along
from weldcell.cell.world.motion import Motion, readings_along
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.station import Sight, Station
from weldcell.scenarios.torch_poses import flange_at

_FEW_POSES = 25
_BEYOND = "it is out of reach"
_TOO_CLOSE = "torch, head or arm would come too close to something"


@dataclass(frozen=True, kw_only=True)
class ScanPath:
    """Where the light plane meets the camera's axis for each picture, and how the torch is turned."""

    points_base: Float[np.ndarray, "n 3"]
    """The crossing, m."""
    torch_rotations: Rotation
    """R_base_torch for each picture: the torch's x is where it travels, its z along the wire (and the light)."""
    speed_m_s: float

    def thinned(self, count: int) -> "ScanPath":
        """About this many of its pictures, evenly, the first and the last among them."""
        few = np.unique(np.linspace(0, len(self.points_base) - 1, count).astype(int))
        return replace(self, points_base=self.points_base[few], torch_rotations=self.torch_rotations[few])

    @property
    def times_s(self) -> Float[np.ndarray, "n"]:
        """When each picture is taken, from the first one on."""
        return length_along(self.points_base) / self.speed_m_s


def scan(station: Station, path: ScanPath, stage: str) -> Iterator[Sight]:
    """The pictures along a path, one by one; raises OutOfReach, before moving, if the arm cannot follow it."""
    joints_rad = _readings(station, path)
    if joints_rad is None:
        raise OutOfReach(_refusal(station, path, stage))
    motion = Motion(times_s=path.times_s, joints_rad=joints_rad)
    _require_speeds(station, motion, stage)
    station.go(motion.joints_rad[0])
    start_s = station.time_s
    rates_rad_s = np.gradient(motion.joints_rad, motion.times_s, axis=0)
    for index in station.progress.track(range(len(motion.times_s)), f"scan {stage}"):
        station.stand_at(motion.joints_rad[index], start_s + motion.times_s[index])
        yield station.see(stage, index, rates_rad_s[index])


def first_carried(station: Station, paths: Sequence[ScanPath], stage: str) -> ScanPath:
    """The first of these ways to scan one line that the arm can follow; raises OutOfReach, for the first, if none."""
    for path in paths:
        looks = (
            [path.thinned(_FEW_POSES), path] if len(path.points_base) > _FEW_POSES else [path]
        )  # the cheap one first
        if all(_readings(station, look) is not None for look in looks):
            return path
    raise OutOfReach(_refusal(station, paths[0], stage))


def _readings(station: Station, path: ScanPath) -> Float[np.ndarray, "n 6"] | None:
    """Readings along a path in one configuration of the arm, clear of everything, or None."""
    T_base_flange = _flanges(station, path)
    for start_rad in _starts(station, T_base_flange):
        joints_rad = readings_along(station.controller, T_base_flange, start_rad)
        if joints_rad is not None and all(station.planner.free(q) for q in joints_rad):
            return joints_rad
    return None


def _flanges(station: Station, path: ScanPath) -> RigidTransform:
    """The flange's poses (stack) along a path."""
    rotations = path.torch_rotations * T_FLANGE_TORCH.rotation.inv()
    along = zip(path.points_base, rotations, strict=True)
    poses = [flange_at(point_base, rotation, station.head.crossing_flange) for point_base, rotation in along]
    return RigidTransform.concatenate(poses)


def _starts(station: Station, T_base_flange: RigidTransform) -> list[Float[np.ndarray, "6"]]:
    """Readings at the first pose, nearest to home first: an arm's errors are best known where it was calibrated."""
    starts = station.controller.all_inverse(T_base_flange[0])
    return sorted(starts, key=lambda q: float(np.abs(q - station.planner.home_rad).max()))


def _refusal(station: Station, path: ScanPath, stage: str) -> str:
    """How far the arm can follow a path at best, what is in the way there, and what helps."""
    path = path.thinned(_FEW_POSES)
    T_base_flange = _flanges(station, path)
    best: tuple[int, str] = (0, _BEYOND)
    for start_rad in _starts(station, T_base_flange):
        ways = (readings_along(station.controller, T_base_flange[:count], start_rad) for count in _counts(path))
        joints_rad = next(way for way in ways if way is not None)
        hits = [index for index, q in enumerate(joints_rad) if not station.planner.free(q)]
        best = max(best, (hits[0], _TOO_CLOSE) if hits else (len(joints_rad), _BEYOND))
    along_mm = 1e3 * path.speed_m_s * path.times_s
    where = f"after {along_mm[best[0] - 1]:.0f} of {along_mm[-1]:.0f} mm" if best[0] else "from its start"
    return (
        f"{stage}: the arm cannot carry the sensor along the path: {where} {best[1]}; turn the part "
        f"({stage}.yaw_deg), move it ({stage}.position_mm), or scan less of it"
    )


def _counts(path: ScanPath) -> range:
    return range(len(path.points_base), 0, -1)


def _require_speeds(station: Station, motion: Motion, stage: str) -> None:
    """Refuses a scan that is faster than the arm's joints."""
    speeds = np.abs(np.diff(motion.joints_rad, axis=0)) / np.diff(motion.times_s)[:, None]
    share = float(np.max(speeds / station.controller.speeds_rad_s))
    if share > 1:
        raise OutOfReach(
            f"{stage}: the path takes {share:.1f} times the joints' largest speed, expected a slower scan "
            f"({stage}.speed_mm_s)"
        )

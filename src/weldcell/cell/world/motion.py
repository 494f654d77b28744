"""Motion between poses: within joint limits and speeds, clear of the parts."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import translation
from weldcell.cell.world.cell import Cell
from weldcell.cell.world.controller import Controller

_CHECK_STEP_RAD = 0.03  # between two checked postures no point of the arm moves more than about 40 mm
_SPEED_SHARE = 0.4  # of the joints' largest speeds: an arm in a cell with people near does not run flat out
_PEAK_OVER_MEAN = 1.5  # of the cubic time law 3s^2 - 2s^3
_SAME_CONFIGURATION_RAD = np.radians(110)
_STRETCHED_WRIST_RAD = np.radians(20)
_LARGEST_STEP_RAD = 0.6  # between two poses of a path; more means that the arm changed its configuration
_RETREATS_M = (0.06, 0.12, 0.25)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Joint readings over time."""

    times_s: Float[np.ndarray, "n"]
    """Increasing, starting at 0."""
    joints_rad: Float[np.ndarray, "n 6"]
    """Readings at these times."""


def readings_along(
    controller: Controller, T_base_flange: RigidTransform, start_rad: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "n 6"] | None:
    """Readings along a stack of poses in one configuration of the arm, or None if it has to leave it or can't reach.

    `start_rad` takes the flange to the first pose.
    """
    joints_rad = [np.asarray(start_rad, float)]
    for index in range(1, len(T_base_flange)):
        try:
            joints_rad.append(controller.inverse(T_base_flange[index], joints_rad[-1]))
        except OutOfReach:
            return None
        if np.abs(joints_rad[-1] - joints_rad[-2]).max() > _LARGEST_STEP_RAD:
            return None
    return np.array(joints_rad)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionPlanner:
    """Finds motions on the cell as the controller knows it."""

    controller: Controller
    known_cell: Cell
    """The cell with nominal robot and parts where the controller was told they are."""
    home_rad: Float[np.ndarray, "6"]
    """A posture far from everything."""
    rate_hz: float = 10.0
    """Samples a second in the motions returned."""

    def free(self, joints_rad: Float[np.ndarray, "6"], work_clearance_m: float | None = None) -> bool:
        """Whether a posture is within limits and clear of the parts; at work, by less (see `Cell.collides`)."""
        low, high = self.controller.limits_rad.T
        within = bool(np.all(joints_rad >= low) and np.all(joints_rad <= high))
        return within and not self.known_cell.collides(joints_rad, work_clearance_m)

    def working(self, joints_rad: Float[np.ndarray, "6"]) -> bool:
        """Whether a posture is free, in the configuration of home (no joint far from it), and its wrist not stretched.

        Another configuration, or a wrist near its singularity, turns the same joint errors into other errors at the
        tool: no one calibrates across them.
        """
        turned = np.abs(joints_rad - self.home_rad).max() > _SAME_CONFIGURATION_RAD
        stretched = self.controller.wrist_sine(joints_rad) <= np.sin(_STRETCHED_WRIST_RAD)
        return not turned and not stretched and self.free(joints_rad)

    def move(self, start_rad: Float[np.ndarray, "6"], goal_rad: Float[np.ndarray, "6"]) -> Motion:
        """A motion from one posture to another; raises OutOfReach if no way clear of the parts is found."""
        for stops in self._routes(start_rad, goal_rad):
            if all(self._clear(a, b) for a, b in zip(stops[:-1], stops[1:], strict=True)):
                return self._timed(stops)
        raise OutOfReach("no path clear of the parts was found between two postures of the arm")

    def _routes(self, start_rad: Float[np.ndarray, "6"], goal_rad: Float[np.ndarray, "6"]) -> Iterator[list]:
        """Ways to try, the plainest first: direct, then by retreats at either end, then by way of home as well."""
        yield [start_rad, goal_rad]
        leaving = [[], *([q] for q in self._retreats(start_rad))]
        coming = [[], *([q] for q in self._retreats(goal_rad))]
        for middle in ([], [self.home_rad]):
            for leave, come in sorted(product(leaving, coming), key=lambda pair: len(pair[0]) + len(pair[1])):
                if leave or middle or come:
                    yield [start_rad, *leave, *middle, *come, goal_rad]

    def _retreats(self, joints_rad: Float[np.ndarray, "6"]) -> Iterator[Float[np.ndarray, "6"]]:
        """Free postures above, and behind along the flange's axis, that can be reached straight."""
        for distance_m in _RETREATS_M:
            for retreat in (self._lifted, self._backed):
                try:
                    off_rad = retreat(joints_rad, distance_m)
                except OutOfReach:
                    continue
                if self._clear(joints_rad, off_rad):
                    yield off_rad

    def _lifted(self, joints_rad: Float[np.ndarray, "6"], distance_m: float) -> Float[np.ndarray, "6"]:
        """The posture with the flange straight above."""
        T_base_flange = translation([0, 0, distance_m]) * self.controller.forward(joints_rad)
        return self.controller.inverse(T_base_flange, joints_rad)

    def _backed(self, joints_rad: Float[np.ndarray, "6"], distance_m: float) -> Float[np.ndarray, "6"]:
        """The posture with the flange drawn back along its own axis."""
        T_base_flange = self.controller.forward(joints_rad) * translation([0, 0, -distance_m])
        return self.controller.inverse(T_base_flange, joints_rad)

    def _clear(self, start_rad: Float[np.ndarray, "6"], goal_rad: Float[np.ndarray, "6"]) -> bool:
        count = int(np.ceil(np.abs(goal_rad - start_rad).max() / _CHECK_STEP_RAD)) + 1
        shares = np.linspace(0, 1, count)[1:]
        return all(self.free(start_rad + share * (goal_rad - start_rad)) for share in shares)

    def _timed(self, stops: list[Float[np.ndarray, "6"]]) -> Motion:
        times, joints, now = [0.0], [stops[0]], 0.0
        for a, b in zip(stops[:-1], stops[1:], strict=True):
            speeds = _SPEED_SHARE * self.controller.speeds_rad_s
            duration_s = max(float(_PEAK_OVER_MEAN * np.max(np.abs(b - a) / speeds)), 1e-3)
            count = max(2, int(np.ceil(duration_s * self.rate_hz)))
            share = np.linspace(0, 1, count + 1)[1:]
            times.extend(now + duration_s * share)
            joints.extend(a + (3 * share**2 - 2 * share**3)[:, None] * (b - a))
            now += duration_s
        return Motion(times_s=np.array(times), joints_rad=np.array(joints))

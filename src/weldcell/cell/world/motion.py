"""Motion between poses: within joint limits and speeds, clear of the parts."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import translation
from weldcell.cell.world.cell import Cell
from weldcell.cell.world.controller import Controller

_CHECK_STEP_RAD = 0.03  # between two checked postures no point of the arm moves more than about 40 mm
_SPEED_SHARE = 0.4  # of the joints' largest speeds: an arm in a cell with people near does not run flat out
_PEAK_OVER_MEAN = 1.5  # of the cubic time law 3s^2 - 2s^3
_LIFTS_M = (0.10, 0.20, 0.30)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Joint readings over time."""

    times_s: Float[np.ndarray, "n"]
    """Increasing, starting at 0."""
    joints_rad: Float[np.ndarray, "n 6"]
    """Readings at these times."""

    @property
    def duration_s(self) -> float:
        return float(self.times_s[-1])


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

    def free(self, joints_rad: Float[np.ndarray, "6"]) -> bool:
        """Whether a posture is within limits and clear of the parts."""
        low, high = self.controller.limits_rad.T
        within = bool(np.all(joints_rad >= low) and np.all(joints_rad <= high))
        return within and not self.known_cell.collides(joints_rad)

    def move(self, start_rad: Float[np.ndarray, "6"], goal_rad: Float[np.ndarray, "6"]) -> Motion:
        """A motion from one posture to another: direct, by lifting the tool first, or by way of home."""
        for stops in self._routes(start_rad, goal_rad):
            if all(self._clear(a, b) for a, b in zip(stops[:-1], stops[1:], strict=True)):
                return self._timed(stops)
        raise OutOfReach("no path clear of the parts was found between two postures of the arm")

    def _routes(self, start_rad: Float[np.ndarray, "6"], goal_rad: Float[np.ndarray, "6"]) -> list:
        routes = [[start_rad, goal_rad]]
        for lift_m in _LIFTS_M:
            try:
                up_start, up_goal = (self._lifted(q, lift_m) for q in (start_rad, goal_rad))
            except OutOfReach:
                continue
            routes.append([start_rad, up_start, up_goal, goal_rad])
            routes.append([start_rad, up_start, self.home_rad, up_goal, goal_rad])
        return routes

    def _lifted(self, joints_rad: Float[np.ndarray, "6"], lift_m: float) -> Float[np.ndarray, "6"]:
        T_base_flange = translation([0, 0, lift_m]) * self.controller.forward(joints_rad)
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

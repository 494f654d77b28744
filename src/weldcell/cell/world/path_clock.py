"""The time law of a torch path: how far along it the torch is commanded to be, with smooth ramps and safe stops.

A change of speed by dv takes T = 1.5 |dv| / a_max and goes as v = v0 + dv (3 x^2 - 2 x^3), x = t / T: the acceleration
does not jump, and its peak 1.5 |dv| / T is the bound. From v to rest that is T = 1.5 v / a_max and v T / 2 =
0.75 v^2 / a_max of path: at 100 mm/s and 1 m/s^2, 0.15 s and 7.5 mm.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadInput

_PEAK_OVER_MEAN = 1.5  # of the acceleration in a ramp
_BRAKE_STEPS_EARLY = 3  # the end's ramp begins this early, so that a clock that is speeding up keeps the bound


class PathTimes(NamedTuple):
    """Where along the path the torch is to be at n times."""

    arc_length_m: Float[np.ndarray, "n"]
    speed_m_s: Float[np.ndarray, "n"]
    acceleration_m_s2: Float[np.ndarray, "n"]


class PathClock:
    """Arc length over time: from rest to a speed, to rest at the path's end or wherever `brake` is called."""

    def __init__(
        self, speed_m_s: float, acceleration_m_s2: float, start_m: float = 0.0, end_m: float | None = None
    ) -> None:
        """Without `end_m` it runs on until `brake` or `end_at`."""
        for name, value in (("speed_m_s", speed_m_s), ("acceleration_m_s2", acceleration_m_s2)):
            if not (np.isfinite(value) and value > 0):
                raise BadInput(f"path clock: {name} is {value}, expected a finite number above 0")
        self.time_s = 0.0
        self._largest_m_s2, self._end_m = acceleration_m_s2, end_m
        self._ramp = _Ramp(start_s=0.0, start_m=start_m, from_m_s=0.0, to_m_s=0.0, duration_s=0.0)
        self.change_speed(speed_m_s)

    @property
    def arc_length_m(self) -> float:
        """Where along the path it is now."""
        return self._ramp.at(self.time_s)[0]

    @property
    def speed_m_s(self) -> float:
        """How fast it runs now."""
        return self._ramp.at(self.time_s)[1]

    @property
    def stopping(self) -> bool:
        """Whether it brakes or has stopped."""
        return self._ramp.to_m_s == 0

    @property
    def stopped(self) -> bool:
        """Whether it has come to rest."""
        return self.stopping and self.time_s >= self._ramp.end_s

    @property
    def stop_distance_m(self) -> float:
        """How much of the path it takes to come to rest if `brake` is called now (or was before)."""
        if self.stopping:
            return self._ramp.at(self._ramp.end_s)[0] - self.arc_length_m
        return 0.5 * self.speed_m_s * self._ramp_s(self.speed_m_s)

    def advance(self, step_s: float, count: int = 1) -> PathTimes:
        """Goes on by `count` steps; the places at their ends."""
        return PathTimes(*np.array([self._step(step_s) for _ in range(count)]).reshape(-1, 3).T)

    def change_speed(self, speed_m_s: float) -> None:
        """Goes over to another speed from now on."""
        arc_length_m, now_m_s, _ = self._ramp.at(self.time_s)
        self._ramp = _Ramp(
            start_s=self.time_s,
            start_m=arc_length_m,
            from_m_s=now_m_s,
            to_m_s=speed_m_s,
            duration_s=self._ramp_s(speed_m_s - now_m_s),
        )

    def brake(self) -> None:
        """Comes to rest as soon as the acceleration's bound allows."""
        if not self.stopping:
            self.change_speed(0.0)

    def end_at(self, end_m: float) -> None:
        """Comes to rest at this place, or as soon as possible if that is nearer than it can stop."""
        self._end_m = end_m

    def _step(self, step_s: float) -> tuple[float, float, float]:
        self.time_s += step_s
        arc_length_m, speed_m_s, acceleration_m_s2 = self._ramp.at(self.time_s)
        if self._end_m is not None and not self.stopping and speed_m_s > 0:
            left_m = self._end_m - arc_length_m
            if left_m <= self.stop_distance_m + _BRAKE_STEPS_EARLY * speed_m_s * step_s:
                self._ramp = _Ramp(
                    start_s=self.time_s,
                    start_m=arc_length_m,
                    from_m_s=speed_m_s,
                    to_m_s=0.0,
                    duration_s=max(2 * left_m / speed_m_s, self._ramp_s(speed_m_s)),
                )
        return arc_length_m, speed_m_s, acceleration_m_s2

    def _ramp_s(self, change_m_s: float) -> float:
        return _PEAK_OVER_MEAN * abs(change_m_s) / self._largest_m_s2


@dataclass(frozen=True, kw_only=True)
class _Ramp:
    """A change of speed, and what goes on steadily after it."""

    start_s: float
    start_m: float
    from_m_s: float
    to_m_s: float
    duration_s: float

    @property
    def end_s(self) -> float:
        """When the new speed is reached."""
        return self.start_s + self.duration_s

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Arc length, speed and acceleration."""
        since_s, change_m_s = time_s - self.start_s, self.to_m_s - self.from_m_s
        if since_s >= self.duration_s:
            ramp_m = 0.5 * (self.from_m_s + self.to_m_s) * self.duration_s
            return self.start_m + ramp_m + self.to_m_s * (since_s - self.duration_s), self.to_m_s, 0.0
        x = since_s / self.duration_s
        return (
            self.start_m + self.from_m_s * since_s + change_m_s * self.duration_s * (x**3 - 0.5 * x**4),
            self.from_m_s + change_m_s * (3 * x**2 - 2 * x**3),
            change_m_s / self.duration_s * 6 * x * (1 - x),
        )

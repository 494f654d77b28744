"""Joint readings as smooth functions of time, with the rates and accelerations that drives feed forward."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import make_interp_spline

from weldcell.cell.errors import BadInput
from weldcell.cell.world.path_clock import PathTimes

_DEGREE = 5  # of splines along a path: the drives' torque, which goes with the acceleration, has no kinks
_TICK = 1e-9  # of a period: rounding


class JointMotion(NamedTuple):
    """Readings at n servo ticks with their derivatives: `drives.follow(*motion)`."""

    readings_rad: Float[np.ndarray, "n 6"]
    rates_rad_s: Float[np.ndarray, "n 6"]
    accelerations_rad_s2: Float[np.ndarray, "n 6"]


class JointPath:
    """Readings along a known path, as a spline over its arc length."""

    def __init__(self, arc_length_m: Float[np.ndarray, "n"], readings_rad: Float[np.ndarray, "n 6"]) -> None:
        """Through these readings (as `readings_along` gives them) at these increasing arc lengths."""
        if len(arc_length_m) < 2 or np.any(np.diff(arc_length_m) <= 0):
            raise BadInput("joint path: expected two or more increasing arc lengths")
        degree = max(k for k in (1, 3, _DEGREE) if k < len(arc_length_m))
        self._spline = make_interp_spline(arc_length_m, readings_rad, k=degree)
        self._arc_length_m = np.asarray(arc_length_m, float)

    def motion(self, times: PathTimes) -> JointMotion:
        """The motion of a torch that is at these arc lengths at this speed and acceleration (chain rule)."""
        slope, bend = self._spline(times.arc_length_m, 1), self._spline(times.arc_length_m, 2)
        speed, acceleration = times.speed_m_s[:, None], times.acceleration_m_s2[:, None]
        return JointMotion(
            readings_rad=self._spline(times.arc_length_m),
            rates_rad_s=slope * speed,
            accelerations_rad_s2=bend * speed**2 + slope * acceleration,
        )

    def speed_shares(self, speed_m_s: float, speeds_rad_s: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
        """The largest share of each joint's speed that this speed along the path takes; above 1 the arm can't."""
        slopes = np.abs(self._spline(self._arc_length_m, 1)).max(axis=0)
        return slopes * speed_m_s / speeds_rad_s


class CommandSmoother:
    """Readings that come at the controller's rate, made into a motion at the servos' without jumps of acceleration.

    A uniform cubic B-spline with the commands as its control points. It needs a command on either side of the two that
    it runs between: the motion that `add` returns ends one command period before what is added is due, so commands are
    given two periods ahead. A steady motion is kept exactly; of a bend it cuts acceleration x period^2 / 6 (8 ms and
    0.2 rad/s^2: 2 urad).
    """

    def __init__(self, start_rad: Float[np.ndarray, "6"], command_hz: float, servo_hz: float) -> None:
        """At rest at these readings."""
        if not 0 < command_hz <= servo_hz:
            raise BadInput(f"command smoother: command_hz is {command_hz}, expected more than 0 up to {servo_hz}")
        self._command_hz, self._ticks = command_hz, servo_hz / command_hz
        self._points_rad = np.tile(np.asarray(start_rad, float), (4, 1))
        self._period = 0

    def add(self, readings_rad: Float[np.ndarray, "6"]) -> JointMotion:
        """The motion during the next command period, at the servo ticks in it, its end included."""
        self._points_rad = np.vstack([self._points_rad[1:], readings_rad])
        first, last = (int(np.floor(k * self._ticks + _TICK)) for k in (self._period, self._period + 1))
        u = np.arange(first + 1, last + 1) / self._ticks - self._period
        self._period += 1
        weights, slopes, bends = _b_spline(u)
        return JointMotion(
            readings_rad=weights @ self._points_rad,
            rates_rad_s=self._command_hz * slopes @ self._points_rad,
            accelerations_rad_s2=self._command_hz**2 * bends @ self._points_rad,
        )


def _b_spline(u: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "n 4"], ...]:
    """Weights of four control points on a uniform cubic B-spline's segment, 0 <= u <= 1, and their derivatives."""
    v = 1 - u
    return (
        np.column_stack([v**3, 3 * u**3 - 6 * u**2 + 4, 3 * v**3 - 6 * v**2 + 4, u**3]) / 6,
        np.column_stack([-(v**2), 3 * u**2 - 4 * u, 4 * v - 3 * v**2, u**2]) / 2,
        np.column_stack([v, 3 * u - 2, 3 * v - 2, u]),
    )

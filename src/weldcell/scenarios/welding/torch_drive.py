"""The torch driven along its path: from places at the controller's rate to what the arm's drives make of them."""

from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from weldcell.cell.configuration import WeldConfig
from weldcell.cell.errors import OutOfReach
from weldcell.cell.randomness import generator
from weldcell.cell.world.drives import Drives
from weldcell.cell.world.joint_motion import CommandSmoother
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.station import Station
from weldcell.scenarios.welding.torch_path import TorchPath

_CORRECTIONS, _BEYOND_M = 41, 0.04
_LARGEST_STEP_RAD = 0.3  # between two places; more means that the arm changed its configuration
_BRAKE_TICKS = 12  # a stop in joint space, when there is no path left to stop on
_STRAY_EVERY_S = 0.5  # repeatability is a matter of the approach: on the way it changes slowly


class TorchDrive:
    """The arm carrying the torch, tick by tick."""

    def __init__(
        self,
        station: Station,
        path: TorchPath,
        alignment: Alignment,
        first_m: float,
        config: WeldConfig,
    ) -> None:
        """The path begins at `first_m`."""
        self._station, self._path, self._alignment = station, path, alignment
        self._config, self._tick_s = config, 1 / config.command_hz
        known_cell = station.planner.known_cell
        self._drives = Drives(station.cell, known_cell, config.servo_hz, feed_forward=config.feed_forward)
        self._commands = CommandSmoother(station.joints_rad, config.command_hz, config.servo_hz)
        self._first_m, self._correction_rad = first_m, np.zeros(6)
        self._rate_rad_s = np.zeros(6)
        self._braking = 0
        self.place_rad = station.joints_rad.copy()
        """The last place commanded, as readings."""
        self.trouble = ""
        """Why the arm cannot go on, in words; it comes to rest then, whatever it is sent to."""

    def readings(self, arc_length_m: float, lateral_m: float, vertical_m: float) -> Float[np.ndarray, "6"]:
        """Readings that take the torch to this place of its path, near the last ones; raises OutOfReach."""
        T_base_flange = self._path.flanges(np.array([arc_length_m]), np.array([lateral_m]), np.array([vertical_m]))
        readings_rad = self._station.controller.inverse(T_base_flange[0], self.place_rad - self._correction_rad)
        self._correction_rad = self._corrections(arc_length_m)
        return readings_rad + self._correction_rad

    @cached_property
    def _corrections(self) -> CubicSpline:
        """What a calibrated arm's readings differ by from the nominal ones, along the taught path.

        A torch some millimetres beside it needs the same to a few micrometres: errors change with the posture.
        """
        at_m = np.linspace(self._first_m, self._path.taught.end_m + _BEYOND_M, _CORRECTIONS)
        arm, corrections_rad = self._alignment.arm, np.zeros((len(at_m), 6))
        if arm is not None:
            flanges = self._path.flanges(at_m, np.zeros(len(at_m)), np.zeros(len(at_m)))
            near_rad, known = self.place_rad, np.zeros(len(at_m), bool)
            for k, T_base_flange in enumerate(flanges):
                try:
                    near_rad = self._station.controller.inverse(T_base_flange, near_rad)
                except OutOfReach:
                    continue
                corrections_rad[k], known[k] = near_rad, True
            places = np.flatnonzero(known)
            exact_rad = arm.readings(flanges[places], corrections_rad[places])
            found_rad = exact_rad - corrections_rad[places]
            corrections_rad = np.column_stack([np.interp(at_m, at_m[places], column) for column in found_rad.T])
        return CubicSpline(at_m, corrections_rad)

    def start(self, readings_rad: Float[np.ndarray, "6"]) -> None:
        """The arm rests there."""
        self.place_rad = readings_rad
        self._drives.start(readings_rad)
        self._commands = CommandSmoother(readings_rad, self._config.command_hz, self._config.servo_hz)

    def go(self, arc_length_m: float, lateral_m: float, vertical_m: float) -> Float[np.ndarray, "6"]:
        """What the encoders show a tick later, on the way to this place of the path."""
        if not self.trouble:
            self._aim(arc_length_m, lateral_m, vertical_m)
        if self.trouble:
            share = max(0.0, 1 - self._braking / _BRAKE_TICKS)
            self.place_rad = self.place_rad + share * self._rate_rad_s * self._tick_s
            self._braking += 1
        readings_rad = self._drives.follow(*self._commands.add(self.place_rad))[-1]
        if self._drives.saturated.any() and not self.trouble:
            joints = ", ".join(str(k + 1) for k in np.flatnonzero(self._drives.saturated))
            self.trouble = f"the drive of joint {joints} cannot give the torque that the path takes"
        return readings_rad

    @property
    def at_rest(self) -> bool:
        """Whether it has come to rest after trouble."""
        return self._braking > _BRAKE_TICKS + 2

    @property
    def delay_s(self) -> float:
        """How long after a place is sent the arm gets there: a tick, by the smoothing of commands."""
        return self._tick_s

    @property
    def rates_rad_s(self) -> Float[np.ndarray, "6"]:
        """How fast the joints turn now."""
        return self._drives.rates_rad_s

    def stray_rad(self, time_s: float) -> Float[np.ndarray, "6"]:
        """How far the joints are off by the arm's repeatability: random, changing slowly."""
        knot, share = divmod(time_s / _STRAY_EVERY_S, 1.0)
        ends = [generator(self._station.seed, "weld/stray", int(knot) + k).normal(size=6) for k in (0, 1)]
        mixed = np.cos(share * np.pi / 2) * ends[0] + np.sin(share * np.pi / 2) * ends[1]  # of even variance
        return self._station.cell.error.repeatability_rad * mixed

    def _aim(self, arc_length_m: float, lateral_m: float, vertical_m: float) -> None:
        try:
            readings_rad = self.readings(arc_length_m, lateral_m, vertical_m)
        except OutOfReach:
            self.trouble = "the path leaves the arm's reach"
            return
        step_rad = readings_rad - self.place_rad
        low, high = self._station.controller.limits_rad.T
        if np.abs(step_rad).max() > _LARGEST_STEP_RAD or np.any((readings_rad < low) | (readings_rad > high)):
            self.trouble = "the path leaves the arm's reach"
        elif np.any(np.abs(step_rad) > self._station.controller.speeds_rad_s * self._tick_s):
            joint = int(np.argmax(np.abs(step_rad) / self._station.controller.speeds_rad_s)) + 1
            self.trouble = f"the path takes joint {joint} faster than it can turn"
        else:
            self._rate_rad_s, self.place_rad = step_rad / self._tick_s, readings_rad

"""The weave: how a torch swings to both sides of its path, in closed form.

The phase is time: 2 pi times the number of weaves so far. Weaves start in the middle and go to the left first; left of
the travel is positive (in the torch frame, whose z is the wire, left is -y). A dwell is the share of a weave during
which the torch stands at its two ends, half at each.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadInput

WeaveShape = Literal["sine", "triangle", "none"]


@dataclass(frozen=True, kw_only=True)
class Weave:
    """A torch's swing across its path."""

    amplitude_m: float
    """From the middle to either side."""
    frequency_hz: float
    """Whole weaves a second."""
    shape: WeaveShape = "sine"
    """How it moves between its ends; none: it does not."""
    dwell_ratio: float = 0.0
    """Share of the time at the ends, below 1."""

    def __post_init__(self) -> None:
        for name in ("amplitude_m", "frequency_hz"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise BadInput(f"weave: {name} is {getattr(self, name)}, expected a positive number")
        if not 0 <= self.dwell_ratio < 1:
            raise BadInput(f"weave: dwell_ratio is {self.dwell_ratio}, expected 0 or more and below 1")

    @property
    def period_s(self) -> float:
        """Duration of a whole weave."""
        return 1 / self.frequency_hz

    def phase_rad(self, time_s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The phase at times since the weave began; it grows without end."""
        return 2 * np.pi * self.frequency_hz * np.asarray(time_s, dtype=float)

    def lateral_m(self, time_s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """How far the torch is to the left of its path at times since the weave began."""
        return self.lateral_at_phase_m(self.phase_rad(time_s))

    def lateral_at_phase_m(self, phase_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """How far the torch is to the left of its path at these phases."""
        share, _ = self._swing(phase_rad)
        return self.amplitude_m * share

    def lateral_speed_m_s(self, time_s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Speed to the left at times since the weave began."""
        _, slope = self._swing(self.phase_rad(time_s))
        return self.amplitude_m * slope * 2 * np.pi * self.frequency_hz

    def _swing(self, phase_rad: Float[np.ndarray, "*n"]) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """The offset as a share of the amplitude, and its derivative by the phase."""
        phase_rad = np.asarray(phase_rad, dtype=float)
        if self.shape == "none":
            return np.zeros_like(phase_rad), np.zeros_like(phase_rad)
        within = np.mod(phase_rad + np.pi / 2, 2 * np.pi)  # 0 at the right end, pi at the left one
        rising = within < np.pi
        from_middle = np.where(rising, within, 2 * np.pi - within) - np.pi / 2
        stretch = 1 / (1 - self.dwell_ratio)
        moved = np.clip(from_middle * stretch, -np.pi / 2, np.pi / 2)
        moving = np.abs(from_middle * stretch) < np.pi / 2
        speed = np.where(rising, 1.0, -1.0) * np.where(moving, stretch, 0.0)
        if self.shape == "triangle":
            return moved / (np.pi / 2), speed / (np.pi / 2)
        return np.sin(moved), np.cos(moved) * speed

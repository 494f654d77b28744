"""The frame of a groove's plates: along them and into the depth."""

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from weldcell.tracking.curves import Curve
from weldcell.tracking.section import Corner, Section

_Number = TypeVar("_Number", float, np.ndarray)


@dataclass(frozen=True, kw_only=True)
class PlatesFrame:
    """The plates' frame: s along them, d into the depth, from a point on the level of both."""

    origin: Float[np.ndarray, "2"]
    angle_rad: float

    def of(self, section: Section) -> Section:
        """The section in this frame; its points need not be sorted any more."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        s_m, d_m = self.from_section(section.x_m, section.z_m)
        noise_d = cos - sin * section.noise_slope
        return Section(
            x_m=s_m,
            z_m=d_m,
            sigma_m=section.sigma_m * np.abs(noise_d),
            noise_slope=(cos * section.noise_slope + sin) / noise_d,
            amplitude_grey=section.amplitude_grey,
        )

    def from_section(self, x_m: _Number, z_m: _Number) -> tuple[_Number, _Number]:
        """s and d of points of the section."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        right_m, down_m = x_m - float(self.origin[0]), z_m - float(self.origin[1])
        return cos * right_m + sin * down_m, cos * down_m - sin * right_m

    def to_section(self, s_m: float, d_m: float) -> tuple[float, float]:
        """x and z in the section of a point of this frame."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        return float(self.origin[0]) + cos * s_m - sin * d_m, float(self.origin[1]) + sin * s_m + cos * d_m

    def corner(self, s_m: float, d_m: float, sigma_m: float) -> Corner:
        """A point of this frame as a corner of the section."""
        x_m, z_m = self.to_section(s_m, d_m)
        return Corner(x_m=x_m, z_m=z_m, sigma_m=sigma_m)


def plates_frame(plates: tuple[Curve, Curve], right_m: float, left_m: float) -> PlatesFrame:
    """The frame between plates that end at these x."""
    angle = (plates[0].angle_at(right_m) + plates[1].angle_at(left_m)) / 2
    ends = np.array([[right_m, plates[0].z_at(right_m)], [left_m, plates[1].z_at(left_m)]])
    return PlatesFrame(origin=ends.mean(axis=0), angle_rad=angle)

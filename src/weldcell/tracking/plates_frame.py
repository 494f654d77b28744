"""The frame of a groove's plates: along them and into the depth."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.tracking.curves import Curve
from weldcell.tracking.section import Corner, Section


@dataclass(frozen=True, kw_only=True)
class PlatesFrame:
    """The plates' frame: s along them, d into the depth, from a point on the level of both."""

    origin: Float[np.ndarray, "2"]
    angle_rad: float

    @property
    def axes(self) -> Float[np.ndarray, "2 2"]:
        """Rows: the directions of s and d in the section."""
        cos, sin = np.cos(self.angle_rad), np.sin(self.angle_rad)
        return np.array([[cos, sin], [-sin, cos]])

    def of(self, section: Section) -> Section:
        """The section in this frame; its points need not be sorted any more."""
        points = (np.stack([section.x_m, section.z_m]).T - self.origin) @ self.axes.T
        noise = np.stack([section.noise_slope, np.ones(len(section.x_m))]).T @ self.axes.T
        return Section(
            x_m=points[:, 0],
            z_m=points[:, 1],
            sigma_m=section.sigma_m * np.abs(noise[:, 1]),
            noise_slope=noise[:, 0] / noise[:, 1],
            amplitude_grey=section.amplitude_grey,
        )

    def corner(self, s_m: float, d_m: float, sigma_m: float) -> Corner:
        """A point of this frame as a corner of the section."""
        x_m, z_m = self.origin + np.array([s_m, d_m]) @ self.axes
        return Corner(x_m=float(x_m), z_m=float(z_m), sigma_m=sigma_m)


def plates_frame(plates: tuple[Curve, Curve], right_m: float, left_m: float) -> PlatesFrame:
    """The frame between plates that end at these x."""
    angle = (plates[0].angle_at(right_m) + plates[1].angle_at(left_m)) / 2
    ends = np.array([[right_m, plates[0].z_at(right_m)], [left_m, plates[1].z_at(left_m)]])
    return PlatesFrame(origin=ends.mean(axis=0), angle_rad=angle)

"""A profile seen in its own plane: x across, z along the light."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import Profile
from weldcell.tracking.triangulation import noise_slopes

_LEAST_SIGMA_M = 1e-9  # a sigma of zero would be an infinite weight


@dataclass(frozen=True, kw_only=True)
class Section:
    """The valid points of a profile in the laser frame, in the order of the picture's columns: along a surface x rises.

    A stray in its column lies elsewhere along that column's ray, and so at another x than its neighbours.
    """

    x_m: Float[np.ndarray, "n"]
    """Across the light, along the camera's x."""
    z_m: Float[np.ndarray, "n"]
    """Along the light: larger is deeper."""
    sigma_m: Float[np.ndarray, "n"]
    """Standard deviation along z."""
    noise_slope: Float[np.ndarray, "n"]
    """dx/dz of a point's noise: a stripe centre moves along the picture's column, not quite along z."""
    amplitude_grey: Float[np.ndarray, "n"]
    """Height of the stripe there, grey levels; NaN where nobody measured it."""

    def only(self, keep: Bool[np.ndarray, "n"] | Int[np.ndarray, "k"]) -> "Section":
        """The section of these points."""
        at = np.flatnonzero(keep) if keep.dtype == bool else keep  # a mask would be searched for each array again
        return Section(
            x_m=self.x_m[at],
            z_m=self.z_m[at],
            sigma_m=self.sigma_m[at],
            noise_slope=self.noise_slope[at],
            amplitude_grey=self.amplitude_grey[at],
        )


def section_of(profile: Profile, plane: LaserPlane) -> Section:
    """The profile's valid points in the frame of the light plane."""
    points_camera, T_camera_laser = profile.points_camera[profile.valid], plane.T_camera_laser.as_matrix()
    if not len(points_camera):
        none = np.zeros(0)
        return Section(x_m=none, z_m=none, sigma_m=none, noise_slope=none, amplitude_grey=none)
    points_laser = (points_camera - T_camera_laser[:3, 3]) @ T_camera_laser[:3, :3]
    x_m, z_m, noise_slope = points_laser[:, 0], points_laser[:, 2], noise_slopes(points_camera, plane)
    level_m = np.median(z_m)  # where the columns' rays cross this depth, they are in order
    order = np.argsort(x_m - noise_slope * (z_m - level_m), kind="stable")
    amplitude = profile.amplitude_grey
    amplitude_grey = np.full(len(x_m), np.nan) if amplitude is None else amplitude[profile.valid]
    return Section(
        x_m=x_m[order],
        z_m=z_m[order],
        sigma_m=np.maximum(profile.sigma_m[profile.valid][order], _LEAST_SIGMA_M),
        noise_slope=noise_slope[order],
        amplitude_grey=amplitude_grey[order],
    )


@dataclass(frozen=True, kw_only=True)
class Corner:
    """A feature of a joint, in the laser frame."""

    x_m: float
    z_m: float
    sigma_m: float
    """Root mean square distance of the corner from where it should be."""

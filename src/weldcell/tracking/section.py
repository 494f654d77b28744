"""A profile seen in its own plane: x across, z along the light."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import Profile
from weldcell.tracking.quantiles import median
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

    @cached_property
    def spacing_m(self) -> float:
        """Of neighbouring points in x, the usual one; of two points at least."""
        return median(self.x_m[1:] - self.x_m[:-1])

    @cached_property
    def usual_sigma_m(self) -> float:
        """The median of `sigma_m`, of one point at least."""
        return median(self.sigma_m)

    @cached_property
    def _is_sorted(self) -> bool:
        return bool((self.x_m[1:] >= self.x_m[:-1]).all())

    def between(self, low_m: float, high_m: float, *, ends: bool = True) -> slice | Int[np.ndarray, "k"]:
        """The index of the points from one x to another; without `ends`, of those that lie on neither."""
        x_m = self.x_m
        if self._is_sorted:
            low, high = (
                x_m.searchsorted(low_m, "left" if ends else "right"),
                x_m.searchsorted(high_m, "right" if ends else "left"),
            )
            return slice(int(low), int(high))
        return np.flatnonzero((x_m >= low_m) & (x_m <= high_m) if ends else (x_m > low_m) & (x_m < high_m))

    def only(self, keep: slice | Bool[np.ndarray, "n"] | Int[np.ndarray, "k"]) -> "Section":
        """The section of these points."""
        at = keep if isinstance(keep, slice) or keep.dtype != bool else np.flatnonzero(keep)  # once for all arrays
        return Section(
            x_m=self.x_m[at],
            z_m=self.z_m[at],
            sigma_m=self.sigma_m[at],
            noise_slope=self.noise_slope[at],
            amplitude_grey=self.amplitude_grey[at],
        )


def section_of(profile: Profile, plane: LaserPlane) -> Section:
    """The profile's valid points in the frame of the light plane."""
    valid = np.flatnonzero(profile.valid)
    if not len(valid):
        none = np.zeros(0)
        return Section(x_m=none, z_m=none, sigma_m=none, noise_slope=none, amplitude_grey=none)
    points_camera, T_camera_laser = profile.points_camera[valid], plane.T_camera_laser.as_matrix()
    points_laser = (points_camera - T_camera_laser[:3, 3]) @ T_camera_laser[:3, :3]
    x_m, z_m, noise_slope = points_laser[:, 0], points_laser[:, 2], noise_slopes(points_camera, plane)
    level_m = median(z_m)  # where the columns' rays cross this depth, they are in order
    order = np.argsort(x_m - noise_slope * (z_m - level_m), kind="stable")
    at, amplitude_grey = valid[order], profile.amplitude_grey
    return Section(
        x_m=x_m[order],
        z_m=z_m[order],
        sigma_m=np.maximum(profile.sigma_m[at], _LEAST_SIGMA_M),
        noise_slope=noise_slope[order],
        amplitude_grey=np.full(len(at), np.nan) if amplitude_grey is None else amplitude_grey[at],
    )


@dataclass(frozen=True, kw_only=True)
class Corner:
    """A feature of a joint, in the laser frame."""

    x_m: float
    z_m: float
    sigma_m: float
    """Root mean square distance of the corner from where it should be."""

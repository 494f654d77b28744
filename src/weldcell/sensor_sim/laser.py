"""The laser: a fan of rays in one plane, the power along it, and how thick the sheet of light is.

Thickness. Across its plane the light is a Gaussian beam that the laser focuses at its waist: after the way r its
half width at 1/e^2 is

    w(r) = w0 sqrt(1 + ((r - r0) / z_R)^2),     z_R = pi w0^2 / (M^2 lambda),

with w0 the waist's half width, r0 its distance and M^2 the beam quality (ISO 11146-1; Siegman, New developments in
laser resonators, SPIE 1224, 1990). A Gaussian of half width w at 1/e^2 has sigma = w / 2. A line lens makes the fan and
leaves this direction alone, so the waist is an arc about the source.

Power. A line lens (Powell's) spreads the light evenly over the angle; a cylinder lens leaves the beam's Gaussian, taken
here to have fallen to 1/e^2 at both ends of the fan. The light that falls on a surface thins out with 1/r.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import BadGeometry
from weldcell.cell.optics import LaserPlane
from weldcell.sensor_sim.design import laser_range_m, stripe_length_px

RAYS_PER_PIXEL = 2


@dataclass(frozen=True, kw_only=True)
class LaserSheet:
    """Thickness of the light sheet along its way."""

    waist_sigma_m: float
    """Standard deviation of the sheet's Gaussian section at its waist."""
    waist_range_m: float
    """Distance of the waist from the laser's source."""
    rayleigh_m: float
    """Way from the waist to where the sheet is sqrt(2) times as thick."""

    def sigma_m(self, range_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Standard deviation of the sheet's section at these distances from the source."""
        return self.waist_sigma_m * np.hypot(1.0, (range_m - self.waist_range_m) / self.rayleigh_m)


@dataclass(frozen=True, kw_only=True)
class LaserFan:
    """The light as it leaves the laser: rays of one plane from one point."""

    plane: LaserPlane
    """The actual light plane."""
    source_camera: Float[np.ndarray, "3"]
    """Where the fan starts, in the plane, camera frame (m)."""
    directions_camera: Float[np.ndarray, "n 3"]
    """Unit directions of the rays, in order across the fan."""
    power_ratio: Float[np.ndarray, "n"]
    """Power that each ray carries for its angle; 1 in the fan's middle."""
    sheet: LaserSheet
    """The sheet's thickness."""

    def thinned(self, every: int) -> "LaserFan":
        """Every so many-th of its rays."""
        rays = slice(None, None, every)
        return replace(self, directions_camera=self.directions_camera[rays], power_ratio=self.power_ratio[rays])


def laser_fan(config: SensorConfig, plane: LaserPlane, source_camera: Float[np.ndarray, "3"]) -> LaserFan:
    """The fan about the plane's light direction, rays evenly spaced on a surface hit head-on.

    `plane` and `source_camera` (m) are the actual ones. A source that lies off the plane (a real one never does) is
    moved to its foot in the plane.
    """
    source_camera = np.asarray(source_camera, dtype=float)
    half_rad = np.deg2rad(config.laser_fan_deg) / 2
    if source_camera.shape != (3,) or not np.all(np.isfinite(source_camera)):
        raise BadGeometry(f"laser: expected a source of 3 finite numbers, found {source_camera.tolist()}")
    if not 0 < half_rad < np.pi / 2:
        raise BadGeometry(f"laser: expected a fan of 0 to 180 deg, found {config.laser_fan_deg:.6g}")
    axes = plane.T_camera_laser.rotation.as_matrix()
    slope = np.linspace(-1, 1, RAYS_PER_PIXEL * stripe_length_px(config)) * np.tan(half_rad)
    directions = slope[:, None] * axes[:, 0] + axes[:, 2]
    return LaserFan(
        plane=plane,
        source_camera=source_camera - plane.distance_m(source_camera) * plane.normal_camera,
        directions_camera=directions / np.linalg.norm(directions, axis=1, keepdims=True),
        power_ratio=power_ratio(np.arctan(slope), half_rad, config.laser_profile),
        sheet=laser_sheet(config),
    )


def laser_sheet(config: SensorConfig) -> LaserSheet:
    """The sheet of a sensor's laser, with its waist where it meets the camera's axis unless configured otherwise."""
    waist_m = config.laser_line_um * 1e-6 / 2
    return LaserSheet(
        waist_sigma_m=waist_m / 2,
        waist_range_m=config.laser_waist_mm * 1e-3 or laser_range_m(config),
        rayleigh_m=np.pi * waist_m**2 / (config.laser_m2 * config.wavelength_nm * 1e-9),
    )


def power_ratio(
    angles_rad: Float[np.ndarray, "n"], half_rad: float, profile: Literal["uniform", "gaussian"]
) -> Float[np.ndarray, "n"]:
    """Power for its angle of rays at these angles from the middle of a fan of +-`half_rad`; 1 in the middle."""
    if profile == "uniform":
        return np.ones_like(angles_rad)
    return np.exp(-2 * (angles_rad / half_rad) ** 2)

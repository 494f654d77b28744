"""Fume: a drifting cloud that takes light away and scatters other light into the picture.

Extinction e (1/m). Beer and Lambert: over a path the light falls to exp(-integral of e ds). The cloud is one field in
space and time for all paths: e = e_0 exp(a G - a^2 / 2) / (1 + (r / R)^2) with G a sum of plane waves of unit variance
that drift with the draught and the rising warm air, and r the distance from the arc. Evaluated at the same points, the
laser's way to the work and the camera's way back see the same wisps.

How dense. 45 mg/m^3 were measured 30 cm from a MAG arc (Evolution of Welding-Fume Aerosols with Time and Distance from
the Source, Welding Journal; stacks.cdc.gov/view/cdc/42150); within the plume there is ten times as much. With some
3 m^2 of extinction for a gram of sub-micrometre iron oxide (chosen) that is about 1/m, and a third of the light lost
over both ways together.

Scattered light. A piece ds of a camera ray adds e ds w / 4 pi times the irradiance that arrives there (single
scattering, evenly to all sides, albedo w). From the arc that is I / r^2, whose integral along a straight piece at
distance b from the arc is the angle under which the arc sees the piece, over b. From the light sheet of power P' per
metre of width it is P' / sin(c) for a ray that crosses the sheet at angle c: a faint haze where the ray meets the sheet
before it meets the work.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.randomness import generator
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.reflectance import light_reference
from weldcell.sensor_sim.stripe import StripeOptics
from weldcell.sensor_sim.weld.coarse_view import FARTHEST_M

EXTINCTION_PER_M = 1.0
"""Mean extinction by the arc at strength 1."""
ALBEDO = 0.8
"""Share of the extinction that is scattering, of iron oxide in the red (chosen)."""

_REACH_M = 0.25  # R
_CONTRAST = 0.7  # a
_WAVES = 12
_WAVELENGTH_M = (0.03, 0.25)
_RISE_M_S, _DRAUGHT_M_S, _CHURN_M_S = 0.25, 0.12, 0.05
_PIECES = 8  # of 30 to 50 mm: half of the shortest wave that ways do not average out anyway
_NEAREST_M = 2e-3  # within arc and laser, 1/r ends
_FLATTEST = 0.05  # a ray within the sheet would see haze without end


class FumeCloud:
    """The cloud about the arc over time; it depends on the seed and the time alone. Base axes, from the arc."""

    def __init__(self, seed: int, stage: str = "fume") -> None:
        rng = generator(seed, stage)
        length_m = np.geomspace(*_WAVELENGTH_M, _WAVES)
        directions = rng.normal(size=(_WAVES, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self._waves = (2 * np.pi / length_m)[:, None] * directions
        self._phase_rad = rng.uniform(0, 2 * np.pi, _WAVES)
        weight = length_m ** (1 / 3)  # Kolmogorov: a scalar's variance in equal steps of log wavelength goes with 2/3
        self._weight = weight * np.sqrt(2 / np.sum(weight**2))
        draught_rad = rng.uniform(0, 2 * np.pi)
        drift_m_s = np.append(_DRAUGHT_M_S * np.array([np.cos(draught_rad), np.sin(draught_rad)]), _RISE_M_S)
        churn_m_s = _CHURN_M_S * rng.normal(size=_WAVES)
        self._rate_rad_s = self._waves @ drift_m_s + np.linalg.norm(self._waves, axis=1) * churn_m_s

    def extinction_per_m(self, offsets: Float[np.ndarray, "*n 3"], time_s: float) -> Float[np.ndarray, "*n"]:
        """Extinction at strength 1 at these places (m, from the arc)."""
        now_rad = np.mod(self._phase_rad - self._rate_rad_s * time_s, 2 * np.pi)  # kept small for float32
        angle = (offsets @ self._waves.T + now_rad).astype(np.float32)
        noise = np.cos(angle, out=angle) @ self._weight.astype(np.float32)
        envelope = 1 / (1 + np.einsum("...i,...i->...", offsets, offsets) / _REACH_M**2)
        return EXTINCTION_PER_M * envelope * np.exp(_CONTRAST * noise - _CONTRAST**2 / 2)


def pieces_of(
    starts: Float[np.ndarray, "*n 3"], stops: Float[np.ndarray, "*n 3"]
) -> tuple[Float[np.ndarray, "*n pieces 3"], Float[np.ndarray, "*n"]]:
    """Middles of equal pieces of straight ways, and the pieces' length (m)."""
    share = (np.arange(_PIECES) + 0.5) / _PIECES
    way = stops - starts
    return starts[..., None, :] + share[:, None] * way[..., None, :], np.linalg.norm(way, axis=-1) / _PIECES


def scattered_arc(
    extinction_per_m: Float[np.ndarray, "n pieces"],
    start: Float[np.ndarray, "3"],
    stops: Float[np.ndarray, "n 3"],
    intensity: float,
) -> Float[np.ndarray, "n"]:
    """Radiance (W/(m^2 sr)) that fume scatters of the arc's light into rays from the camera; places from the arc.

    Light that comes from deeper in the cloud is dimmed on its way to the camera.
    """
    way = stops - start
    length_m = np.linalg.norm(way, axis=1)
    rays = way / length_m[:, None]
    foot_m = -(rays @ start)
    nearest_m = np.maximum(np.linalg.norm(start + foot_m[:, None] * rays, axis=1), _NEAREST_M)[:, None]
    borders_m = length_m[:, None] * np.linspace(0, 1, extinction_per_m.shape[1] + 1) - foot_m[:, None]
    seen_per_m = np.diff(np.arctan(borders_m / nearest_m), axis=1) / nearest_m
    depth = extinction_per_m * (length_m / extinction_per_m.shape[1])[:, None]
    before = np.cumsum(depth, axis=1) - depth / 2
    return intensity * ALBEDO / (4 * np.pi) * np.sum(extinction_per_m * seen_per_m * np.exp(-before), axis=1)


@dataclass(frozen=True, kw_only=True)
class LightSheet:
    """Where camera rays cross the laser's light sheet; camera frame, metres."""

    points_camera: Float[np.ndarray, "n 3"]
    """Crossing; 1 m along the ray where the ray never meets the light's plane nearer than that."""
    range_m: Float[np.ndarray, "n"]
    """Distance from the camera."""
    haze_grey_m: Float[np.ndarray, "n"]
    """Grey levels of haze for an extinction of 1/m at the crossing; 0 outside the fan."""


def light_sheet(fan: LaserFan, optics: StripeOptics, directions_camera: Float[np.ndarray, "n 3"]) -> LightSheet:
    """The sheet of a laser for unit rays of the camera.

    `optics` knows what a white surface shows in the middle of the sheet's Gaussian section, so that P' / pi is that
    times s sqrt(2 pi) in grey levels times metres.
    """
    points = fan.plane.intersect(directions_camera)
    range_m = np.linalg.norm(points, axis=1)
    met = range_m < FARTHEST_M
    points = np.where(met[:, None], points, FARTHEST_M * directions_camera)
    axes = fan.plane.T_camera_laser.rotation.as_matrix()[:, [0, 2]]
    across, along = ((points - fan.source_camera) @ axes).T
    fan_across, fan_along = (fan.directions_camera @ axes).T
    power = np.interp(across / np.where(along > 0, along, np.nan), fan_across / fan_along, fan.power_ratio, 0, 0)
    reference = light_reference(fan)
    white_grey_m = optics.unblurred_grey * reference.sheet_sigma_m * np.sqrt(2 * np.pi)
    spread = np.maximum(np.hypot(across, along), _NEAREST_M) / reference.range_m
    crossing_sin = np.maximum(directions_camera @ fan.plane.normal_camera, _FLATTEST)
    haze_grey_m = ALBEDO / 4 * white_grey_m * power / spread / crossing_sin
    return LightSheet(
        points_camera=points,
        range_m=np.where(met, range_m, FARTHEST_M),
        haze_grey_m=np.where(met & (along > 0), haze_grey_m, 0.0),
    )

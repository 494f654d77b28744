"""The arc: how its light flickers, what it lights, and how its glare lies over the picture.

Strength. At strength 1 the arc sends 10 W into the filter's band, evenly to all sides: a MAG arc of 200 A and 27 V
radiates some 15 % of its power (chosen within the 10 to 20 % usually given), mostly between 200 and 1000 nm, hence
about 1 W/nm. On steel 60 mm ahead of it that makes some 10 to 60 grey levels with P2's sensor, as the pulses go.

What it lights. The arc is a point 3 mm up the wire from the torch's tip (the tip frame's origin is where the wire meets
the work). A surface at distance r whose normal is at angle a gets the irradiance I cos(a) / r^2, I = P / 4 pi, unless
something stands between; the torch itself does not shade. The surface sends it on by its material's reflectance
(`reflectance.radiance_factor`): metal ahead of a low arc mirrors more of it to the camera than it scatters. A tenth as
much light comes from all around, by way of other surfaces.

Glare. Lens and window scatter some of the light that enters them: b0 / (1 + (t / l)^2) per sr at the angle t from the
source, Harvey's model of polished surfaces with slope -2 (J. E. Harvey, Understanding Surface Scatter, SPIE 2019;
customary values: knee l of 1e-4 to 0.01 rad, slope -0.5 to -2). Its integral over the half-space is the scattered share
pi b0 l^2 ln(1 + 1 / l^2). Clean lenses scatter 0.1 %, a window near welds that has seen some fume 1 to 2 %.

Flicker. A pulsed arc's light follows its current (Weglowski, Monitoring of Arc Welding Process Based on Arc Light
Emission, 2012): pulses of 120 Hz that jitter, times 1/f noise, with drop-outs of some ms at short circuits and a flash
after each. Its mean is about 1.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel
from weldcell.cell.randomness import generator
from weldcell.sensor_sim.materials import Surfaces
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import radiance_factor
from weldcell.sensor_sim.weld.coarse_view import CoarseView, SeenCells

BAND_POWER_W = 10.0
"""Light of an arc of strength 1 within the filter's band, all around."""
ARC_ABOVE_TIP_M = 0.003
"""The middle of the arc, up the wire from the torch frame's origin."""

INDIRECT_RATIO = 0.1
"""Light that surfaces get by way of others, of what the arc would send them head-on."""
SCATTERED_RATIO = 0.012
"""Share of the light entering the lens that its surfaces and window scatter."""

_COLUMN_SIGMA_M = (0.0010, 0.0016)  # across and along the wire: a bell 4 mm wide and 6 mm high
_CORE_SIGMAS = 5.5  # exp(-15) of 10^6 levels
_STEP_M = 1e-4  # along the wire, for its direction in the picture
_SHADE_TOLERANCE_M = 0.002  # the arc is no point: what stands this close before a surface does not shade it
_NEAREST_M = 0.002  # within the arc, 1/r^2 ends
_KNEE_RAD = 0.01  # of the glare

_PULSE_HZ, _PULSE_DUTY, _BASE_LEVEL, _RISE_S = 120.0, 0.3, 0.25, 0.0004
_JITTER_CYCLES = 0.1
_NOISE_HZ = np.geomspace(0.5, 400.0, 32)  # evenly in log f with equal power each: 1/f
_NOISE_RATIO = 0.2
_SHORTS_PER_S, _SHORT_S, _SHORT_LEVEL = 6.0, (0.0015, 0.004), 0.05
_FLASH_RATIO, _FLASH_S = 0.6, 0.002
_SLOT_S = 0.1
_STEPS_PER_S = 25_000.0
_FEWEST_STEPS, _MOST_STEPS = 16, 2048


class ArcFlicker:
    """The arc's light over time, as a factor; it depends on the seed and the time alone."""

    def __init__(self, seed: int, stage: str = "arc") -> None:
        rng = generator(seed, f"{stage}/flicker")
        self._seed, self._stage = seed, f"{stage}/short"
        self._noise_rad, self._jitter_rad = rng.uniform(0, 2 * np.pi, (2, len(_NOISE_HZ)))
        self._start_cycles = rng.uniform()

    def mean(self, start_s: float, end_s: float) -> float:
        """The mean factor of an exposure."""
        count = int(np.clip((end_s - start_s) * _STEPS_PER_S, _FEWEST_STEPS, _MOST_STEPS))
        return float(self.at(start_s + (np.arange(count) + 0.5) * (end_s - start_s) / count).mean())

    def at(self, times_s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """The factor at these times."""
        return self._pulses(times_s) * self._noise(times_s) * self._shorts(times_s)

    def _pulses(self, times_s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Trapezoids of mean 1 between the base and the pulse level."""
        slow = _NOISE_HZ < 20
        jitter = _waves(times_s, _NOISE_HZ[slow], self._jitter_rad[slow])
        since_s = np.mod(self._start_cycles + times_s * _PULSE_HZ + _JITTER_CYCLES * jitter, 1.0) / _PULSE_HZ
        until_s = _PULSE_DUTY / _PULSE_HZ + _RISE_S - since_s
        pulse = np.clip(np.minimum(since_s, until_s) / _RISE_S, 0, 1)
        return _BASE_LEVEL + (1 - _BASE_LEVEL) / _PULSE_DUTY * pulse

    def _noise(self, times_s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        return np.exp(_NOISE_RATIO * _waves(times_s, _NOISE_HZ, self._noise_rad) - _NOISE_RATIO**2 / 2)

    def _shorts(self, times_s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Dips to almost nothing at short circuits, each with a flash when the arc strikes again."""
        factor = np.ones(len(times_s))
        longest_s = _SHORT_S[1] + 5 * _FLASH_S
        first, last = int((times_s.min() - longest_s) // _SLOT_S), int(times_s.max() // _SLOT_S)
        for slot in range(max(first, 0), last + 1):
            rng = generator(self._seed, self._stage, slot)
            for start_s in (slot + rng.uniform(size=rng.poisson(_SHORTS_PER_S * _SLOT_S))) * _SLOT_S:
                end_s = start_s + rng.uniform(*_SHORT_S)
                after_s = np.maximum(times_s - end_s, 0)
                flash = np.where(times_s >= end_s, _FLASH_RATIO * np.exp(-after_s / _FLASH_S), 0.0)
                factor *= np.where((times_s >= start_s) & (times_s < end_s), _SHORT_LEVEL, 1 + flash)
        return factor


@dataclass(frozen=True, kw_only=True)
class ArcLight:
    """The arc during one exposure."""

    position_base: Float[np.ndarray, "3"]
    """Its middle, m."""
    wire_base: Float[np.ndarray, "3"]
    """Unit direction of the wire."""
    intensity: float
    """W/sr within the filter's band, mean over the exposure."""


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A part of a picture."""

    rows: slice
    """Its rows."""
    columns: slice
    """Its columns."""
    values: Float[np.ndarray, "height width"]
    """Its pixels."""


def arc_light(T_base_torch: RigidTransform, strength: float) -> ArcLight:
    """The arc at the wire of a torch that is actually there."""
    wire_base = T_base_torch.rotation.as_matrix()[:, 2]
    return ArcLight(
        position_base=T_base_torch.translation - ARC_ABOVE_TIP_M * wire_base,
        wire_base=wire_base,
        intensity=strength * BAND_POWER_W / (4 * np.pi),
    )


def free_ways_m(
    arc: ArcLight,
    directions_base: Float[np.ndarray, "n 3"],
    caster: RayCaster,
    data: mujoco.MjData,
    among: Bool[np.ndarray, "geoms"],
) -> Float[np.ndarray, "n"]:
    """How far it is from the arc along unit directions to the first surface of these geoms; inf if there is none."""
    among = among & caster.reachable(data, arc.position_base, directions_base)
    hits = caster.cast(data, arc.position_base, directions_base, among)
    return np.where(hits.hit, hits.distance_m, np.inf)


def shaded(
    arc: ArcLight,
    points_base: Float[np.ndarray, "n 3"],
    caster: RayCaster,
    data: mujoco.MjData,
    among: Bool[np.ndarray, "geoms"],
) -> Bool[np.ndarray, "n"]:
    """Whether one of these geoms stands between the arc and each point."""
    to_points = points_base - arc.position_base
    within_m = np.linalg.norm(to_points, axis=1) - _SHADE_TOLERANCE_M
    within_m = np.maximum(within_m, 0)
    return caster.blocked(data, arc.position_base, unit(to_points), within_m, among=among, exact=False)


def arc_seen(arc: ArcLight, centre_base: Float[np.ndarray, "3"], free_m: float) -> bool:
    """Whether no surface hides the arc from the camera's centre, the way from the arc being free that far."""
    return bool(free_m > np.linalg.norm(arc.position_base - centre_base) - _SHADE_TOLERANCE_M)


def lit_radiance(
    arc: ArcLight, seen: SeenCells, materials: Surfaces, free_m: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Radiance of the surface in each cell in the arc's light, W/(m^2 sr).

    `materials` are those of all geoms; `free_m` says how far the way from the arc towards each cell's surface is free.
    """
    to_arc = arc.position_base - seen.points_base
    distance_m = np.maximum(np.linalg.norm(to_arc, axis=1), _NEAREST_M)
    direct = irradiance(arc, seen, free_m)
    surfaces = materials.at(seen.geom_id)
    softened = np.hypot(surfaces.slope_roughness, _COLUMN_SIGMA_M[1] / distance_m)  # the arc is no point
    to_eye = unit(seen.centre_base - seen.points_base)
    factor = radiance_factor(
        replace(surfaces, slope_roughness=np.minimum(softened, 1.0)), unit(to_arc), to_eye, seen.normals_base
    )
    around = INDIRECT_RATIO * arc.intensity / distance_m**2 * (surfaces.diffuse_albedo + surfaces.mirror_share / 2)
    return np.where(seen.geom_id >= 0, direct * factor + around, 0.0) / np.pi


def irradiance(arc: ArcLight, seen: SeenCells, free_m: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """What the arc sends straight onto the surface in each cell, W/m^2; `free_m` as for `lit_radiance`."""
    to_arc = arc.position_base - seen.points_base
    distance_m = np.maximum(np.linalg.norm(to_arc, axis=1), _NEAREST_M)
    cosine = np.maximum(np.einsum("ni,ni->n", seen.normals_base, to_arc) / distance_m, 0.0)
    return arc.intensity * cosine / distance_m**2 * (free_m > distance_m - _SHADE_TOLERANCE_M)


def reaches(arc: ArcLight, seen: SeenCells, free_m: Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Whether the arc's light arrives at each point; `free_m` as for `lit_radiance`, 0 where a surface faces away."""
    distance_m = np.linalg.norm(arc.position_base - seen.points_base, axis=1)
    return (free_m > 0) & (free_m > distance_m - _SHADE_TOLERANCE_M)


def glare_radiance(arc: ArcLight, view: CoarseView, T_base_camera: RigidTransform) -> Float[np.ndarray, "n"]:
    """What lens and window scatter of the arc's light into each cell, W/(m^2 sr)."""
    arc_camera = T_base_camera.inv().apply(arc.position_base)
    distance_m = float(np.linalg.norm(arc_camera))
    if arc_camera[2] <= 0:
        return np.zeros(len(view.pixels))
    off_rad = np.arccos(np.clip(view.directions_camera @ (arc_camera / distance_m), -1, 1))
    return arc.intensity / distance_m**2 * glare_per_sr(off_rad)


def glare_per_sr(off_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Share of the light that enters the lens which it scatters to these angles from the source, per sr."""
    peak_per_sr = SCATTERED_RATIO / (np.pi * _KNEE_RAD**2 * np.log1p(1 / _KNEE_RAD**2))
    return peak_per_sr / (1 + (np.asarray(off_rad) / _KNEE_RAD) ** 2)


def arc_core(arc: ArcLight, camera: CameraModel, T_base_camera: RigidTransform) -> Patch | None:
    """The arc itself, W/(m^2 sr): a Gaussian column along the wire whose light sums to the arc's intensity."""
    ends_camera = T_base_camera.inv().apply(arc.position_base + np.outer([0.0, _STEP_M], arc.wire_base))
    middle, along = camera.project(ends_camera)
    if not np.all(np.isfinite([middle, along])):
        return None
    px_per_m = float(np.mean(camera.focal_px) / ends_camera[0, 2])
    length_px = max(float(np.hypot(*(along - middle))) / _STEP_M, 1e-6)
    axis = (along - middle) / _STEP_M / length_px
    across_px = _COLUMN_SIGMA_M[0] * px_per_m
    along_px = max(_COLUMN_SIGMA_M[1] * length_px, across_px)
    low = np.clip(np.floor(middle - _CORE_SIGMAS * along_px), 0, None).astype(int)
    high = np.minimum(np.ceil(middle + _CORE_SIGMAS * along_px) + 1, [camera.width_px, camera.height_px]).astype(int)
    if np.any(high <= low):
        return None
    du, dv = np.arange(low[0], high[0]) - middle[0], np.arange(low[1], high[1])[:, None] - middle[1]
    a, c = (du * axis[0] + dv * axis[1]) / along_px, (du * axis[1] - dv * axis[0]) / across_px
    peak = arc.intensity * px_per_m**2 / (2 * np.pi * across_px * along_px)
    return Patch(
        rows=slice(low[1], high[1]), columns=slice(low[0], high[0]), values=peak * np.exp(-0.5 * (a * a + c * c))
    )


def unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors made unit."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _waves(
    times_s: Float[np.ndarray, "n"], frequency_hz: Float[np.ndarray, "m"], phase_rad: Float[np.ndarray, "m"]
) -> Float[np.ndarray, "n"]:
    """A sum of cosines of unit variance."""
    angle = 2 * np.pi * times_s[:, None] * frequency_hz + phase_rad
    return np.cos(angle).sum(axis=1) * np.sqrt(2 / len(frequency_hz))

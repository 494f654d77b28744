"""How bright lit surfaces are for the camera: a matt lobe and a microfacet mirror lobe.

With unit vectors i to the light, o to the eye, the normal N and h = (i + o) / |i + o| (Walter, Marschner, Li, Torrance:
Microfacet models for refraction through rough surfaces, EGSR 2007, eq. 20, 25, 26),

    f = albedo / pi + share F(i.h) D(h) G1(i) G1(o) / (4 (N.i) (N.o)),
    D = exp(-tan^2(h) / alpha^2) / (pi alpha^2 cos^4(h)),
    G1(v) = 2 / (1 + erf(a) + exp(-a^2) / (a sqrt(pi))),   a = 1 / (alpha tan(v)),
    F(c) = R + (1 - R) (1 - c)^5        (Schlick, Computer Graphics Forum 13, 1994).

f is the same with i and o exchanged, and as G1 belongs to D the mirror lobe reflects at most `share`: with
albedo + share <= 1 no light is made at any incidence. The radiance factor is pi f: 1 for a perfect diffuser from
everywhere.

The laser lights a surface with its sheet's Gaussian section: in the middle with the power of the ray for its angle,
over the way of the light (a fan thins out with 1/r), over sigma, times the cosine of incidence. A picture's brightness
goes with the radiance factor times that, whatever the camera's distance. The camera's opening blurs mirror lobes
narrower than itself (a quarter of a degree); that is left out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import erf

from weldcell.cell.errors import BadGeometry
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.light_section import LightSection
from weldcell.sensor_sim.materials import Surfaces

_GRAZING_COS = 1e-6  # below this a surface shows its edge


@dataclass(frozen=True, kw_only=True)
class LightReference:
    """The light where brightness counts as 1: head-on on a perfect diffuser, where light plane and camera axis meet."""

    range_m: float
    """Way of the light from the laser's source."""
    sheet_sigma_m: float
    """Standard deviation of the sheet's section there."""


def light_reference(fan: LaserFan) -> LightReference:
    """The reference of a fan; if its plane never meets the camera's axis, a metre from the source."""
    point_camera = fan.plane.intersect(np.array([0.0, 0.0, 1.0]))
    range_m = float(np.linalg.norm(point_camera - fan.source_camera)) if np.all(np.isfinite(point_camera)) else 1.0
    if range_m <= 0:
        raise BadGeometry("laser: the source lies where its plane meets the camera's axis, expected a way between")
    return LightReference(range_m=range_m, sheet_sigma_m=float(fan.sheet.sigma_m(np.array([range_m]))[0]))


def brightness(
    section: LightSection,
    power_ratio: Float[np.ndarray, "n"],
    surfaces: Surfaces,
    reference: LightReference,
    albedo_factor: Float[np.ndarray, "n"] | float = 1.0,
) -> Float[np.ndarray, "n"]:
    """Amplitude of the stripe before blur for each ray, relative to the reference; NaN where nothing is lit.

    `power_ratio` is each ray's power for its angle (the fan's own, or what mirrors left of it), `surfaces` what each
    ray meets (`geom_materials(model).at(section.geom_id)`), `albedo_factor` the texture there.
    """
    to_eye = -section.points_camera / np.linalg.norm(section.points_camera, axis=1, keepdims=True)
    factor = radiance_factor(surfaces, -section.directions_camera, to_eye, section.normals_camera)
    return irradiance(section, power_ratio, reference) * factor * albedo_factor


def irradiance(
    section: LightSection, power_ratio: Float[np.ndarray, "n"], reference: LightReference
) -> Float[np.ndarray, "n"]:
    """Light on the surface in the middle of the sheet's section, relative to the reference."""
    spread = section.range_m / reference.range_m * section.sheet_sigma_m / reference.sheet_sigma_m
    return power_ratio * section.incidence_cos / spread


def radiance_factor(
    surfaces: Surfaces,
    to_light: Float[np.ndarray, "n 3"],
    to_eye: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """Radiance of each point relative to a perfect diffuser in the same light; unit vectors of one frame."""
    factor = surfaces.diffuse_albedo.copy()
    shiny = np.flatnonzero(surfaces.mirror_share > 0)
    if len(shiny) > 0:
        factor[shiny] += _mirror_lobe(surfaces.at(shiny), to_light[shiny], to_eye[shiny], normals[shiny])
    return factor


def fresnel(
    mirror_reflectance: Float[np.ndarray, "n"], incidence_cos: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Schlick's reflectance of a facet."""
    return mirror_reflectance + (1 - mirror_reflectance) * (1 - np.clip(incidence_cos, 0, 1)) ** 5


def _mirror_lobe(
    surfaces: Surfaces,
    to_light: Float[np.ndarray, "n 3"],
    to_eye: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """pi times the second term of f; 0 from below the surface, NaN where an input is."""
    half = to_light + to_eye
    half /= np.maximum(np.sqrt(_dot(half, half)), 1e-300)[:, None]
    light_cos, eye_cos, half_cos = _dot(normals, to_light), _dot(normals, to_eye), _dot(normals, half)
    alpha = surfaces.slope_roughness
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        facing = fresnel(surfaces.mirror_reflectance, _dot(to_light, half))
        facets = np.exp(-(half_cos**-2 - 1) / alpha**2) / (alpha**2 * half_cos**4)  # pi D
        shadow = _seen_share(light_cos, alpha) * _seen_share(eye_cos, alpha)
        lobe = surfaces.mirror_share * facing * facets * shadow / (4 * light_cos * eye_cos)
    return np.where((light_cos < _GRAZING_COS) | (eye_cos < _GRAZING_COS), 0.0, lobe)


def _seen_share(cos: Float[np.ndarray, "n"], alpha: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """G1: the share of the facets that is not hidden by others, seen at this cosine."""
    a = cos / (alpha * np.sqrt(np.maximum(1 - cos**2, 1e-30)))
    return 2 / (1 + erf(a) + np.exp(-(a**2)) / (a * np.sqrt(np.pi)))


def _dot(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    return np.einsum("ni,ni->n", a, b)

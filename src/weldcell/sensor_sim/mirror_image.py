"""The other ghost: the lit stripe itself, seen by the camera in a mirror-like surface.

A lit point p1 shows in a mirror at the place m where the camera's ray c is reflected to p1. A plane mirror with unit
normal n through q shows p1 where the straight line from p1 to the camera's image c' = 2 (q.n) n (the camera being the
origin) meets it; a curved one is taken as its tangent plane, found again at each place that comes out. As first
guess serves the place that p1's own reflected light meets (`second_bounce.Bounce`). What the camera sees is a stripe
behind the mirror, at m + L c after the further way L = |p1 - m|, with p1's normal and the sheet's mirrored.

A mirror keeps radiance but for its share and Fresnel's reflectance. Its roughness turns the camera's ray by dv, which
meets p1's surface (normal N) elsewhere, L (dv - v (N.dv) / (N.v)) away, v being the ray's direction there: across the
sheet of normal s by L k.dv with k = s - N (s.v) / (N.v). So the image is the stripe blurred by L times the lobe's width
along k (`mirrors.lobe_sigma`), with as much light as before.

Left out: mirrors that the bounced light does not meet itself, what roughness does along the stripe, how a curved mirror
magnifies the sheet's thickness, images in two mirrors.
"""

import numpy as np
from jaxtyping import Float, Int

from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.light_section import LightSection
from weldcell.sensor_sim.mirrors import Ghost, MirrorHits, MirrorView, dot, ghost, lifted, lobe_sigma, reflected
from weldcell.sensor_sim.reflectance import LightReference, fresnel, irradiance, radiance_factor
from weldcell.sensor_sim.second_bounce import Bounce

_STEPS = 5  # to the place in a curved mirror; the first is exact in a plane one
_LARGEST_FACTOR = 0.8
_SETTLED = 1e-4  # turn of the normal (rad) below which another step would move an image by some micrometres
_HIDDEN_M = 1e-5  # what stands this far before the mirror hides it
_MISSED_RAD = 3e-3  # a ray that still misses its point by more (0.1 mm) has found no image


def mirror_image(
    view: MirrorView,
    camera: CameraModel,
    fan: LaserFan,
    section: LightSection,
    bounce: Bounce,
    reference: LightReference,
) -> Ghost | None:
    """The stripe as the camera sees it in mirrors; None if it shows in none."""
    useful = view.mirrors.is_mirror[bounce.hits.geom_id]
    rays, towards, found = _shown(view, section, bounce.rays[useful], bounce.hits.at(useful))
    if len(rays) == 0:
        return None
    image, bright = _image(view, fan, section, reference, rays, towards, found)
    return ghost(view, camera, image, bright, rays, len(section.lit), found.points_camera)


def _shown(
    view: MirrorView, section: LightSection, rays: Int[np.ndarray, "n"], guess: MirrorHits
) -> tuple[Int[np.ndarray, "m"], Float[np.ndarray, "m 3"], MirrorHits]:
    """Rays of the laser whose points show in mirrors, the directions to there from the points, and where it is.

    On a curved mirror each step closes in by much the same factor, so two of them tell where they lead to (Aitken).
    """
    place, normals = guess.points_camera, guess.smooth_normals_camera
    last_step = np.zeros_like(place)
    for k in range(_STEPS):
        towards = _towards_camera_image(section.points_camera[rays], place, normals)
        leaving = (dot(towards, normals) < 0) & (dot(towards, section.normals_camera[rays]) > 0)
        starts = lifted(section.points_camera[rays[leaving]], section.normals_camera[rays[leaving]])
        found = view.cast(starts, towards[leaving], mirrors_only=True)
        met = found.geom_id >= 0
        kept, found = np.flatnonzero(leaving)[met], found.at(met)
        rays, towards = rays[kept], towards[kept]
        step, turn = found.points_camera - place[kept], found.smooth_normals_camera - normals[kept]
        if np.all(np.abs(turn) < _SETTLED):
            break
        ahead = _ahead(step, last_step[kept]) if k % 2 == 1 else np.zeros((len(kept), 1))
        place, normals = found.points_camera + ahead * step, found.smooth_normals_camera + ahead * turn
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        last_step = step
    if len(rays) == 0:
        return rays, towards, found
    starts = lifted(section.points_camera[rays], section.normals_camera[rays])
    clear = ~(view.way_m(starts, towards) < found.distance_m - _HIDDEN_M)
    return rays[clear], towards[clear], found.at(clear)


def _ahead(step: Float[np.ndarray, "n 3"], last_step: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 1"]:
    """How many more of the last steps lead to the end of a row of steps that shrink by a factor f: f / (1 - f)."""
    factor = dot(step, last_step) / np.maximum(dot(last_step, last_step), 1e-30)
    factor = np.clip(factor, -_LARGEST_FACTOR, _LARGEST_FACTOR)
    return (factor / (1 - factor))[:, None]


def _towards_camera_image(
    points: Float[np.ndarray, "n 3"], place: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Unit directions from the points to the camera's image in these planes."""
    step = 2 * dot(place, normals)[:, None] * normals - points
    return step / np.linalg.norm(step, axis=1, keepdims=True)


def _image(
    view: MirrorView,
    fan: LaserFan,
    section: LightSection,
    reference: LightReference,
    rays: np.ndarray,
    towards: Float[np.ndarray, "n 3"],
    found: MirrorHits,
) -> tuple[LightSection, Float[np.ndarray, "n"]]:
    """The stripe behind the mirror, without its pixels, and its brightness."""
    sight = found.points_camera / np.linalg.norm(found.points_camera, axis=1, keepdims=True)
    mirror, lit = found.smooth_normals_camera, section.lit[rays]
    normals, sheet, sigma_m = (
        value[rays] for value in (section.normals_camera, section.sheet_normals_camera, section.sheet_sigma_m)
    )
    across = sheet - normals * (dot(towards, sheet) / dot(towards, normals))[:, None]
    surfaces = view.mirrors.surfaces.at(found.geom_id)
    scatter_m = found.distance_m * lobe_sigma(surfaces.slope_roughness, sight, mirror, across)
    blurred_m = np.hypot(sigma_m, scatter_m)
    bright = irradiance(section, fan.power_ratio, reference)[rays] * sigma_m / blurred_m
    points, geom_id, light = section.points_camera[rays], section.geom_id[rays], section.directions_camera[rays]
    bright *= radiance_factor(view.mirrors.surfaces.at(geom_id), -light, towards, normals)
    bright *= view.texture(points, normals, geom_id)
    bright *= surfaces.mirror_share * fresnel(surfaces.mirror_reflectance, -dot(sight, mirror))
    bright *= view.texture(found.points_camera, found.normals_camera, found.geom_id)
    met = np.linalg.norm(reflected(sight, mirror) + towards, axis=1) < _MISSED_RAD
    return LightSection(
        directions_camera=reflected(light, mirror),
        sheet_normals_camera=reflected(sheet, mirror),
        sheet_sigma_m=blurred_m,
        points_camera=found.points_camera + found.distance_m[:, None] * sight,
        normals_camera=reflected(normals, mirror),
        incidence_cos=section.incidence_cos[rays],
        range_m=section.range_m[rays],
        pixels=np.empty((len(rays), 2)),
        geom_id=geom_id,
        face_id=section.face_id[rays],
        lit=lit,
        visible=met & (dot(found.normals_camera, sight) < 0),
        seen=np.zeros(len(rays), dtype=bool),
    ), bright

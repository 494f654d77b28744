"""Ghost stripes: laser light that a mirror-like surface throws on another one, which the camera then sees.

Each ray that lights a mirror goes on along r = d - 2 (d.n) n from p1 and lights the next surface at p2, after the way
L. Around it, the mirrored sheet follows from two neighbours of the ray (ray differentials: Igehy, SIGGRAPH 1999): the
next ray of the fan, and the same ray of a fan that starts a little beside the light plane. Their distances from the
ray, after the way L, hold the mirror's curvature along and across the sheet: the light thins out with the first, the
sheet's thickness grows with the second. The mirror's roughness spreads the light across the sheet by a Gaussian of L
times the lobe's width (`mirrors.lobe_sigma`), which adds to the sheet's own. The power that goes on is the mirror's
share times Fresnel's reflectance at most, so no light is made.

Left out: what roughness does along the stripe (it softens its ends), light that is mirrored twice, whatever is fainter
than `mirrors.FAINTEST`, and mirrors so rough (`mirrors.Mirrors`) that the line becomes a glow.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.light_section import LightSection
from weldcell.sensor_sim.mirrors import Ghost, MirrorHits, MirrorView, dot, ghost, lifted, lobe_sigma, reflected
from weldcell.sensor_sim.reflectance import LightReference, brightness, fresnel

_BESIDE_M = 20e-6  # of the neighbouring fan: half a sigma of the sheet
_FLAT = 1e-6  # of a facet's normal against that of the surface it stands for: both are the same
_LARGEST_TURN = 0.2  # of the normal between neighbours on one smooth mirror
_NARROWEST = 0.05  # of its way: the least width of a bundle of rays, which has none where curved mirrors focus it


@dataclass(frozen=True, kw_only=True)
class Bounce:
    """The laser's rays that mirrors send on, and what they light; camera frame."""

    rays: Int[np.ndarray, "n"]
    """Their indices in the fan, rising."""
    directions_camera: Float[np.ndarray, "n 3"]
    """Unit direction after the mirror."""
    hits: MirrorHits
    """What they meet then."""
    range_m: Float[np.ndarray, "n"]
    """Whole way from the laser's source."""
    power_ratio: Float[np.ndarray, "n"]
    """Power of the ray for its angle at the source; more or less where a curved mirror gathers or spreads the rays."""
    sheet_normals_camera: Float[np.ndarray, "n 3"]
    """Unit normal of the mirrored sheet."""
    sheet_sigma_m: Float[np.ndarray, "n"]
    """Standard deviation of its section where it lands."""


def bounced(view: MirrorView, fan: LaserFan, section: LightSection) -> Bounce | None:
    """The light of a fan that mirrors send on to other surfaces; None if they send none.

    Points that the camera sees nothing of far around are left out.
    """
    rays = np.flatnonzero(section.lit & view.mirrors.is_mirror[section.geom_id])
    rays = rays[view.in_cone(section.points_camera[rays])]
    if len(rays) == 0:
        return None
    light = fan.directions_camera[rays]
    first = view.lit(section, rays)
    normals = first.smooth_normals_camera
    onward = reflected(light, normals)
    leaving = (dot(light, normals) < 0) & (dot(onward, first.normals_camera) > 0)
    second = view.cast(lifted(first.points_camera, first.normals_camera)[leaving], onward[leaving])
    arrived = (second.geom_id >= 0) & (dot(onward[leaving], second.normals_camera) < 0)
    if not arrived.any():
        return None
    kept = np.flatnonzero(leaving)[arrived]
    rays, light, onward, first, second = rays[kept], light[kept], onward[kept], first.at(kept), second.at(arrived)
    range_m = first.distance_m + second.distance_m
    tangents = _along_sheet(fan, rays, first, onward, second.distance_m)
    sheet_normals = _sheet_normals(onward, tangents, reflected(_rows(fan.plane.normal_camera, rays), normals[kept]))
    surfaces = view.mirrors.surfaces.at(first.geom_id)
    scatter_m = second.distance_m * lobe_sigma(surfaces.slope_roughness, light, normals[kept], sheet_normals)
    thicker = _across_sheet(view, fan, light, first, onward, second.distance_m, sheet_normals)
    share = surfaces.mirror_share * fresnel(surfaces.mirror_reflectance, -dot(light, normals[kept]))
    share *= view.texture(first.points_camera, first.normals_camera, first.geom_id)
    width_m = np.maximum(np.sqrt(dot(tangents, tangents)), _NARROWEST * range_m)
    return Bounce(
        rays=rays,
        directions_camera=onward,
        hits=second,
        range_m=range_m,
        power_ratio=fan.power_ratio[rays] * share * range_m / width_m,
        sheet_normals_camera=sheet_normals,
        sheet_sigma_m=np.hypot(fan.sheet.sigma_m(range_m) * thicker, scatter_m),
    )


def second_bounce(
    view: MirrorView, camera: CameraModel, section: LightSection, bounce: Bounce, reference: LightReference
) -> Ghost:
    """The ghost stripe that mirrored light makes; `section` is the laser's own."""
    hits = bounce.hits
    lit = LightSection(
        directions_camera=bounce.directions_camera,
        sheet_normals_camera=bounce.sheet_normals_camera,
        sheet_sigma_m=bounce.sheet_sigma_m,
        points_camera=hits.points_camera,
        normals_camera=hits.normals_camera,
        incidence_cos=-dot(hits.normals_camera, bounce.directions_camera),
        range_m=bounce.range_m,
        pixels=np.empty((len(bounce.rays), 2)),
        geom_id=hits.geom_id,
        face_id=hits.face_id,
        lit=np.ones(len(bounce.rays), dtype=bool),
        visible=dot(hits.normals_camera, hits.points_camera) < 0,
        seen=np.zeros(len(bounce.rays), dtype=bool),
    )
    surfaces = view.mirrors.surfaces.at(hits.geom_id)
    texture = view.texture(hits.points_camera, hits.normals_camera, hits.geom_id)
    bright = brightness(lit, bounce.power_ratio, surfaces, reference, texture)
    return ghost(view, camera, lit, bright, bounce.rays, len(section.lit), hits.points_camera)


def _along_sheet(
    fan: LaserFan,
    rays: Int[np.ndarray, "n"],
    first: MirrorHits,
    onward: Float[np.ndarray, "n 3"],
    way_m: Float[np.ndarray, "n"],
) -> Float[np.ndarray, "n 3"]:
    """Across each ray, where it lands, the way to its neighbours in the fan for their angle at the source (m/rad).

    The mean over the neighbours on either side that the same smooth mirror sends on; without any, as by a plane mirror.
    """
    light = fan.directions_camera[rays]
    here, there = slice(None, -1), slice(1, None)
    linked = (np.diff(rays) == 1) & _one_mirror(first.at(here), first.at(there))  # type: ignore[arg-type]
    turn_rad = np.linalg.norm(np.diff(light, axis=0), axis=1)  # small angles: the rays are 0.2 mrad apart
    ends = first.points_camera + way_m[:, None] * onward
    forward = first.points_camera[there] + way_m[here, None] * onward[there] - ends[here]
    backward = ends[there] - first.points_camera[here] - way_m[there, None] * onward[here]
    total, count = np.zeros_like(onward), np.zeros(len(rays))
    for steps, place in ((forward, here), (backward, there)):
        total[place] += np.where(linked[:, None], steps / turn_rad[:, None], 0.0)
        count[place] += linked
    straight = np.cross(_rows(fan.plane.normal_camera, rays), light) * (first.distance_m + way_m)[:, None]
    plane_mirror = reflected(straight, first.smooth_normals_camera)
    tangents = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], plane_mirror)
    return tangents - dot(tangents, onward)[:, None] * onward


def _across_sheet(
    view: MirrorView,
    fan: LaserFan,
    light: Float[np.ndarray, "n 3"],
    first: MirrorHits,
    onward: Float[np.ndarray, "n 3"],
    way_m: Float[np.ndarray, "n"],
    sheet_normals: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """How many times as thick the mirror's curvature makes the sheet; 1 where the neighbour misses the mirror."""
    thicker = np.ones(len(light))
    turned = np.abs(first.smooth_normals_camera - first.normals_camera).max(axis=1)
    curved = np.flatnonzero((turned > _FLAT) | ~view.mirrors.is_mesh[first.geom_id])
    if len(curved) == 0:
        return thicker
    light, onward, here = light[curved], onward[curved], first.at(curved)
    beside = view.cast(fan.source_camera + _BESIDE_M * fan.plane.normal_camera, light, mirrors_only=True)
    step = beside.points_camera - here.points_camera
    step += way_m[curved, None] * (reflected(light, beside.smooth_normals_camera) - onward)
    grown = np.abs(dot(step, sheet_normals[curved])) / _BESIDE_M
    thicker[curved] = np.where(_one_mirror(here, beside), grown, 1.0)
    return thicker


def _one_mirror(here: MirrorHits, there: MirrorHits) -> Bool[np.ndarray, "n"]:
    """Whether two hits lie on one smooth surface, as far as their normals tell."""
    turn = np.linalg.norm(there.smooth_normals_camera - here.smooth_normals_camera, axis=1)
    return (here.geom_id == there.geom_id) & (turn < _LARGEST_TURN)


def _sheet_normals(
    onward: Float[np.ndarray, "n 3"], tangents: Float[np.ndarray, "n 3"], like: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Unit normals of the sheet that holds ray and tangent, on the side of `like`."""
    normals = np.cross(onward, tangents)
    length = np.sqrt(dot(normals, normals))
    normals = np.where(length[:, None] > 0, normals / np.maximum(length, 1e-300)[:, None], like)
    return normals * np.where(dot(normals, like) < 0, -1.0, 1.0)[:, None]


def _rows(vector: Float[np.ndarray, "3"], rays: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    return np.broadcast_to(vector, (len(rays), 3))

"""Surfaces as rough mirrors: where rays from the sensor meet them, and what their roughness makes of a reflected ray.

A facet turned by dn against the surface's normal n turns the reflected ray r = d - 2 (d.n) n by

    dr = -2 ((d.dn) n + (d.n) dn),

to first order. With Gaussian slopes of alpha / sqrt(2) along each tangent, k.dr of any vector k is Gaussian too, with

    sigma = alpha / sqrt(2) |g - (g.n) n|,     g = 2 ((n.k) d + (d.n) k):

sqrt(2) alpha in the plane of incidence, and less by the cosine of incidence across it.
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.light_section import LightSection, near_picture, reached
from weldcell.sensor_sim.materials import Surfaces, geom_materials
from weldcell.sensor_sim.rays import RayCaster, RayHits
from weldcell.sensor_sim.smooth_normals import SmoothNormals
from weldcell.sensor_sim.solid_rays import Origins
from weldcell.sensor_sim.texture import SceneTextures

FAINTEST = 5e-4
"""Brightness below which ghosts are left out: a tenth of a grey level at 1 ms."""

_LIFT_M = 1e-6  # from a surface before a ray leaves it: above single precision's rounding, a hundredth of a pixel
_ROUGHEST = 0.15  # a lobe wider than 0.2 of its way is no mirrored line any more, but a faint glow


@dataclass(frozen=True, kw_only=True)
class Ghost:
    """A stripe that mirrors make, to be drawn like the laser's own."""

    section: LightSection
    """Its points, as many as the laser's rays, each from the ray of that index."""
    brightness: Float[np.ndarray, "n"]
    """Amplitude before blur, as of `reflectance.brightness`; NaN where there is none."""


@dataclass(frozen=True, kw_only=True)
class MirrorHits:
    """What rays meet, camera frame (m); NaN and -1 for a miss."""

    points_camera: Float[np.ndarray, "n 3"]
    """Where."""
    distance_m: Float[np.ndarray, "n"]
    """Way from the ray's origin."""
    normals_camera: Float[np.ndarray, "n 3"]
    """Outward unit normal of what is hit, a facet for a mesh."""
    smooth_normals_camera: Float[np.ndarray, "n 3"]
    """Outward unit normal of the surface that the mesh stands for."""
    geom_id: Int[np.ndarray, "n"]
    """The geom."""
    face_id: Int[np.ndarray, "n"]
    """The triangle of its mesh, where it is known."""

    def at(self, index: Int[np.ndarray, "m"] | Bool[np.ndarray, "n"]) -> "MirrorHits":
        """Those of some rays."""
        return MirrorHits(**{name: value[index] for name, value in vars(self).items()})


class Mirrors:
    """The surfaces of a model, for one caster."""

    def __init__(self, model: mujoco.MjModel, caster: RayCaster) -> None:
        self.caster = caster
        """What casts the rays."""
        self.surfaces: Surfaces = geom_materials(model)
        """The material of each geom."""
        self.textures = SceneTextures(model)
        """The textures of the geoms."""
        self.smooth = SmoothNormals(model)
        """The normals of smooth surfaces."""
        self.is_mirror: Bool[np.ndarray, "geoms"] = (self.surfaces.mirror_share > 0) & (
            self.surfaces.slope_roughness <= _ROUGHEST
        )
        """Whether a geom is smooth enough to show or to throw a line."""
        self.is_mesh: Bool[np.ndarray, "geoms"] = model.geom_type == mujoco.mjtGeom.mjGEOM_MESH
        """Whether a geom is a mesh."""


@dataclass(frozen=True, kw_only=True)
class MirrorView:
    """Mirrors seen from the camera of one frame."""

    mirrors: Mirrors
    """The scene's surfaces."""
    data: mujoco.MjData
    """The scene's state, with up-to-date kinematics."""
    R_base_camera: Float[np.ndarray, "3 3"]
    """How the camera is turned in the base."""
    centre_base: Float[np.ndarray, "3"]
    """Where the camera is, m."""
    among: Bool[np.ndarray, "geoms"]
    """Geoms that reach into the cone of what the camera sees: nothing else lies between two points in there."""
    cone_cos: float
    """Cosine of the cone's half angle about the camera's axis; the cone is wider than the picture."""

    def cast(
        self, origin_camera: Origins, directions_camera: Float[np.ndarray, "n 3"], mirrors_only: bool = False
    ) -> MirrorHits:
        """What rays from one origin, or each from its own, meet first; or the first mirror, through all else."""
        among = self.among & self.mirrors.is_mirror if mirrors_only else self.among
        R = self.R_base_camera
        origin_base = origin_camera @ R.T + self.centre_base
        hits = self.mirrors.caster.cast(self.data, origin_base, directions_camera @ R.T, among)
        return self._in_camera(hits, origin_camera + hits.distance_m[:, None] * directions_camera)

    def lit(self, section: LightSection, rays: Int[np.ndarray, "n"]) -> MirrorHits:
        """What some of the laser's own rays meet."""
        R = self.R_base_camera
        hits = RayHits(
            hit=section.lit[rays],
            distance_m=section.range_m[rays],
            points=section.points_camera[rays] @ R.T + self.centre_base,
            normals=section.normals_camera[rays] @ R.T,
            geom_id=section.geom_id[rays],
            face_id=section.face_id[rays],
        )
        return self._in_camera(hits, section.points_camera[rays])

    def _in_camera(self, hits: RayHits, points_camera: Float[np.ndarray, "n 3"]) -> MirrorHits:
        return MirrorHits(
            points_camera=points_camera,
            distance_m=hits.distance_m,
            normals_camera=hits.normals @ self.R_base_camera,
            smooth_normals_camera=self.mirrors.smooth.at(self.data, hits) @ self.R_base_camera,
            geom_id=hits.geom_id,
            face_id=hits.face_id,
        )

    def way_m(
        self, origins_camera: Float[np.ndarray, "n 3"], directions_camera: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n"]:
        """How far rays go until they meet anything; NaN without end."""
        R = self.R_base_camera
        origins_base = origins_camera @ R.T + self.centre_base
        return self.mirrors.caster.cast(self.data, origins_base, directions_camera @ R.T, self.among).distance_m

    def in_cone(self, points_camera: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Whether points lie in the cone of what the camera sees."""
        return points_camera[:, 2] > self.cone_cos * np.sqrt(dot(points_camera, points_camera))

    def texture(
        self,
        points_camera: Float[np.ndarray, "n 3"],
        normals_camera: Float[np.ndarray, "n 3"],
        geom_id: Int[np.ndarray, "n"],
    ) -> Float[np.ndarray, "n"]:
        """Brightness of the texture there."""
        points_base = points_camera @ self.R_base_camera.T + self.centre_base
        return self.mirrors.textures.factor(self.data, points_base, normals_camera @ self.R_base_camera.T, geom_id)


def ghost(
    view: MirrorView,
    camera: CameraModel,
    found: LightSection,
    bright: Float[np.ndarray, "n"],
    rays: Int[np.ndarray, "n"],
    ray_count: int,
    place_camera: Float[np.ndarray, "n 3"],
) -> Ghost:
    """The ghost of some rays among all, with its pixels and what the camera sees of it.

    `found.visible` says what is worth looking up; `place_camera` is what the camera's ray has to reach to see it.
    """
    pixels = camera.project(found.points_camera)
    with np.errstate(invalid="ignore"):
        visible = found.visible & near_picture(camera, pixels) & (bright >= FAINTEST)
    caster, R_base_camera = view.mirrors.caster, view.R_base_camera
    visible[visible] = reached(caster, view.data, R_base_camera, view.centre_base, place_camera[visible])
    seen = visible & camera.in_picture(pixels)
    section = replace(found, pixels=pixels, visible=visible, seen=seen)
    return Ghost(section=_among(section, rays, ray_count), brightness=_scattered(bright, rays, ray_count))


def _among(section: LightSection, rays: Int[np.ndarray, "n"], ray_count: int) -> LightSection:
    return LightSection(**{name: _scattered(value, rays, ray_count) for name, value in vars(section).items()})


def _scattered(values: np.ndarray, rays: Int[np.ndarray, "n"], ray_count: int) -> np.ndarray:
    """Values of some rays among all: the others hold NaN, -1 or False."""
    missing = {"f": np.nan, "i": -1, "b": False}[values.dtype.kind]
    spread = np.full((ray_count, *values.shape[1:]), missing, dtype=values.dtype)
    spread[rays] = values
    return spread


def lifted(points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Points a micrometre above their surface, for rays that leave it."""
    return points + _LIFT_M * normals


def reflected(vectors: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors mirrored in planes with these unit normals."""
    return vectors - 2 * dot(vectors, normals)[:, None] * normals


def lobe_sigma(
    roughness: Float[np.ndarray, "n"],
    incoming: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    along: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """Standard deviation of a reflected unit vector's component along `along` (k.dr above)."""
    g = 2 * (dot(normals, along)[:, None] * incoming + dot(incoming, normals)[:, None] * along)
    tangential = g - dot(g, normals)[:, None] * normals
    return roughness * np.sqrt(dot(tangential, tangential) / 2)


def dot(a: Float[np.ndarray, "n 3"], b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Products of vectors, row by row."""
    return np.einsum("ni,ni->n", a, b)

"""Nearest hits by Embree for meshes and by closed forms for simple solids, a hundred times as fast as MuJoCo.

Each mesh has an Embree scene in its own frame, built once; rays are turned into the frame of the geom, so moving geoms
cost nothing. Embree computes in single precision. It only names the triangle: rays start at the mesh's bounding sphere,
so that rounding moves them sideways by 2e-7 of the mesh's radius at most (20 nm for a plate of 0.3 m), and the distance
is then the triangle's plane's in double precision. In robust mode its triangles have no gaps along shared edges.

Exactly at a vertex one ray in a thousand would slip through, where rounding sends it past every triangle that meets
there. So all rays run beside themselves by 2e-6 of the radius, ten times that rounding: one aimed at a vertex meets a
triangle next to it, whose plane goes through it too. An outline is off by that much (0.3 um for such a plate).
"""

from typing import NamedTuple

import mujoco
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int

from weldcell.sensor_sim.mujoco_rays import MujocoRays, NearestHits
from weldcell.sensor_sim.solid_rays import SOLIDS, Origins, solid_hits

_MARGIN = 1e-4  # of a bounding sphere's radius: far above single precision's rounding
_ASIDE = 2e-6 * np.array([0.62, -0.47, 0.63])  # of a mesh's radius, in a direction that no edge or ray has
_SLIVER = 0.02  # twice a triangle's area over its longest side's square, below which its normal has few digits
_GRAZING = 0.02  # of a ray's slope to a triangle's plane
_ENDLESS_M = 1e30  # infinity would do as well, but for its warnings


class EmbreeRays:
    """Traces rays against chosen geoms of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._radius_m = np.where(plane, np.inf, model.geom_rbound * (1 + _MARGIN))
        self._small_first = np.argsort(self._radius_m, kind="stable")  # what stands on the table shortens its rays
        self._known = np.isin(model.geom_type, (*SOLIDS, mujoco.mjtGeom.mjGEOM_MESH))
        self._device = EmbreeDevice()
        self._meshes: dict[int, _Mesh] = {}
        self._others: MujocoRays | None = None

    def nearest(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Origins,
        directions: Float[np.ndarray, "n 3"],
    ) -> NearestHits:
        """The first hits on the chosen geoms."""
        hits = self._by_mujoco(data, chosen & ~self._known, origin, directions)
        stopped = _Stopped.of(origin, directions, hits.distance_m)
        for geom in self._small_first[(chosen & self._known)[self._small_first]]:
            R_base_geom = data.geom_xmat[geom].reshape(3, 3)
            beyond = self._beyond(geom, data.geom_xpos[geom], R_base_geom, stopped)
            open_rays = stopped.others if beyond else np.arange(len(directions))
            if len(open_rays) == 0:
                continue
            entry_m = _sphere_entry(
                _of_rays(origin, open_rays), directions[open_rays], data.geom_xpos[geom], self._radius_m[geom]
            )
            entering = np.flatnonzero(entry_m < hits.distance_m[open_rays])
            if len(entering) == 0:
                continue
            rays = open_rays[entering]
            origin_geom = (_of_rays(origin, rays) - data.geom_xpos[geom]) @ R_base_geom
            stretch = entry_m[entering], hits.distance_m[rays]
            met_m, normals_geom, face = self._meet(int(geom), origin_geom, directions[rays] @ R_base_geom, *stretch)
            nearer = met_m < hits.distance_m[rays]
            if not nearer.any():
                continue
            rays = rays[nearer]
            hits.distance_m[rays] = met_m[nearer]
            hits.normals[rays] = normals_geom[nearer] @ R_base_geom.T
            hits.geom_id[rays] = geom
            hits.face_id[rays] = face[nearer]
            stopped = _Stopped.of(origin, directions, hits.distance_m)
        return hits

    def maybe_blocked(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
        within_m: Float[np.ndarray, "n"],
    ) -> Bool[np.ndarray, "n"]:
        """Whether something may stop rays from one origin before these distances: sure where it is False.

        In single precision, so that a ray which just reaches its surface may seem stopped by it.
        """
        if (chosen & ~self._known).any():
            return np.ones(len(directions), dtype=bool)
        blocked = np.zeros(len(directions), dtype=bool)
        reached = _Stopped.of(origin, directions, within_m)
        for geom in np.flatnonzero(chosen).tolist():
            place, R_base_geom = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
            if self._beyond(geom, place, R_base_geom, reached):
                continue
            origin_geom, directions_geom = (origin - place) @ R_base_geom, directions @ R_base_geom
            if self._model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
                entry_m = max(float(np.linalg.norm(place - origin)) - self._radius_m[geom], 0.0)  # of any of them
                blocked |= self._mesh(geom).stops(origin_geom, directions_geom, entry_m, within_m)
            else:
                met_m, _, _ = self._meet(geom, origin_geom, directions_geom, np.zeros(len(within_m)), within_m)
                blocked |= met_m < within_m
        return blocked

    def _mesh(self, geom: int) -> "_Mesh":
        mesh = int(self._model.geom_dataid[geom])
        if mesh not in self._meshes:
            self._meshes[mesh] = _Mesh(self._model, mesh, self._device)
        return self._meshes[mesh]

    def _beyond(
        self, geom: int, place: Float[np.ndarray, "3"], R_base_geom: Float[np.ndarray, "3 3"], stopped: "_Stopped"
    ) -> bool:
        """Whether a geom lies wholly outside the box that holds all stopped rays, so that it stops none earlier.

        A wide table's bounding sphere holds everything that stands on it; its box lies under it.
        """
        if not np.isfinite(self._radius_m[geom]):
            up_base = R_base_geom[:, 2]
            return bool((stopped.middle - place) @ up_base > np.abs(up_base) @ stopped.half)
        centre, half = self._model.geom_aabb[geom, :3], self._model.geom_aabb[geom, 3:]
        apart = np.abs(R_base_geom @ centre + place - stopped.middle)
        return bool(np.any(apart > np.abs(R_base_geom) @ half + stopped.half + _MARGIN * self._radius_m[geom]))

    def _meet(
        self,
        geom: int,
        origin_geom: Origins,
        directions_geom: Float[np.ndarray, "n 3"],
        entry_m: Float[np.ndarray, "n"],
        end_m: Float[np.ndarray, "n"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Distances (infinite for a miss), outward normals and triangles on one geom, in its frame; what lies beyond
        `end_m` may be missed.
        """
        if self._model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
            kind, size = self._model.geom_type[geom], self._model.geom_size[geom]
            return *solid_hits(kind, size, origin_geom, directions_geom), np.full(len(directions_geom), -1)
        return self._mesh(geom).hits(origin_geom, directions_geom, entry_m, end_m)

    def _by_mujoco(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Origins,
        directions: Float[np.ndarray, "n 3"],
    ) -> NearestHits:
        """Hits on geoms of the kinds that only MuJoCo knows (height fields, signed distance fields)."""
        if not chosen.any():
            count = len(directions)
            nothing = np.full(count, -1)
            return NearestHits(np.full(count, np.inf), np.full((count, 3), np.nan), nothing, nothing.copy())
        self._others = self._others or MujocoRays(self._model)
        hits = self._others.nearest(data, chosen, origin, directions)
        return hits._replace(distance_m=np.where(hits.geom_id >= 0, hits.distance_m, np.inf))


class _Stopped(NamedTuple):
    """Rays that something stops, and a box in the base that holds them from their origins to their ends."""

    others: Int[np.ndarray, "k"]
    middle: Float[np.ndarray, "3"]
    half: Float[np.ndarray, "3"]

    @classmethod
    def of(
        cls, origin: Origins, directions: Float[np.ndarray, "n 3"], distance_m: Float[np.ndarray, "n"]
    ) -> "_Stopped":
        stopped = np.isfinite(distance_m)
        rays = np.flatnonzero(stopped)
        if len(rays) == 0:
            return cls(np.arange(len(directions)), np.zeros(3), np.zeros(3))
        starts = _of_rays(origin, rays)
        starts = starts[:, None] if starts.ndim == 1 else np.ascontiguousarray(starts.T)
        # A row in memory for each axis: NumPy reduces long rows fifteen times as fast as columns of three.
        ends = starts + np.multiply(directions[rays].T, distance_m[rays], order="C")
        low = np.minimum(ends.min(axis=1), starts.min(axis=1))
        high = np.maximum(ends.max(axis=1), starts.max(axis=1))
        return cls(np.flatnonzero(~stopped), (low + high) / 2, (high - low) / 2)


class _Mesh:
    """A mesh in its own frame: Embree's scene, and its triangles in double precision."""

    def __init__(self, model: mujoco.MjModel, mesh: int, device: EmbreeDevice) -> None:
        first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        vertices = model.mesh_vert[first : first + count]
        first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
        corners = vertices[model.mesh_face[first : first + count]].astype(float)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled_area = np.linalg.norm(normals, axis=1)
        kept = doubled_area > 0  # what has no area covers nothing
        self._face_id = np.flatnonzero(kept)
        self._corners = corners[kept]
        self._normals = normals[kept] / doubled_area[kept, None]
        self._offsets_m = np.einsum("ni,ni->n", self._normals, self._corners[:, 0])
        longest_m = np.linalg.norm(self._corners - np.roll(self._corners, 1, axis=1), axis=2).max(axis=1)
        self._is_sliver = doubled_area[kept] < _SLIVER * longest_m**2
        self._radius_m = float(np.linalg.norm(vertices, axis=1).max())
        self._scene = EmbreeScene(device, robust=True)
        TriangleMesh(self._scene, self._corners.astype(np.float32))

    def hits(
        self,
        origin: Origins,
        directions: Float[np.ndarray, "n 3"],
        entry_m: Float[np.ndarray, "n"],
        end_m: Float[np.ndarray, "n"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Distances (infinite for a miss), outward normals, triangles; rays run from `entry_m` to just past `end_m`."""
        starts = origin + self._radius_m * _ASIDE + entry_m[:, None] * directions
        longest_m = np.minimum(end_m - entry_m + _MARGIN * self._radius_m, _ENDLESS_M).astype(np.float32)
        triangle = self._scene.run(starts.astype(np.float32), directions.astype(np.float32), longest_m)
        hit = np.flatnonzero(triangle >= 0)
        distance_m, normals = np.full(len(directions), np.inf), np.full((len(directions), 3), np.nan)
        face_id = np.full(len(directions), -1)
        normals[hit] = self._normals[triangle[hit]]
        face_id[hit] = self._face_id[triangle[hit]]
        distance_m[hit] = self._distances(_of_rays(origin, hit), directions[hit], triangle[hit])
        return distance_m, normals, face_id

    def stops(
        self,
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
        entry_m: float,
        within_m: Float[np.ndarray, "n"],
    ) -> Bool[np.ndarray, "n"]:
        """Whether it stops rays before these distances, to single precision."""
        starts = (origin + entry_m * directions).astype(np.float32)
        lengths_m = np.maximum(within_m - entry_m, 0.0).astype(np.float32)
        return self._scene.run(starts, directions.astype(np.float32), lengths_m, query="OCCLUDED") >= 0

    def _distances(
        self, origin: Origins, directions: Float[np.ndarray, "n 3"], triangle: Int[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Distances to the planes of triangles that are known to be hit."""
        normals = self._normals[triangle]
        slope = np.einsum("ni,ni->n", normals, directions)
        above = self._offsets_m[triangle] - (normals @ origin if origin.ndim == 1 else np.sum(normals * origin, axis=1))
        with np.errstate(divide="ignore", invalid="ignore"):
            distance_m = above / slope
        weak = np.flatnonzero(self._is_sliver[triangle] | (np.abs(slope) < _GRAZING))
        distance_m[weak] = _plane_distance(
            _of_rays(origin, weak), directions[weak], self._corners[triangle[weak]], normals[weak]
        )
        return np.maximum(distance_m, 0)


def _of_rays(origin: Origins, rays: Int[np.ndarray, "n"]) -> Origins:
    """The origin or origins of some of the rays."""
    return origin if origin.ndim == 1 else origin[rays]


def _plane_distance(
    origin: Origins,
    directions: Float[np.ndarray, "n 3"],
    corners: Float[np.ndarray, "n 3 3"],
    normals: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """Distances to the planes of triangles that are known to be hit, so between their nearest and farthest corners.

    The bounds matter for slivers and for rays along the plane, whose quotient has no digits left.
    """
    corners = corners - origin[..., None, :]
    along = np.einsum("nki,ni->nk", corners, directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        plane_m = np.einsum("ni,ni->n", corners[:, 0], normals) / np.einsum("ni,ni->n", directions, normals)
    return np.maximum(np.fmin(np.fmax(plane_m, along.min(axis=1)), along.max(axis=1)), 0)


def _sphere_entry(
    origin: Origins,
    directions: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    radius_m: float,
) -> Float[np.ndarray, "n"]:
    """Where rays enter a sphere (0 from inside, or if it has no end); infinite for those that pass it by."""
    if not np.isfinite(radius_m):
        return np.zeros(len(directions))
    offset = centre - origin
    along = directions @ offset if offset.ndim == 1 else np.einsum("ni,ni->n", directions, offset)
    beside = offset - along[:, None] * directions
    half_chord_squared = radius_m**2 - np.einsum("ni,ni->n", beside, beside)
    half_chord = np.sqrt(np.maximum(half_chord_squared, 0))
    return np.where((half_chord_squared >= 0) & (along + half_chord >= 0), np.maximum(along - half_chord, 0), np.inf)

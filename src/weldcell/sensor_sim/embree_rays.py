"""Nearest hits by Embree for meshes and by closed forms for simple solids, a hundred times as fast as MuJoCo.

Each mesh has an Embree scene in its own frame, built once; rays are turned into the frame of the geom, so moving geoms
cost nothing. Embree computes in single precision. It only names the triangle: rays start at the mesh's bounding sphere,
so that rounding moves them sideways by 2e-7 of the mesh's radius at most (20 nm for a plate of 0.3 m), and the distance
is then the triangle's plane's in double precision. In robust mode its triangles have no gaps along shared edges.
"""

import mujoco
import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore import EmbreeDevice
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Bool, Float, Int

from weldcell.sensor_sim.mujoco_rays import MujocoRays
from weldcell.sensor_sim.solid_rays import SOLIDS, solid_hits

_MARGIN = 1e-4  # of a bounding sphere's radius: far above single precision's rounding
_ENDLESS_M = 1e30  # infinity would do as well, but for its warnings


class EmbreeRays:
    """Traces rays against chosen geoms of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        plane = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._radius_m = np.where(plane, np.inf, model.geom_rbound * (1 + _MARGIN))
        self._small_first = np.argsort(self._radius_m, kind="stable")  # what stands on the table shortens its rays
        self._device = EmbreeDevice()
        self._meshes: dict[int, _Mesh] = {}
        self._others: MujocoRays | None = None

    def nearest(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Distances (m), outward normals and geoms (-1 for a miss) of the first hits on the chosen geoms."""
        kinds = self._model.geom_type
        known = np.isin(kinds, (*SOLIDS, mujoco.mjtGeom.mjGEOM_MESH))
        distance_m, normals, geom_id = self._by_mujoco(data, chosen & ~known, origin, directions)
        for geom in self._small_first[(chosen & known)[self._small_first]]:
            entry_m = _sphere_entry(origin, directions, data.geom_xpos[geom], self._radius_m[geom])
            rays = np.flatnonzero(entry_m < distance_m)
            if len(rays) == 0:
                continue
            R_base_geom = data.geom_xmat[geom].reshape(3, 3)
            origin_geom = (origin - data.geom_xpos[geom]) @ R_base_geom
            stretch = entry_m[rays], distance_m[rays]
            met_m, normals_geom = self._meet(int(geom), origin_geom, directions[rays] @ R_base_geom, *stretch)
            nearer = met_m < distance_m[rays]
            rays = rays[nearer]
            distance_m[rays] = met_m[nearer]
            normals[rays] = normals_geom[nearer] @ R_base_geom.T
            geom_id[rays] = geom
        return distance_m, normals, geom_id

    def _meet(
        self,
        geom: int,
        origin_geom: Float[np.ndarray, "3"],
        directions_geom: Float[np.ndarray, "n 3"],
        entry_m: Float[np.ndarray, "n"],
        end_m: Float[np.ndarray, "n"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
        """Distances (infinite for a miss) and outward normals on one geom, in its frame; what lies beyond `end_m` may
        be missed.
        """
        if self._model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
            return solid_hits(self._model.geom_type[geom], self._model.geom_size[geom], origin_geom, directions_geom)
        mesh = int(self._model.geom_dataid[geom])
        if mesh not in self._meshes:
            self._meshes[mesh] = _Mesh(self._model, mesh, self._device)
        return self._meshes[mesh].hits(origin_geom, directions_geom, entry_m, end_m)

    def _by_mujoco(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Hits on geoms of the kinds that only MuJoCo knows (height fields, signed distance fields)."""
        if not chosen.any():
            count = len(directions)
            return np.full(count, np.inf), np.full((count, 3), np.nan), np.full(count, -1, np.int32)
        self._others = self._others or MujocoRays(self._model)
        distance_m, normals, geom_id = self._others.nearest(data, chosen, origin, directions)
        return np.where(geom_id >= 0, distance_m, np.inf), normals, geom_id


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
        self._corners = corners[kept]
        self._normals = normals[kept] / doubled_area[kept, None]
        self._radius_m = float(np.linalg.norm(vertices, axis=1).max())
        self._scene = EmbreeScene(device, robust=True)
        TriangleMesh(self._scene, self._corners.astype(np.float32))

    def hits(
        self,
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
        entry_m: Float[np.ndarray, "n"],
        end_m: Float[np.ndarray, "n"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
        """Distances (infinite for a miss) and outward normals; rays run from `entry_m` to a little past `end_m`."""
        starts = origin + entry_m[:, None] * directions
        longest_m = np.minimum(end_m - entry_m + _MARGIN * self._radius_m, _ENDLESS_M).astype(np.float32)
        triangle = self._scene.run(starts.astype(np.float32), directions.astype(np.float32), longest_m)
        hit = np.flatnonzero(triangle >= 0)
        distance_m, normals = np.full(len(directions), np.inf), np.full((len(directions), 3), np.nan)
        normals[hit] = self._normals[triangle[hit]]
        distance_m[hit] = _plane_distance(origin, directions[hit], self._corners[triangle[hit]], normals[hit])
        return distance_m, normals


def _plane_distance(
    origin: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    corners: Float[np.ndarray, "n 3 3"],
    normals: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """Distances to the planes of triangles that are known to be hit, so between their nearest and farthest corners.

    The bounds matter for slivers and for rays along the plane, whose quotient has no digits left.
    """
    corners = corners - origin
    along = np.einsum("nki,ni->nk", corners, directions)
    with np.errstate(divide="ignore", invalid="ignore"):
        plane_m = np.einsum("ni,ni->n", corners[:, 0], normals) / np.einsum("ni,ni->n", directions, normals)
    return np.maximum(np.fmin(np.fmax(plane_m, along.min(axis=1)), along.max(axis=1)), 0)


def _sphere_entry(
    origin: Float[np.ndarray, "3"],
    directions: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    radius_m: float,
) -> Float[np.ndarray, "n"]:
    """Where rays enter a sphere (0 from inside, or if it has no end); infinite for those that pass it by."""
    if not np.isfinite(radius_m):
        return np.zeros(len(directions))
    offset = centre - origin
    along = directions @ offset
    beside = offset - along[:, None] * directions
    half_chord_squared = radius_m**2 - np.einsum("ni,ni->n", beside, beside)
    half_chord = np.sqrt(np.maximum(half_chord_squared, 0))
    return np.where((half_chord_squared >= 0) & (along + half_chord >= 0), np.maximum(along - half_chord, 0), np.inf)

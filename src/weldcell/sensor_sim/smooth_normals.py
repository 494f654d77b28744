"""Normals of the smooth surfaces that meshes stand for: without them a curved mirror would be a mirror of facets.

A wall of 0.5 mm wide facets turns by 5 mrad from one to the next; its mirrored light would jump by tenths of a
millimetre. Vertices get the mean of the facets around them, each weighted with sin(angle) / (product of its two edges)
there, which is exact for vertices on a sphere and right to second order on strips of uneven width (Max, Weights for
computing vertex normals from facet normals, Journal of Graphics Tools 4, 1999). Within a triangle the vertices' normals
are interpolated (Phong, Communications of the ACM 18, 1975). Facets that meet at a crease belong to different surfaces.
"""

import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from weldcell.sensor_sim.rays import RayHits

_SLIVER_M = 20e-6  # height of a triangle below which vertices in single precision no longer tell its normal
_CREASE_RAD = np.deg2rad(20.0)  # facets of modelled curves turn by less, edges of parts by more


class SmoothNormals:
    """The smooth normals of a model's meshes, made when a mesh is first met."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._meshes: dict[int, _Mesh] = {}

    def at(self, data: mujoco.MjData, hits: RayHits) -> Float[np.ndarray, "n 3"]:
        """Outward unit normals at the hits, in the rays' frame (base); those of the hits where no triangle is known."""
        normals = hits.normals.copy()
        for geom in np.unique(hits.geom_id[hits.face_id >= 0]):
            here = np.flatnonzero((hits.geom_id == geom) & (hits.face_id >= 0))
            R_base_geom = data.geom_xmat[geom].reshape(3, 3)
            points_geom = (hits.points[here] - data.geom_xpos[geom]) @ R_base_geom
            smooth = self._mesh(int(self._model.geom_dataid[geom])).at(points_geom, hits.face_id[here]) @ R_base_geom.T
            outward = np.einsum("ni,ni->n", smooth, normals[here]) > 0  # a ray from inside has its normal turned
            normals[here] = np.where(outward[:, None], smooth, normals[here])
        return normals

    def _mesh(self, mesh: int) -> "_Mesh":
        if mesh not in self._meshes:
            first, count = self._model.mesh_vertadr[mesh], self._model.mesh_vertnum[mesh]
            vertices = self._model.mesh_vert[first : first + count].astype(float)
            first, count = self._model.mesh_faceadr[mesh], self._model.mesh_facenum[mesh]
            self._meshes[mesh] = _Mesh(vertices, self._model.mesh_face[first : first + count])
        return self._meshes[mesh]


class _Mesh:
    """Triangles with a normal for each corner; between them it is affine in the place, before it is made unit."""

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        places, merged = np.unique(vertices, axis=0, return_inverse=True)  # flat shading gave each triangle its own
        faces = merged.reshape(-1)[faces]
        corners = places[faces]
        edges = np.roll(corners, -1, axis=1) - corners
        normals = np.cross(edges[:, 0], edges[:, 1])
        area = np.linalg.norm(normals, axis=1)
        normals = normals / np.maximum(area, 1e-300)[:, None]
        surface = _smooth_surfaces(faces, normals)
        _, corner = np.unique(np.column_stack([faces.ravel(), np.repeat(surface, 3)]), axis=0, return_inverse=True)
        corner = corner.reshape(-1)
        weighted = (_weights(edges, area)[..., None] * normals[:, None]).reshape(-1, 3)
        sums = np.column_stack([np.bincount(corner, weighted[:, axis]) for axis in range(3)])
        at_corners = (sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-300)[:, None])[corner].reshape(-1, 3, 3)
        across = np.cross(
            normals[:, None], np.roll(edges, -1, axis=1)
        )  # of each corner's share: towards it, over height
        by_place = across / np.maximum(area, 1e-300)[:, None, None]
        self._gradients = np.einsum("fki,fkj->fij", at_corners, by_place)
        self._starts, self._normals = corners[:, 0], at_corners[:, 0]

    def at(self, points: Float[np.ndarray, "n 3"], face_id: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
        """Unit normals at points of these triangles."""
        away = points - self._starts[face_id]
        normals = self._normals[face_id] + np.einsum("nij,nj->ni", self._gradients[face_id], away)
        return normals / np.sqrt(np.einsum("ni,ni->n", normals, normals))[:, None]


def _smooth_surfaces(faces: Int[np.ndarray, "f 3"], normals: Float[np.ndarray, "f 3"]) -> Int[np.ndarray, "f"]:
    """The smooth surface that each triangle belongs to: neighbours without a crease between them share one."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort(edges.T)
    same = np.all(edges[order[1:]] == edges[order[:-1]], axis=1)
    one, other = order[:-1][same] // 3, order[1:][same] // 3
    smooth = np.einsum("ni,ni->n", normals[one], normals[other]) > np.cos(_CREASE_RAD)
    links = coo_array((np.ones(smooth.sum()), (one[smooth], other[smooth])), shape=(len(faces), len(faces)))
    return connected_components(links, directed=False)[1]


def _weights(edges: Float[np.ndarray, "f 3 3"], doubled_area: Float[np.ndarray, "f"]) -> Float[np.ndarray, "f 3"]:
    """Max's weight of each triangle at each of its corners; `edges` start there. Slivers, whose normals are rounding,
    weigh nothing.
    """
    length = np.maximum(np.linalg.norm(edges, axis=2), 1e-12)
    sliver = doubled_area < _SLIVER_M * length.max(axis=1)
    both = (length * np.roll(length, 1, axis=1)) ** 2
    return np.where(sliver[:, None], 0.0, doubled_area[:, None] / both)

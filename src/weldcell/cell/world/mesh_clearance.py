"""How far the real meshes of a scene are apart: MuJoCo itself collides their convex hulls, which fill every groove.

Distances are those of manifold3d's `Manifold.min_gap`: between triangles, 0 where solids overlap. It takes closed
solids. Of a mesh that is none (a user's part may be an open surface) the triangles nearby are taken, each as the outer
face of a flat tetrahedron: distances are exact on the outside and `_CRUST_M` too small behind it.
"""

import mujoco
import numpy as np
from jaxtyping import Float, Int
from manifold3d import Manifold, Mesh64

_CRUST_M = 1e-5  # thickness of the tetrahedra
_BEYOND_M = 1e-6  # a search must reach beyond the clearance, or all that is further away would seem to lie at its end
_FACES_OUTWARD = np.array([[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]])  # of a tetrahedron whose tip lies inside


class MeshClearance:
    """Distances between the mesh geoms of one model; each mesh is prepared when it is first asked for."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._meshes: dict[int, _Mesh] = {}

    def within(self, data: mujoco.MjData, first: int, second: int, clearance_m: float) -> bool:
        """Whether two mesh geoms are no further apart than the clearance; `data` needs up-to-date kinematics."""
        R_second_base = data.geom_xmat[second].reshape(3, 3).T
        turn = R_second_base @ data.geom_xmat[first].reshape(3, 3)
        offset = R_second_base @ (data.geom_xpos[first] - data.geom_xpos[second])
        reach_m = clearance_m + _BEYOND_M
        far = self._solid(first, turn.T, -turn.T @ offset, second, reach_m)
        near = self._solid(second, turn, offset, first, reach_m)
        return bool(near.min_gap(far.transform(np.column_stack([turn, offset])), reach_m) <= clearance_m)

    def _solid(
        self, geom: int, turn: Float[np.ndarray, "3 3"], offset: Float[np.ndarray, "3"], other: int, reach_m: float
    ) -> Manifold:
        """A geom's solid, or as much of its surface as comes near the box of the other, which stands there to it."""
        mesh = int(self._model.geom_dataid[geom])
        if mesh not in self._meshes:
            self._meshes[mesh] = _Mesh(self._model, mesh)
        centre, half = self._model.geom_aabb[other, :3], self._model.geom_aabb[other, 3:]
        return self._meshes[mesh].near(turn @ centre + offset, np.abs(turn) @ half + reach_m)


class _Mesh:
    """A mesh in its own frame."""

    def __init__(self, model: mujoco.MjModel, mesh: int) -> None:
        vertices, faces = _merged(model, mesh)
        solid = Manifold(Mesh64(vertices, faces.astype(np.uint64)))
        self._solid = solid if solid.volume() > 0 else None
        self._corners = vertices[faces]
        self._low, self._high = self._corners.min(axis=1), self._corners.max(axis=1)

    def near(self, centre: Float[np.ndarray, "3"], half_m: Float[np.ndarray, "3"]) -> Manifold:
        """The whole solid; of an open surface the crust within a box, its edges along the axes."""
        if self._solid is not None:
            return self._solid
        inside = np.all((self._low <= centre + half_m) & (self._high >= centre - half_m), axis=1)
        return _crust(self._corners[inside])


def _merged(model: mujoco.MjModel, mesh: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Vertices and triangles of a mesh with each place once: flat shading gives every triangle corners of its own."""
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices, places = np.unique(model.mesh_vert[first : first + count], axis=0, return_inverse=True)
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    faces = places.ravel()[model.mesh_face[first : first + count]]
    in_order = np.sort(faces, axis=1)
    return vertices.astype(float), faces[np.all(np.diff(in_order, axis=1) > 0, axis=1)]


def _crust(corners: Float[np.ndarray, "m 3 3"]) -> Manifold:
    """A flat tetrahedron behind each triangle."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled_area = np.linalg.norm(normals, axis=1)
    flat = doubled_area == 0  # it has neighbours with area along all of its sides
    corners, normals = corners[~flat], normals[~flat] / doubled_area[~flat, None]
    tips = corners.mean(axis=1) - _CRUST_M * normals
    vertices = np.concatenate([corners, tips[:, None]], axis=1).reshape(-1, 3)
    faces = (4 * np.arange(len(corners))[:, None, None] + _FACES_OUTWARD).reshape(-1, 3)
    return Manifold(Mesh64(vertices, faces.astype(np.uint64)))

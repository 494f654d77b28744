"""Flat faces of a mesh with triangles of good shape, among which a ray is found several times as fast as among needles.

Booleans join the hundreds of points along a groove's edge to a plate's far corners: needles as long as the plate, each
in a box that holds half of it. Here points are added within such faces, sparser the further they are from the border,
and the face is triangulated anew after Delaunay. The surface stays what it was, to rounding; borders keep their points.
A face whose border is not among the new triangles' sides keeps its old triangles.
"""

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay, KDTree

_FEWEST = 50  # triangles of a face worth the work
_FLAT_M = 1e-12  # a curved wall's narrow triangles may pass for a flat face
_FINEST_M, _GROWTH, _LEVELS = 5e-3, 2.0, 4  # spacings of grids; the first one's points lie nearest to the border
_BORDER_SHARE = 1.2  # points of a grid keep this many of its spacings from all that is there before


def well_shaped(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "l 3"]]:
    """The same closed surface, its large flat faces triangulated anew; needs oriented triangles."""
    kept, added, points, count = np.ones(len(faces), bool), [], [vertices], len(vertices)
    for facet in trimesh.Trimesh(vertices, faces, process=False).facets:
        if len(facet) < _FEWEST:
            continue
        face = _Face(vertices, faces[facet])
        if face.unevenness_m > _FLAT_M:
            continue
        inner = face.inner_points()
        triangles = face.triangulated(inner)
        if triangles is None:
            continue
        kept[facet] = False
        added.append(np.concatenate([face.border, count + np.arange(len(inner))])[triangles])
        points.append(face.lifted(inner))
        count += len(inner)
    used, numbers = np.unique(np.concatenate([faces[kept], *added]), return_inverse=True)
    return np.concatenate(points)[used], numbers.reshape(-1, 3)


class _Face:
    """A flat face in its own plane."""

    def __init__(self, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> None:
        self.edges = _single(faces)
        self.border = np.unique(self.edges)
        """Its vertices that stay."""
        corners = vertices[faces]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(axis=0)
        normal = np.round(normal / np.linalg.norm(normal), 15)
        first = np.eye(3)[np.argmin(np.abs(normal))]
        first = first - (first @ normal) * normal
        first = first / np.linalg.norm(first)
        self._axes, self._origin = np.stack([first, np.cross(normal, first)]), vertices[self.border[0]]
        self.unevenness_m = float(np.abs((vertices[faces] - self._origin) @ normal).max())
        """How far its vertices are off its plane."""
        self._flat = (vertices[self.border] - self._origin) @ self._axes.T
        self._ends = self._flat[np.searchsorted(self.border, self.edges)]

    def lifted(self, flat: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 3"]:
        """Points of the plane in space."""
        return self._origin + flat @ self._axes

    def inner_points(self) -> Float[np.ndarray, "k 2"]:
        """Points within, on square grids: finer ones only near what is there before."""
        known, (low, high) = self._flat, (self._flat.min(axis=0), self._flat.max(axis=0))
        for level in range(_LEVELS):
            step = _FINEST_M * _GROWTH**level
            u, v = (np.arange(low[axis] + step / 2, high[axis], step) for axis in (0, 1))
            grid = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
            apart, _ = KDTree(known).query(grid)
            near = grid[(apart > _BORDER_SHARE * step) & (apart < 2 * _GROWTH * step)]
            known = np.concatenate([known, near[self._inside(near)]])
        return known[len(self._flat) :]

    def triangulated(self, inner: Float[np.ndarray, "k 2"]) -> Int[np.ndarray, "t 3"] | None:
        """Triangles of border and inner points; None if the border is not among their sides."""
        flat = np.concatenate([self._flat, inner])
        triangles = Delaunay(flat).simplices
        corners = flat[triangles]
        (u1, v1), (u2, v2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
        across = u1 * v2 - v1 * u2
        triangles[across < 0] = triangles[across < 0][:, ::-1]
        triangles = triangles[(across != 0) & self._inside(corners.mean(axis=1))]
        sides, wanted = _single(triangles), np.searchsorted(self.border, self.edges)
        same = len(sides) == len(wanted) and set(map(tuple, sides.tolist())) == set(map(tuple, wanted.tolist()))
        return triangles if same else None

    def _inside(self, points: Float[np.ndarray, "k 2"]) -> Bool[np.ndarray, "k"]:
        """Whether points lie within: a ray to one side crosses the border an odd number of times."""
        (x0, y0), (x1, y1) = self._ends[:, 0].T, self._ends[:, 1].T
        inside = np.zeros(len(points), bool)
        for some in np.array_split(np.arange(len(points)), 1 + len(points) // 1000):
            x, y = points[some].T[:, :, None]
            spans = (y0 <= y) != (y1 <= y)
            with np.errstate(divide="ignore", invalid="ignore"):
                meets = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
            inside[some] = np.sum(spans & (meets > x), axis=1) % 2 == 1
        return inside


def _single(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "e 2"]:
    """Directed sides of triangles that no neighbour among them shares."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    _, which, counts = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True)
    return sides[counts[which.ravel()] == 1]

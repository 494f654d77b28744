"""Lines along a mesh's sharp edges: where a seam runs, picked by a point near it.

From the sharp edge nearest to the point the line goes on both ways. At a corner it takes the sharp edge that turns
least, if that turns by less than 45 deg and does not itself go on straighter elsewhere; else it ends there.
"""

from collections import defaultdict
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Float, Int

from weldcell.cell.errors import BadGeometry

EdgeKind = Literal["concave", "convex", "all"]
"""Inner corners, outer corners, or both with the rims of open surfaces."""

_STRAIGHTER_THAN = np.cos(np.radians(45))


@dataclass(frozen=True, kw_only=True, eq=False)
class SharpLine:
    """A line along sharp edges."""

    points: Float[np.ndarray, "n 3"]
    """Corners along the line, in the mesh's frame and unit; of a ring the first one comes again at the end."""
    ring: bool
    """Whether it closes."""
    distance: float
    """How far the point that picked it lies from it, in the mesh's unit."""


def sharp_line(
    mesh: trimesh.Trimesh, near: Float[np.ndarray, "3"], *, sharper_than_rad: float, kind: EdgeKind = "all"
) -> SharpLine:
    """The line of sharp edges nearest to a point; it starts at its end nearer to the point.

    An edge is sharp if the normals on either side differ by more than `sharper_than_rad`. A ring starts at its corner
    nearest to the point and runs counter-clockwise seen from above. Raises BadGeometry if no edge is sharp.
    """
    edges = sharp_edges(mesh, sharper_than_rad, kind)
    if not len(edges):
        raise BadGeometry(
            f"found no {'' if kind == 'all' else kind + ' '}edge sharper than {np.degrees(sharper_than_rad):.4g} deg, "
            "expected one where the seam runs"
        )
    vertices = np.asarray(mesh.vertices)
    distances = _distances(near, vertices[edges[:, 0]], vertices[edges[:, 1]])
    nearest = int(np.argmin(distances))
    corners = _walk(vertices, edges, nearest)
    ring = corners[0] == corners[-1]
    points = vertices[_ordered(vertices, corners, ring, near)]
    return SharpLine(points=points, ring=bool(ring), distance=float(distances[nearest]))


def sharp_edges(mesh: trimesh.Trimesh, sharper_than_rad: float, kind: EdgeKind) -> Int[np.ndarray, "k 2"]:
    """Pairs of corners that are the ends of a sharp edge."""
    sharp = mesh.face_adjacency_angles > sharper_than_rad
    if kind != "all":
        sharp &= mesh.face_adjacency_convex == (kind == "convex")
    edges = mesh.face_adjacency_edges[sharp]
    if kind == "all":
        rims = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
        edges = np.vstack([edges, mesh.edges_sorted[rims]])
    return np.asarray(edges)


def _walk(vertices: Float[np.ndarray, "n 3"], edges: Int[np.ndarray, "k 2"], first: int) -> list[int]:
    """Corners of the line through the first edge; the first corner again at the end of a ring."""
    around: dict[int, list[int]] = defaultdict(list)
    for one, other in edges.tolist():
        around[one].append(other)
        around[other].append(one)
    start, second = edges[first].tolist()
    forth = _onwards(vertices, around, start, second)
    if forth[-1] == start:
        return forth
    return _onwards(vertices, around, second, start)[:1:-1] + forth


def _onwards(vertices: Float[np.ndarray, "n 3"], around: dict[int, list[int]], start: int, second: int) -> list[int]:
    """Corners from the first edge on, until the line ends or comes back to where it started."""
    corners, seen = [start, second], {(start, second)}
    while True:
        before, here = corners[-2:]
        following = _straightest(vertices, around, before, here)
        if following is None or _straightest(vertices, around, following, here) != before:
            return corners
        if (here, following) in seen:
            return corners
        seen |= {(here, following), (following, here)}
        corners.append(following)


def _straightest(
    vertices: Float[np.ndarray, "n 3"], around: dict[int, list[int]], before: int, here: int
) -> int | None:
    """The corner that goes on straightest, if any is straight enough."""
    ahead = [corner for corner in around[here] if corner != before]
    if not ahead:
        return None
    arriving, leaving = vertices[here] - vertices[before], vertices[ahead] - vertices[here]
    straightness = leaving @ arriving / (np.linalg.norm(leaving, axis=1) * np.linalg.norm(arriving))
    best = int(np.argmax(straightness))
    return ahead[best] if straightness[best] > _STRAIGHTER_THAN else None


def _ordered(
    vertices: Float[np.ndarray, "n 3"], corners: list[int], ring: bool, near: Float[np.ndarray, "3"]
) -> list[int]:
    """The corners in the order of the seam's travel."""
    if not ring:
        ends = np.linalg.norm(vertices[[corners[0], corners[-1]]] - near, axis=1)
        return corners if ends[0] <= ends[1] else corners[::-1]
    loop = corners[:-1]
    begin = int(np.argmin(np.linalg.norm(vertices[loop] - near, axis=1)))
    loop = loop[begin:] + loop[:begin] + [loop[begin]]
    x, y = vertices[loop, 0] - vertices[loop, 0].mean(), vertices[loop, 1] - vertices[loop, 1].mean()
    clockwise = np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) < 0
    return loop[::-1] if clockwise else loop


def _distances(
    point: Float[np.ndarray, "3"], starts: Float[np.ndarray, "k 3"], ends: Float[np.ndarray, "k 3"]
) -> Float[np.ndarray, "k"]:
    """Distance of a point to each of many edges."""
    steps, offsets = ends - starts, point - starts
    share = np.clip(np.einsum("ki,ki->k", offsets, steps) / np.einsum("ki,ki->k", steps, steps), 0, 1)
    return np.linalg.norm(offsets - share[:, None] * steps, axis=1)

"""Watertight solids for the generated models: rounded rods and boxes, turned parts, hulls and hoses.

All lengths are in metres, all solids in the frame of the body that they belong to.
"""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import trimesh
from jaxtyping import Float
from manifold3d import CrossSection, Manifold, Mesh64
from numpy.typing import ArrayLike

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import axes_rotation

_SEGMENTS = 48  # facets round a full turn: smooth to the eye at the cell's scale
_ARC_STEPS = 3  # facets of a rounded edge (a quarter turn)


def turned(outline_rz: Sequence[tuple[float, float]], segments: int = _SEGMENTS) -> Manifold:
    """The solid of revolution about z of a closed outline of (radius, height) points, counter-clockwise."""
    return Manifold.revolve(CrossSection([np.asarray(outline_rz, float)]), segments)


def rod(
    start: ArrayLike,
    end: ArrayLike,
    radius: float,
    *,
    edge: float = 0.004,
    end_radius: float | None = None,
    segments: int = _SEGMENTS,
) -> Manifold:
    """A round (or, with `end_radius`, conical) rod between two points with edges rounded by `edge`."""
    axis = np.asarray(end, float) - np.asarray(start, float)
    length = float(np.linalg.norm(axis))
    top = radius if end_radius is None else end_radius
    edge = min(edge, 0.49 * length, 0.9 * radius, 0.9 * top)
    turn = np.linspace(0, np.pi / 2, _ARC_STEPS + 1)
    low = [(radius - edge + edge * np.sin(a), edge - edge * np.cos(a)) for a in turn]
    high = [(top - edge + edge * np.cos(a), length - edge + edge * np.sin(a)) for a in turn]
    return place(turned([(0, 0), *low, *high, (0, length)], segments), start, axis)


def ball(centre: ArrayLike, radius: float, segments: int = _SEGMENTS) -> Manifold:
    """A sphere."""
    return Manifold.sphere(radius, segments).translate(tuple(np.asarray(centre, float)))


def box(low: ArrayLike, high: ArrayLike, edge: float = 0.004) -> Manifold:
    """An axis-aligned box between two opposite corners, all its edges rounded by `edge`."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, float) + edge, np.asarray(high, float) - edge
    return hull(ball((x, y, z), edge, 12) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1))


def slab(outline_xz: Sequence[tuple[float, float]], half_width: float, edge: float = 0.004) -> Manifold:
    """A convex plate in x and z, from y = -half_width to half_width, all its edges rounded by `edge`.

    The outline is that of the centres of the rounding: the plate reaches `edge` beyond it.
    """
    inner = half_width - edge
    return hull(ball((x, y, z), edge, 12) for x, z in outline_xz for y in (-inner, inner))


def hull(solids: Iterable[Manifold]) -> Manifold:
    """The convex hull of all solids together."""
    return Manifold.batch_hull(list(solids))


def chain(solids: Sequence[Manifold]) -> Manifold:
    """The union of the hulls of neighbouring solids: a casting that is led along a line of sections."""
    return join(hull(pair) for pair in pairwise(solids))


def join(solids: Iterable[Manifold]) -> Manifold:
    """The union of all solids."""
    total = Manifold()
    for solid in solids:
        total = total + solid
    return total


def place(solid: Manifold, origin: ArrayLike, z: ArrayLike) -> Manifold:
    """The solid with its z axis turned to `z` (its x stays level where it can) and moved to `origin`."""
    direction = np.asarray(z, float)
    direction = direction / np.linalg.norm(direction)
    x = np.array([1.0, 0, 0]) if abs(direction[0]) < 0.9 else np.array([0, 0, -1.0])
    rotation = axes_rotation(x, direction).as_matrix()
    return solid.transform(np.column_stack([rotation, np.asarray(origin, float)]))


def bolt_circle(origin: ArrayLike, z: ArrayLike, *, radius: float, count: int, bolt: float, height: float) -> Manifold:
    """Hexagon bolt heads of half-width `bolt` on a circle about the axis `z` through `origin`."""
    head = Manifold.cylinder(height, bolt, -1.0, 6)
    turns = 2 * np.pi * (np.arange(count) + 0.5) / count
    heads = Manifold.compose([head.translate((radius * np.cos(a), radius * np.sin(a), 0)) for a in turns])
    return place(heads, origin, z)


def bezier(control: ArrayLike, count: int = 24) -> Float[np.ndarray, "n 3"]:
    """Points on the cubic Bezier curve of four control points."""
    t = np.linspace(0, 1, count)[:, None]
    a, b, c, d = np.asarray(control, float)
    return (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t**2 * (1 - t) * c + t**3 * d


def hose(path: Float[np.ndarray, "n 3"], radius: float, segments: int = 14) -> Manifold:
    """A tube of solid round section along a path, with flat ends."""
    tangents = np.gradient(path, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    side = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    turns = 2 * np.pi * np.arange(segments) / segments
    rings = []
    for point, tangent in zip(path, tangents, strict=True):  # each ring takes over the last one's side direction
        side = side - tangent * (side @ tangent)
        side /= np.linalg.norm(side)
        up = np.cross(tangent, side)
        rings.append(point + radius * (np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * up))
    return loft(np.array(rings))


def loft(rings: Float[np.ndarray, "n k 3"]) -> Manifold:
    """The solid through rings of points; each turns counter-clockwise seen from the last ring's side."""
    n, k = rings.shape[:2]
    vertices = np.concatenate([rings.reshape(-1, 3), rings[[0, -1]].mean(axis=1)])
    here = (np.arange(n - 1)[:, None] * k + np.arange(k)).ravel()
    beside = (np.arange(n - 1)[:, None] * k + (np.arange(k) + 1) % k).ravel()
    walls = np.concatenate(
        [np.stack([here, beside, beside + k], axis=1), np.stack([here, beside + k, here + k], axis=1)]
    )
    first, following = np.arange(k), (np.arange(k) + 1) % k
    start = np.stack([following, first, np.full(k, n * k)], axis=1)
    end = np.stack([first + (n - 1) * k, following + (n - 1) * k, np.full(k, n * k + 1)], axis=1)
    return solid_of(vertices, np.concatenate([walls, start, end]))


def solid_of(vertices: Float[np.ndarray, "n 3"], faces: np.ndarray) -> Manifold:
    """The solid of a closed mesh; refused unless it is an oriented manifold."""
    mesh = Mesh64(np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(faces, np.uint64))
    solid = Manifold(mesh)
    if solid.is_empty() or solid.volume() <= 0:
        raise BadGeometry(f"mesh: expected a closed solid with outward faces, found {solid.status()}")
    return solid


def to_trimesh(solid: Manifold) -> trimesh.Trimesh:
    """The solid's surface as triangles, its vertices merged."""
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int64), process=False)

"""Meshes from outside made sound: corners shared, triangles of one orientation, faces outwards.

Orientation is a two-colouring. Two triangles that share an edge agree if they run along it in opposite directions.
Each triangle gets two nodes, one for each way to turn it, and edges join the ways that agree; then each shell is two
connected components, of which one is taken. A shell that cannot be oriented (a Moebius strip) is one component and
stays.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from weldcell.cell.errors import BadGeometry

_EXACT_DIGITS, _MICROMETRE_DIGITS = 9, 6  # after the point, in metres
_FLAT_RATIO = 1e-3  # of a sheet: its volume over its area to the power of 3/2 (a ball has 0.094)


@dataclass(frozen=True, kw_only=True, eq=False)
class SoundMesh:
    """A mesh whose triangles share corners and have one orientation, and what had to be done for it."""

    vertices: Float[np.ndarray, "n 3"]
    """Corners, m."""
    faces: Int[np.ndarray, "m 3"]
    """Three vertex indices a triangle, counter-clockwise seen from outside."""
    remarks: tuple[str, ...]
    """What was odd, in words."""

    @cached_property
    def closed(self) -> bool:
        """Whether every edge belongs to two triangles that run along it in opposite directions."""
        open_edges, crowded_edges = edge_faults(self.faces)
        return not open_edges and not crowded_edges and bool(self._mesh.is_winding_consistent)

    @property
    def _mesh(self) -> trimesh.Trimesh:
        return trimesh.Trimesh(self.vertices, self.faces, process=False)


def sound_mesh(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> SoundMesh:
    """The mesh (m) with shared corners, without triangles that have no area, with its faces outwards."""
    given = len(faces)
    vertices, faces = _merged(vertices, faces, _EXACT_DIGITS)
    if any(edge_faults(faces)):
        vertices, faces = _merged(vertices, faces, _MICROMETRE_DIGITS)
    if not len(faces):
        raise BadGeometry(f"found {given} triangles, none with an area, expected a surface")
    remarks = [f"{given - len(faces)} of {given} triangles have no area or occur twice: left out"]
    if given == len(faces):
        remarks = []
    faces, turned = _outward(vertices, faces)
    return SoundMesh(vertices=vertices, faces=faces, remarks=(*remarks, *turned, *_openness(faces)))


def edge_faults(faces: Int[np.ndarray, "m 3"]) -> tuple[int, int]:
    """How many edges belong to one triangle only, and how many to more than two."""
    _, _, counts = _edges(faces)
    return int(np.sum(counts == 1)), int(np.sum(counts > 2))


def _openness(faces: Int[np.ndarray, "m 3"]) -> list[str]:
    open_edges, crowded_edges = edge_faults(faces)
    remarks = []
    if open_edges:
        remarks.append(
            f"open: {open_edges} edges belong to one triangle only; taken as a surface without inside (light that "
            "comes through a hole sees the far wall); close it in the CAD program for a solid"
        )
    if crowded_edges:
        remarks.append(f"not a solid: {crowded_edges} edges belong to more than two triangles; taken as a surface")
    return remarks


def _merged(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], digits: int
) -> tuple[Float[np.ndarray, "k 3"], Int[np.ndarray, "j 3"]]:
    """The mesh with corners that agree to so many digits made one; without triangles that lose their area."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices(digits_vertex=digits, merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.unique_faces())
    corners = mesh.vertices[mesh.faces]
    mesh.update_faces(np.any(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) != 0, axis=1))
    mesh.remove_unreferenced_vertices()
    return np.array(mesh.vertices), np.array(mesh.faces)


def _outward(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> tuple[Int[np.ndarray, "m 3"], list[str]]:
    """The triangles of each shell turned to one orientation, outwards; of a sheet upwards."""
    shell, turn = _two_colouring(faces)
    faces = np.where(turn[:, None], faces[:, ::-1], faces)
    inward = _inward(vertices, faces, shell)
    faces = np.where(inward[shell][:, None], faces[:, ::-1], faces)
    turned = turn ^ inward[shell]
    shells, inside_out = len(inward), int(np.sum(np.bincount(shell, ~turned) == 0))
    remarks = []
    if inside_out:
        remarks.append(f"{inside_out} of {shells} shells inside out: turned")
    mixed = turned & (np.bincount(shell, ~turned) > 0)[shell]
    if mixed.any():
        remarks.append(f"{int(mixed.sum())} triangles against the orientation of their neighbours: turned")
    return faces, remarks


def _two_colouring(faces: Int[np.ndarray, "m 3"]) -> tuple[Int[np.ndarray, "m"], Bool[np.ndarray, "m"]]:
    """The shell of each triangle, and whether to turn it so that its shell has one orientation (the majority's)."""
    order, forward, counts = _edges(faces)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])[counts == 2]
    one, other = order[first] // 3, order[first + 1] // 3
    disagree = forward[first] == forward[first + 1]
    count = len(faces)
    shell = _components(np.concatenate([one]), np.concatenate([other]), count)
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * disagree, other + count * ~disagree])
    colour = _components(rows, columns, 2 * count)
    least = np.full(shell.max() + 1, 2 * count)
    np.minimum.at(least, shell, colour[:count])
    turn = colour[:count] != least[shell]
    turn &= colour[:count] != colour[count:]  # cannot be oriented
    most = np.bincount(shell, turn) > 0.5 * np.bincount(shell)
    return shell, turn ^ (most[shell] & (colour[:count] != colour[count:]))


def _edges(
    faces: Int[np.ndarray, "m 3"],
) -> tuple[Int[np.ndarray, "e"], Bool[np.ndarray, "e"], Int[np.ndarray, "k"]]:
    """Half-edges (3 x triangle + corner) sorted by edge, whether each runs upwards, and how many each edge has."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2).astype(np.int64)
    low, high = ends.min(axis=1), ends.max(axis=1)
    key = low * (int(faces.max(initial=0)) + 1) + high
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    return order, (ends[:, 0] == low)[order], np.diff(starts, append=len(key))


def _components(rows: Int[np.ndarray, "e"], columns: Int[np.ndarray, "e"], count: int) -> Int[np.ndarray, "m"]:
    graph = coo_array((np.ones(len(rows), np.int8), (rows, columns)), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def _inward(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], shell: Int[np.ndarray, "m"]
) -> Bool[np.ndarray, "shells"]:
    """Whether a shell's faces look inwards: its volume about its own centre is negative; of a sheet, downwards."""
    corners = vertices[faces]
    middles = corners.mean(axis=1)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(doubled, axis=1)
    total = np.bincount(shell, area)
    centre = np.stack([np.bincount(shell, area * middles[:, k]) for k in range(3)], axis=1) / total[:, None]
    volume = np.bincount(shell, np.einsum("ij,ij->i", middles - centre[shell], doubled)) / 6
    upwards = np.bincount(shell, doubled[:, 2])
    flat = np.abs(volume) < _FLAT_RATIO * total**1.5
    return np.where(flat & (np.abs(upwards) > 1e-9 * total), upwards < 0, volume < 0)

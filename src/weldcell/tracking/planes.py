"""The flat faces in a cloud of points: how many, where, and which points belong to each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

_NEIGHBOURS = 20  # cells that give a cell its normal
_STRAY_SHARE = 0.4  # cells with fewer points than this share of the usual number hold strays
_CANDIDATES = 256
_LEAST_NORMAL_COSINE = np.cos(np.deg2rad(15))
_FLAT_SHARE = 0.02  # least eigenvalue over the sum: larger is an edge
_NORMAL_ROUNDS = 3
_LEAST_PATCH_SHARE = 0.6
_WIDENINGS = (3.0, 2.0, 1.0, 1.0)  # of the tolerance: a local normal is out by a degree or so
_TUKEY = 4.685
_LEAST_SCATTER_M = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Plane:
    """A flat face n.p = d, in the frame of the points it was fitted to."""

    normal: Float[np.ndarray, "3"]
    """Unit normal, on the side of `towards`."""
    offset_m: float
    centre: Float[np.ndarray, "3"]
    """Mean of the points that it was fitted to."""
    inliers: Bool[np.ndarray, "n"]
    """Which of the points it was fitted to: clear of the face's edges."""
    rms_m: float
    """Root mean square distance of these points."""


def fit_planes(
    points: Float[np.ndarray, "n 3"],
    *,
    towards: tuple[float, float, float] = (0.0, 0.0, 1.0),
    most_planes: int = 8,
    cell_m: float = 1e-3,
    tolerance_m: float = 2e-4,
    least_share: float = 0.01,
    edge_m: float = 1.5e-3,
) -> list[Plane]:
    """The planes of a cloud (NaN rows are passed over), the one with the largest area first.

    The cloud is averaged over cells of `cell_m`, which makes area count and not the density of points. The largest
    plane is found among the cells' own local planes, its cells are taken out, and so on, until less than
    `least_share` of the cells is left to one. The final robust fit is to the points themselves, those within
    `edge_m` of another face or an edge left out. `towards` points to the side from which the faces were seen.
    No random numbers: the same points give the same planes.
    """
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    cloud = points[finite]
    if len(cloud) < 3 * _NEIGHBOURS:
        return []
    cell_of_point, cells = _averaged(cloud, cell_m)
    dense = cell_of_point >= 0
    finite, cell_of_point = finite[dense], cell_of_point[dense]
    if len(cells) <= _NEIGHBOURS:
        return []
    tree = cKDTree(cells)
    neighbours = tree.query(cells, _NEIGHBOURS)[1]
    normals, flat = _local_normals(cells[neighbours])
    face = _grown_faces(cells, normals, flat, most_planes, tolerance_m, max(_NEIGHBOURS, int(least_share * len(cells))))
    clear = _clear_of_edges(tree, face, edge_m)
    direction = np.asarray(towards, dtype=float)
    planes = []
    for label in range(face.max() + 1):
        own = ((face == label) & clear)[cell_of_point]
        if own.sum() >= _NEIGHBOURS:
            planes.append(_final_plane(points, finite, np.flatnonzero(own), direction))
    return planes


def _averaged(
    cloud: Float[np.ndarray, "n 3"], cell_m: float
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "cells 3"]]:
    """The cell of each point (-1 for cells that hold only strays), and the mean point of each cell."""
    grid = np.floor((cloud - cloud.min(axis=0)) / cell_m).astype(np.int64)
    sides = grid.max(axis=0) + 1
    key = (grid[:, 0] * sides[1] + grid[:, 1]) * sides[2] + grid[:, 2]
    cell_of_point, count = np.unique(key, return_inverse=True, return_counts=True)[1:]
    sums = np.column_stack([np.bincount(cell_of_point, weights=cloud[:, axis]) for axis in range(3)])
    kept = count >= _STRAY_SHARE * np.median(count[cell_of_point])
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    return number[cell_of_point], sums[kept] / count[kept, None]


def _local_normals(
    patches: Float[np.ndarray, "cells near 3"],
) -> tuple[Float[np.ndarray, "cells 3"], Bool[np.ndarray, "cells"]]:
    """Normal of each patch of neighbours, and whether most of the patch is flat; strays in it are left out."""
    weight = np.ones(patches.shape[:2])
    for _ in range(_NORMAL_ROUNDS):
        share = weight / weight.sum(axis=1, keepdims=True)
        offsets = patches - np.einsum("cn,cni->ci", share, patches)[:, None]
        values, vectors = np.linalg.eigh(np.einsum("cn,cni,cnj->cij", share, offsets, offsets, optimize=True))
        distance = np.abs(np.einsum("cni,ci->cn", offsets, vectors[:, :, 0]))
        weight = (distance <= 3 * np.median(distance, axis=1, keepdims=True)).astype(float)
    flat = values[:, 0] < _FLAT_SHARE * values.sum(axis=1)
    return vectors[:, :, 0], flat & (weight.mean(axis=1) > _LEAST_PATCH_SHARE)


def _grown_faces(
    cells: Float[np.ndarray, "cells 3"],
    normals: Float[np.ndarray, "cells 3"],
    flat: Bool[np.ndarray, "cells"],
    most_planes: int,
    tolerance_m: float,
    least_cells: int,
) -> Int[np.ndarray, "cells"]:
    """The number of the face that each cell belongs to, -1 for none."""
    face, left, label = np.full(len(cells), -1), flat.copy(), 0
    for _ in range(2 * most_planes):
        free = np.flatnonzero(left)
        if len(free) < least_cells or label == most_planes:
            break
        normal, offset = _best_candidate(cells[free], normals[free], tolerance_m)
        for widening in _WIDENINGS:
            members = free[_on_plane(cells[free], normals[free], normal, offset, widening * tolerance_m)]
            if len(members) < least_cells:
                break
            centre = cells[members].mean(axis=0)
            normal = np.linalg.eigh(np.cov((cells[members] - centre).T))[1][:, 0]
            offset = float(normal @ centre)
        left[members] = False  # also if they are too few: another candidate has its turn
        if len(members) >= least_cells:
            face[(face < 0) & _on_plane(cells, normals, normal, offset, tolerance_m)] = label
            label += 1
    return face


def _best_candidate(
    cells: Float[np.ndarray, "cells 3"], normals: Float[np.ndarray, "cells 3"], tolerance_m: float
) -> tuple[Float[np.ndarray, "3"], float]:
    """The local plane, of evenly picked ones, that the most cells lie on."""
    picked = np.unique(np.linspace(0, len(cells) - 1, _CANDIDATES).astype(int))
    offsets = np.einsum("ij,ij->i", cells[picked], normals[picked])
    sample = slice(None, None, max(1, len(cells) // 4000))
    close = np.abs(cells[sample] @ normals[picked].T - offsets) < _WIDENINGS[0] * tolerance_m
    alike = np.abs(normals[sample] @ normals[picked].T) > _LEAST_NORMAL_COSINE
    best = int((close & alike).sum(axis=0).argmax())
    return normals[picked[best]], float(offsets[best])


def _on_plane(
    cells: Float[np.ndarray, "cells 3"],
    normals: Float[np.ndarray, "cells 3"],
    normal: Float[np.ndarray, "3"],
    offset: float,
    tolerance_m: float,
) -> Bool[np.ndarray, "cells"]:
    return (np.abs(cells @ normal - offset) < tolerance_m) & (np.abs(normals @ normal) > _LEAST_NORMAL_COSINE)


def _clear_of_edges(tree: cKDTree, face: Int[np.ndarray, "cells"], edge_m: float) -> Bool[np.ndarray, "cells"]:
    """Cells of a face with no cell of another face within `edge_m`."""
    pairs = tree.query_pairs(edge_m, output_type="ndarray")
    first, second = face[pairs[:, 0]], face[pairs[:, 1]]
    clear = face >= 0
    clear[pairs[(first != second) & (first >= 0) & (second >= 0)].ravel()] = False
    return clear


def _final_plane(
    points: Float[np.ndarray, "n 3"],
    finite: Int[np.ndarray, "m"],
    own: Int[np.ndarray, "k"],
    direction: Float[np.ndarray, "3"],
) -> Plane:
    """The plane of least robust squares (Tukey's biweight on the distance) through one face's own points."""
    cloud = points[finite[own]]
    weight = np.ones(len(cloud))
    for _ in range(5):
        centre = weight @ cloud / weight.sum()
        offsets = cloud - centre
        normal = np.linalg.eigh(offsets.T @ (weight[:, None] * offsets))[1][:, 0]
        distance = offsets @ normal
        scatter = max(1.4826 * float(np.median(np.abs(distance))), _LEAST_SCATTER_M)
        weight = np.maximum(1 - (distance / (_TUKEY * scatter)) ** 2, 0) ** 2
    normal = normal if normal @ direction >= 0 else -normal
    inliers = np.zeros(len(points), dtype=bool)
    inliers[finite[own[weight > 0]]] = True
    return Plane(
        normal=normal,
        offset_m=float(normal @ centre),
        centre=centre,
        inliers=inliers,
        rms_m=float(np.sqrt(np.mean(distance[weight > 0] ** 2))),
    )

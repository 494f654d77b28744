"""A user's own part as a workpiece: unit, up, orientation and place put right, its seam beside it.

The part frame is that of every workpiece (origin at the underside's centre, z up); `T_part_drawn` brings points of
the file's own frame (in metres) there. What can be read in one sensible way is not refused: it is done and remarked on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import MaterialName
from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from
from weldcell.cell.seam import Seam, nearest_on_polyline
from weldcell.models.mesh_repair import SoundMesh, sound_mesh
from weldcell.models.sharp_edges import EdgeKind, sharp_line
from weldcell.models.workpiece import Workpiece

Unit = Literal["mm", "m"]
Up = Literal["x", "y", "z", "-x", "-y", "-z"]
"""Which axis of the file points up."""

_UNIT_M: dict[Unit, float] = {"mm": 1e-3, "m": 1.0}
_LARGEST_IN_METRES = 10.0  # no part on a bench is longer: such a number is one of millimetres
_LIKELY_LARGEST_M, _LIKELY_SMALLEST_M = 3.0, 0.005
_FAR_SIZES = 10.0  # a part further from its origin than so many times its size was drawn in someone's factory
_SEAM_STEP_M, _SEAM_MOST = 0.5e-3, 4000
_SEAM_OFF_M = 5e-3  # a root in a gap lies off the surface, but not further
_SURFACE_SAMPLES = 20_000
_SHORT_SEAM_M, _FAR_PICK_M = 0.010, 0.020
_SAME_M = 1e-6
_CHUNK = 50  # points at a time: bounds the memory for a line of many corners


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnMesh:
    """A mesh as its file gives it."""

    vertices: Float[np.ndarray, "n 3"]
    """Corners in the file's own frame and unit."""
    faces: Int[np.ndarray, "m 3"]
    """Three vertex indices a triangle."""
    unit: Unit | None = None
    """The unit, if the format has one."""
    up: Up = "z"
    """The axis that points up in this format."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamLines:
    """A seam drawn as a polyline for each of its features, in the file's own frame."""

    lines_m: Mapping[str, Float[np.ndarray, "n 3"]]
    """Points along each feature in the direction of travel, m."""


@dataclass(frozen=True, kw_only=True)
class SeamPick:
    """A seam along sharp edges."""

    near_m: tuple[float, float, float]
    """A point near it (near its start), in the file's own frame."""
    sharper_than_rad: float
    """Least angle between the normals on either side of an edge."""
    kind: EdgeKind
    """Which edges count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnPart:
    """A user's part, ready for the cell."""

    workpiece: Workpiece
    T_part_drawn: RigidTransform
    """Takes points of the file's frame (scaled to metres) into the part frame."""
    remarks: tuple[str, ...]
    """What was odd about it and what was done, in words."""


def own_part(
    drawn: DrawnMesh,
    *,
    name: str,
    unit: Unit | None = None,
    up: Up | None = None,
    seam: SeamLines | SeamPick | None = None,
    material: MaterialName = "ground-steel",
) -> OwnPart:
    """The workpiece of a mesh and its seam; raises BadGeometry for what is no surface."""
    _check(drawn)
    extent = float(np.ptp(drawn.vertices, axis=0).max())
    unit, unit_remarks = _unit(extent, unit, drawn.unit)
    vertices_m = drawn.vertices * _UNIT_M[unit]
    turned = _to_up(up or drawn.up)
    mesh = sound_mesh(turned.apply(vertices_m), drawn.faces)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    underside = np.array([*(0.5 * (low + high))[:2], low[2]])
    T_part_drawn = rigid_from(turned, -underside)
    mesh = replace(mesh, vertices=mesh.vertices - underside)
    lines, seam_remarks = _lines_part(mesh, T_part_drawn, seam)
    workpiece = Workpiece(
        name=name,
        vertices_part=mesh.vertices,
        faces=mesh.faces,
        seam_part=seam_of_lines(lines) if lines else None,
        material=material,
        closed=mesh.closed,
    )
    remarks = (*unit_remarks, *_far(underside, extent * _UNIT_M[unit]), *mesh.remarks, *seam_remarks)
    return OwnPart(workpiece=workpiece, T_part_drawn=T_part_drawn, remarks=remarks)


def seam_of_lines(lines_part: Mapping[str, Float[np.ndarray, "n 3"]]) -> Seam:
    """The seam of polylines: all features at the arc lengths of `root` (else of the first), where nearest to it."""
    first = "root" if "root" in lines_part else next(iter(lines_part))
    arc_length_m, reference = _sampled(lines_part[first])
    points = {
        name: reference if name == first else _nearest(reference, _sampled(line)[1])
        for name, line in lines_part.items()
    }
    return Seam(arc_length_m=arc_length_m, points=points)


def _check(drawn: DrawnMesh) -> None:
    if not len(drawn.faces):
        raise BadGeometry("found no triangles, expected a surface")
    if not np.all(np.isfinite(drawn.vertices)):
        raise BadGeometry("found NaN or infinite coordinates, expected finite numbers")
    if drawn.faces.min() < 0 or drawn.faces.max() >= len(drawn.vertices):
        raise BadGeometry(f"found a triangle with corner {drawn.faces.max()}, there are {len(drawn.vertices)}")
    if np.abs(drawn.vertices).max() > 1e7:
        raise BadGeometry(f"found a coordinate of {np.abs(drawn.vertices).max():.3g}, expected at most 1e7")


def _unit(extent: float, given: Unit | None, known: Unit | None) -> tuple[Unit, list[str]]:
    """The unit to read the file in, and what is to be said about it."""
    unit: Unit = given or known or ("mm" if extent > _LARGEST_IN_METRES else "m")
    size_m = extent * _UNIT_M[unit]
    hint = f"{extent:.4g} units large; say units: {'m' if unit == 'mm' else 'mm'} if they are {_OTHER[unit]}"
    if size_m > _LIKELY_LARGEST_M or size_m < _LIKELY_SMALLEST_M:
        likely = _UNIT_M[_OTHER_UNIT[unit]] * extent
        if given is None and known is not None and _LIKELY_SMALLEST_M <= likely <= _LIKELY_LARGEST_M:
            unit = _OTHER_UNIT[unit]
            return unit, [
                f"{extent:.4g} units large: read in {unit}, not in the format's {known}; say units: to choose"
            ]
        return unit, [f"read in {unit} it is {size_m:.4g} m large: {hint}"]
    if given is None and known is None:
        return unit, [f"no unit given: read in {unit}, as it is {extent:.4g} units large; say units: {unit}"]
    return unit, []


_OTHER_UNIT: dict[Unit, Unit] = {"mm": "m", "m": "mm"}
_OTHER = {"mm": "metres", "m": "millimetres"}


def _far(underside: Float[np.ndarray, "3"], size_m: float) -> list[str]:
    distance_m = float(np.linalg.norm(underside))
    if distance_m <= _FAR_SIZES * size_m:
        return []
    return [f"drawn {distance_m:.4g} m from its origin: moved there (coordinates so far out lose their last digits)"]


def _to_up(up: Up) -> Rotation:
    """The turn that brings the axis to z: about x for y (as glTF's readers do), about y for x."""
    angle_deg = {"z": 0, "y": 90, "-y": -90, "-z": 180, "x": -90, "-x": 90}[up]
    return Rotation.from_euler("y" if up[-1] == "x" else "x", angle_deg, degrees=True)


def _lines_part(
    mesh: SoundMesh, T_part_drawn: RigidTransform, seam: SeamLines | SeamPick | None
) -> tuple[dict[str, Float[np.ndarray, "n 3"]], list[str]]:
    if seam is None:
        return {}, []
    if isinstance(seam, SeamLines):
        lines = {name: T_part_drawn.apply(line) for name, line in seam.lines_m.items()}
        return lines, [remark for name, line in lines.items() for remark in _off(mesh, name, line)]
    shape = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    near = T_part_drawn.apply(np.array(seam.near_m))
    found = sharp_line(shape, near, sharper_than_rad=seam.sharper_than_rad, kind=seam.kind)
    remarks = []
    if found.distance > _FAR_PICK_M:
        remarks.append(f"seam: the nearest sharp edge lies {1e3 * found.distance:.4g} mm from the point given")
    if (length_m := float(np.linalg.norm(np.diff(found.points, axis=0), axis=1).sum())) < _SHORT_SEAM_M:
        remarks.append(f"seam: the line of sharp edges there is {1e3 * length_m:.3g} mm long only")
    return {"root": found.points}, remarks


def _off(mesh: SoundMesh, name: str, line: Float[np.ndarray, "n 3"]) -> list[str]:
    """What is to be said about a seam that does not lie on the part."""
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    samples, _ = trimesh.sample.sample_surface(surface, _SURFACE_SAMPLES, seed=0)
    spacing_m = float(np.sqrt(surface.area / _SURFACE_SAMPLES))
    off_m, _ = KDTree(np.vstack([samples, mesh.vertices])).query(line)
    if np.max(off_m) <= _SEAM_OFF_M + 2 * spacing_m:
        return []
    return [
        f"seam: {name} lies up to {1e3 * np.max(off_m):.4g} mm off the part, expected on it "
        "(other units, or another frame than the part's file?)"
    ]


def _sampled(line: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k 3"]]:
    """Arc lengths and points of a polyline in small steps; its own corners are among them."""
    steps_m = np.linalg.norm(np.diff(line, axis=0), axis=1)
    line, steps_m = line[np.concatenate([[True], steps_m > _SAME_M])], steps_m[steps_m > _SAME_M]
    if not len(steps_m):
        raise BadGeometry("seam: found one place only, expected a line")
    corners_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    even_m = np.linspace(0, corners_m[-1], min(_SEAM_MOST, 2 + int(corners_m[-1] / _SEAM_STEP_M)))
    after = np.clip(np.searchsorted(corners_m, even_m), 1, len(corners_m) - 1)
    apart = np.minimum(np.abs(even_m - corners_m[after - 1]), np.abs(even_m - corners_m[after])) > 0.1 * even_m[1]
    arc_length_m = np.unique(np.concatenate([corners_m, even_m[apart]]))
    return arc_length_m, np.stack([np.interp(arc_length_m, corners_m, line[:, k]) for k in range(3)], axis=1)


def _nearest(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n 3"]:
    pieces = [nearest_on_polyline(points[k : k + _CHUNK], line) for k in range(0, len(points), _CHUNK)]
    return np.concatenate(pieces)

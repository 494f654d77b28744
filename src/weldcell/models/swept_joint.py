"""Parts with a joint along a path in their plane: plates milled or bars led along it, and the exact lines of the seam.

Every line of the section is an offset curve of the path. Straight sections between closely spaced places stray from
these curves by less than half a micrometre; rounded sections are polygons to `joint_kinds.SECTION_CHORD_M`.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam
from weldcell.models.chords import chord_places
from weldcell.models.joint_section import Bar, FullPlate, JointSection, Member, PlateEdge, TackShape
from weldcell.models.seam_path import PathFrames, PlanePath, arc_length, stretch_within
from weldcell.models.shapes import join, loft
from weldcell.models.workpiece import Workpiece

MESH_CHORD_M = 0.5e-6
"""A chord of the mesh along the seam strays from its curve by less than this."""
SEAM_CHORD_M, SEAM_STEP_M = 1e-8, 0.25e-3
"""And a chord of the seam's lines by less than the first; samples lie no further apart than the second."""
_CLEARANCE_M = 0.002  # a cutting body reaches this far out of the plate
_SLOT_M = 0.5e-3  # and cuts this much off beyond the plate's edge
_TACK_SECTIONS = 41
_SMALLEST_M3 = 1e-12  # a cubic tenth of a millimetre; cracks are smaller and negative
_BEND_SHARE = 0.98  # of the radius of curvature that a section may reach across


@dataclass(frozen=True, kw_only=True)
class TackWelds:
    """Where a seam was tacked."""

    stations_m: tuple[float, ...] = ()
    """Arc lengths of the tacks' middles along the seam."""
    length_m: float = 0.015
    """Length of each."""


def joint_part(
    section: JointSection,
    path: PlanePath,
    width_m: float,
    tacks: TackWelds | None = None,
    name: str | None = None,
    spacing_m: float = 5e-3,
) -> Workpiece:
    """The part with this joint along this path; its plates are `width_m` wide and as long as the path.

    `seam_part` covers the stretch where all features lie on the part; its arc length is the path's, from that stretch's
    start. Members that neither touch nor are tacked together are solids of their own. `spacing_m` is the largest
    spacing of the mesh's sections.
    """
    _check(section, path, width_m, spacing_m)
    frames = path.frames(_mesh_places(section, path, spacing_m))
    members = [_member(member, frames, path.length_m, width_m) for member in section.members]
    places = _seam_places(section, path)
    tacked = tack_solids(section.kind, section.tack, path.frames, places, arc_length(path, places), tacks)
    solid = _whole(join([*members, *tacked]))
    mesh = solid.to_mesh64()
    return Workpiece(
        name=name or f"{section.kind}_joint",
        vertices_part=mesh.vert_properties[:, :3],
        faces=mesh.tri_verts.astype(np.int64),
        seam_part=joint_seam(section, path),
    )


def joint_seam(section: JointSection, path: PlanePath) -> Seam:
    """The exact lines, sampled so that even straight chords between the samples are exact to `SEAM_CHORD_M`."""
    x = _seam_places(section, path)
    frames = path.frames(x)
    lines = {name: frames.place(place[None])[:, 0] for name, place in section.features.items()}
    return Seam(arc_length_m=arc_length(path, x), points=lines, approach=frames.direct(section.approach))


def _seam_places(section: JointSection, path: PlanePath) -> Float[np.ndarray, "n"]:
    places = np.array(list(section.features.values()))

    def lines_at(x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k 3"]:
        return path.frames(x).place(places)

    start, end = stretch_within(lines_at, path.length_m / 2, float(np.abs(places[:, 0]).max()))
    return chord_places(lines_at, start, end, SEAM_CHORD_M, SEAM_STEP_M)


def _check(section: JointSection, path: PlanePath, width_m: float, spacing_m: float) -> None:
    kind = section.kind
    if not (np.isfinite(spacing_m) and 0 < path.length_m <= 100_000 * spacing_m):
        raise BadGeometry(
            f"{kind}: spacing_m is {spacing_m} on a length of {path.length_m} m, expected 1 to 100000 cross-sections"
        )
    if not (np.isfinite(width_m) and width_m > 0):
        raise BadGeometry(f"{kind}: width_m is {width_m}, expected it positive")
    reach = max(float(np.abs(outline[:, 0]).max()) for outline in _swept_outlines(section))
    if reach * path.largest_curvature >= _BEND_SHARE:
        raise BadGeometry(
            f"{kind}: half its width ({reach * 1e3:.4g} mm) exceeds {_BEND_SHARE} of the path's smallest radius of "
            f"curvature ({1e3 / path.largest_curvature:.4g} mm); expected a gentler bend or a narrower joint"
        )
    if path.length_m / 2 + reach + _CLEARANCE_M >= path.farthest_x:
        raise BadGeometry(
            f"{kind}: the path turns too far for a section of {reach * 1e3:.4g} mm to either side; expected a larger "
            "radius_m or a shorter length_m"
        )
    x = np.linspace(-path.length_m / 2, path.length_m / 2, 1001)
    edges = [member.edge for member in section.members if isinstance(member, PlateEdge)]
    swing = max([float(np.abs(path.frames(x).place(edge)[..., 1]).max()) for edge in edges], default=0.0)
    if swing >= width_m / 2:
        raise BadGeometry(
            f"{kind}: it swings {1e3 * swing:.4g} mm from the plate's middle, expected less than half the width "
            f"({500 * width_m:.4g} mm)"
        )


def _swept_outlines(section: JointSection) -> list[Float[np.ndarray, "k 2"]]:
    outlines = [member.outline for member in section.members if isinstance(member, Bar)]
    cutters = [_cutter_outline(member) for member in section.members if isinstance(member, PlateEdge)]
    return [*outlines, *cutters, section.tack.full]


def _mesh_places(section: JointSection, path: PlanePath, spacing_m: float) -> Float[np.ndarray, "n"]:
    """Where the sections of all members stand: the same for all, so that members that touch have the same faces there.

    They begin and end beyond the part: offset curves end beside their place on the path.
    """
    places = np.vstack(_swept_outlines(section))
    reach = path.length_m / 2 + float(np.abs(places[:, 0]).max()) + _CLEARANCE_M
    return chord_places(lambda x: path.frames(x).place(places), -reach, reach, MESH_CHORD_M, spacing_m)


def _member(member: Member, frames: PathFrames, length_m: float, width_m: float) -> Manifold:
    if isinstance(member, FullPlate):
        return _block(length_m, width_m, member.low_m, member.high_m)
    if isinstance(member, Bar):
        low, high = member.outline[:, 1].min(), member.outline[:, 1].max()
        everything = _block(length_m, 4 * length_m + width_m, low - _CLEARANCE_M, high + _CLEARANCE_M)
        return everything ^ loft(frames.place(member.outline))
    plate = _block(length_m, width_m, member.edge[0, 1], member.edge[-1, 1])
    pieces = (plate - loft(frames.place(_cutter_outline(member)))).decompose()
    return max(pieces, key=lambda piece: member.side * _middle_y(piece))


def _whole(solid: Manifold) -> Manifold:
    """The solid without the cracks of rounding's width that a union leaves where members touch."""
    return Manifold.compose([shell for shell in solid.decompose() if shell.volume() > _SMALLEST_M3])


def _block(length_m: float, width_m: float, low_m: float, high_m: float) -> Manifold:
    return Manifold.cube((length_m, width_m, high_m - low_m)).translate((-length_m / 2, -width_m / 2, low_m))


def _middle_y(piece: Manifold) -> float:
    bounds = piece.bounding_box()
    return (bounds[1] + bounds[4]) / 2


def _cutter_outline(member: PlateEdge) -> Float[np.ndarray, "k 2"]:
    """What a plate's edge is milled with, reaching out of the plate above and below; counter-clockwise."""
    edge = member.edge * [member.side, 1]  # as if it lay on the left
    inner, (low_x, low_z), (high_x, high_z) = edge[:, 0].min() - _SLOT_M, edge[0], edge[-1]
    top, bottom = high_z + _CLEARANCE_M, low_z - _CLEARANCE_M
    around = np.array([(high_x, top), (inner, top), (inner, bottom), (low_x, bottom)])
    outline = np.vstack([edge, around]) * [member.side, 1]
    return outline if member.side > 0 else outline[::-1]


def tack_solids(
    kind: str,
    shape: TackShape,
    frames_at: Callable[[Float[np.ndarray, "n"]], PathFrames],
    places: Float[np.ndarray, "m"],
    arc_length_m: Float[np.ndarray, "m"],
    tacks: TackWelds | None,
) -> list[Manifold]:
    """The tack welds on a seam, given places on its path and their arc lengths along the seam."""
    if tacks is None or not tacks.stations_m:
        return []
    _check_tacks(kind, tacks, float(arc_length_m[-1]))
    ahead = tacks.length_m / 2 * np.sin(np.linspace(-np.pi / 2, np.pi / 2, _TACK_SECTIONS))
    share = np.sqrt(1 - (2 * ahead / tacks.length_m) ** 2)[:, None, None]  # an ellipse, as seen from the side
    outlines = shape.seed + share * (shape.full - shape.seed)
    tacked = [np.interp(station + ahead, arc_length_m, places) for station in tacks.stations_m]
    return [loft(frames_at(place).place(outlines)) for place in tacked]


def _check_tacks(kind: str, tacks: TackWelds, seam_length_m: float) -> None:
    stations = np.sort(np.array(tacks.stations_m))
    if not (np.isfinite(tacks.length_m) and tacks.length_m > 0):
        raise BadGeometry(f"{kind}: tacks' length_m is {tacks.length_m}, expected it positive")
    if not np.all((stations >= tacks.length_m / 2) & (stations <= seam_length_m - tacks.length_m / 2)):
        raise BadGeometry(
            f"{kind}: tacks' stations_m are {tacks.stations_m}, expected {tacks.length_m / 2:.4g} to "
            f"{seam_length_m - tacks.length_m / 2:.4g}: whole tacks on the seam"
        )
    if len(stations) > 1 and np.diff(stations).min() <= tacks.length_m:
        raise BadGeometry(
            f"{kind}: tacks' stations_m are {tacks.stations_m}, expected more than their length "
            f"({tacks.length_m}) between them"
        )

"""Parts with a joint along a path in their plane: plates milled or bars led along it, and the exact lines of the seam.

Every line of the section is an offset curve of the path, or goes evenly from one such curve to another. Straight
sections between closely spaced places stray from these curves by less than half a micrometre; rounded sections are
polygons to `joint_kinds.SECTION_CHORD_M`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam
from weldcell.models.chords import chord_places
from weldcell.models.flat_faces import well_shaped
from weldcell.models.joint_section import Bar, FullPlate, JointSection, Member, PlateEdge, TackShape
from weldcell.models.seam_path import PathFrames, PlanePath, arc_length, stretch_within
from weldcell.models.section_along import SectionAlong
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
    end_section: JointSection | None = None,
    end_share: float = 1.0,
) -> Workpiece:
    """The part with this joint along this path; its plates are `width_m` wide and as long as the path.

    `seam_part` covers the stretch where all features lie on the part; its arc length is the path's, from that stretch's
    start. Members that neither touch nor are tacked together are solids of their own. `spacing_m` is the largest
    spacing of the mesh's sections.

    With an `end_section` (see `section_along`) the section changes evenly, in x, from the part's start to there: over
    `end_share` of its length, after which it stays as it is. Its gap may be 0. `seam_part` goes on along a closed
    gap, though nothing can be seen of it there: a butt's `left` and `right` are one line then.
    """
    along = _along(section, path, end_section, end_share)
    _check(along, path, width_m, spacing_m)
    x = _mesh_places(along, path, spacing_m)
    pairs = zip(section.members, along.end.members, along.rises_m, strict=True)
    members = [_member(first, last, rise_m, along, path, x, width_m) for first, last, rise_m in pairs]
    solid = _whole(join([*members, *_tacked(along, path, tacks)]))
    mesh = solid.to_mesh64()
    vertices, faces = well_shaped(mesh.vert_properties[:, :3], mesh.tri_verts.astype(np.int64))
    return Workpiece(
        name=name or f"{section.kind}_joint",
        vertices_part=vertices,
        faces=faces,
        seam_part=joint_seam(section, path, end_section, end_share),
    )


def joint_seam(
    section: JointSection, path: PlanePath, end_section: JointSection | None = None, end_share: float = 1.0
) -> Seam:
    """The exact lines, sampled so that even straight chords between the samples are exact to `SEAM_CHORD_M`."""
    along = _along(section, path, end_section, end_share)
    x = _seam_places(along, path)
    lines = along.features(path, x)
    return Seam(
        arc_length_m=arc_length(path, x),
        points={name: lines[:, k] for k, name in enumerate(section.features)},
        approach=path.frames(x).direct(section.approach),
    )


def _along(section: JointSection, path: PlanePath, end_section: JointSection | None, end_share: float) -> SectionAlong:
    return SectionAlong(start=section, end=end_section or section, length_m=path.length_m, end_share=end_share)


def _seam_places(along: SectionAlong, path: PlanePath) -> Float[np.ndarray, "n"]:
    def lines_at(x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k 3"]:
        return along.features(path, x)

    reach = max(float(np.abs(place[0])) for one in (along.start, along.end) for place in one.features.values())
    start, end = stretch_within(lines_at, path.length_m / 2, reach)
    return _with_kink(chord_places(lines_at, start, end, SEAM_CHORD_M, SEAM_STEP_M), along)


def _with_kink(x: Float[np.ndarray, "n"], along: SectionAlong) -> Float[np.ndarray, "m"]:
    """Places with the one at which the section stops changing, if it does within them."""
    if along.start is along.end or not x[0] < along.kink_x < x[-1]:
        return x
    return np.union1d(x, along.kink_x)


def _check(along: SectionAlong, path: PlanePath, width_m: float, spacing_m: float) -> None:
    kind, sections = along.start.kind, (along.start, along.end)
    if not (np.isfinite(spacing_m) and 0 < path.length_m <= 100_000 * spacing_m):
        raise BadGeometry(
            f"{kind}: spacing_m is {spacing_m} on a length of {path.length_m} m, expected 1 to 100000 cross-sections"
        )
    if not (np.isfinite(width_m) and width_m > 0):
        raise BadGeometry(f"{kind}: width_m is {width_m}, expected it positive")
    reach = max(float(np.abs(outline[:, 0]).max()) for one in sections for outline in _swept_outlines(one))
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
    edges = [member.edge for one in sections for member in one.members if isinstance(member, PlateEdge)]
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


def _mesh_places(along: SectionAlong, path: PlanePath, spacing_m: float) -> Float[np.ndarray, "n"]:
    """Where the sections of all members stand: the same for all, so that members that touch have the same faces there.

    They begin and end beyond the part: offset curves end beside their place on the path.
    """
    first, last = (np.vstack(_swept_outlines(one)) for one in (along.start, along.end))
    reach = path.length_m / 2 + float(np.abs([first[:, 0], last[:, 0]]).max()) + _CLEARANCE_M

    def lines_at(x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k 3"]:
        return path.frames(x).place(along.outline(first, last, x))

    return _with_kink(chord_places(lines_at, -reach, reach, MESH_CHORD_M, spacing_m), along)


def _member(
    first: Member,
    last: Member,
    rise_m: float,
    along: SectionAlong,
    path: PlanePath,
    x: Float[np.ndarray, "n"],
    width_m: float,
) -> Manifold:
    """A member that goes from its first to its last form, with sections at these places on the path."""
    if isinstance(first, FullPlate):
        return _block(path.length_m, width_m, first.low_m, first.high_m)
    if isinstance(first, Bar) and isinstance(last, Bar):
        return _bar(path.frames(x).place(along.outline(first.outline, last.outline, x)), path.length_m, width_m)
    assert isinstance(first, PlateEdge) and isinstance(last, PlateEdge)
    cutter = along.outline(_cutter_outline(first), _cutter_outline(last) - [0, rise_m], x)
    plate = _block(path.length_m, width_m, first.edge[0, 1], first.edge[-1, 1])
    pieces = (plate - loft(path.frames(x).place(cutter))).decompose()
    level = max(pieces, key=lambda piece: first.side * _middle_y(piece))
    if rise_m == 0:
        return level
    return level.warp_batch(lambda points: points + np.outer(along.lift(points[:, 0]), [0, 0, rise_m]))


def _bar(rings: Float[np.ndarray, "n k 3"], length_m: float, width_m: float) -> Manifold:
    """What lies between the part's ends of a body through these rings."""
    low, high = rings[..., 2].min(), rings[..., 2].max()
    return _block(length_m, 4 * length_m + width_m, low - _CLEARANCE_M, high + _CLEARANCE_M) ^ loft(rings)


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
    return [
        loft(frames_at(x).place(shape.seed + share * (shape.full - shape.seed)))
        for x, share in _tack_places(kind, places, arc_length_m, tacks)
    ]


def _tacked(along: SectionAlong, path: PlanePath, tacks: TackWelds | None) -> list[Manifold]:
    """The tack welds of a section that may change."""
    places, (first, last) = _seam_places(along, path), (along.start.tack, along.end.tack)
    solids = []
    for x, share in _tack_places(along.start.kind, places, arc_length(path, places), tacks):
        seed, full = along.outline(first.seed, last.seed, x), along.outline(first.full, last.full, x)
        solids.append(loft(path.frames(x).place(seed + share * (full - seed))))
    return solids


def _tack_places(
    kind: str, places: Float[np.ndarray, "m"], arc_length_m: Float[np.ndarray, "m"], tacks: TackWelds | None
) -> Iterator[tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 1 1"]]]:
    """For each tack its sections' places on the path, and how much of the full outline each has."""
    if tacks is None or not tacks.stations_m:
        return
    _check_tacks(kind, tacks, float(arc_length_m[-1]))
    ahead = tacks.length_m / 2 * np.sin(np.linspace(-np.pi / 2, np.pi / 2, _TACK_SECTIONS))
    share = np.sqrt(1 - (2 * ahead / tacks.length_m) ** 2)[:, None, None]  # an ellipse, as seen from the side
    for station in tacks.stations_m:
        yield np.interp(station + ahead, arc_length_m, places), share


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

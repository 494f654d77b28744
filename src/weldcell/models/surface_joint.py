"""A block with a free-form upper surface, and a groove milled into it along a curve on that surface (P1's U seam).

The groove's section is perpendicular to the curve and upright along the surface's normal. Its walls run on until they
meet the surface: there are `left` and `right`. All vertices of the surface and of the groove are exact; chords along
the groove stray by less than `swept_joint.MESH_CHORD_M`, triangles of the surface beside it by some micrometres.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam
from weldcell.models.chords import chord_places, growing_shares
from weldcell.models.curved_surface import CurvedSurface, SurfacePath
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSection, JointSize, PlateEdge
from weldcell.models.seam_path import PlanePath, SPath, arc_length, stretch_within
from weldcell.models.shapes import join, loft
from weldcell.models.swept_joint import MESH_CHORD_M, SEAM_CHORD_M, SEAM_STEP_M, TackWelds, tack_solids
from weldcell.models.workpiece import Workpiece

_CLEARANCE_M = 0.002  # the block is made larger by this and cut to size
_FIRST_STEP_M, _LARGEST_STEP_M, _GROWTH = 0.6e-3, 4e-3, 1.15  # of the surface's grid, outwards from the groove
_SPACING_M = 5e-3
_WALL_SHARES = np.linspace(0, 1, 7)  # a wall turns along the path: split in six, diagonals stray six times less from it


def u_seam_part(
    length_m: float = 0.300,
    width_m: float = 0.100,
    groove_depth_m: float = 0.010,
    groove_angle_rad: float = float(np.deg2rad(20)),
    root_radius_m: float = 0.004,
    amplitude_m: float = 0.012,
    surface: CurvedSurface | None = None,
    tacks: TackWelds | None = None,
) -> Workpiece:
    """A block with a U-groove along an S-shaped curve on its curved surface; features `left`, `centre`, `right`.

    By default the surface is a wave along x with radii from 150 mm and a dome of 250 mm across, slightly twisted.
    """
    surface = surface or CurvedSurface(height_m=0.055, wave_m=0.018, wavelength_m=0.33, across_radius_m=0.25, twist=0.3)
    size = JointSize(
        thickness_m=2 * groove_depth_m,
        root_face_m=groove_depth_m,
        groove_angle_rad=groove_angle_rad,
        root_radius_m=root_radius_m,
    )
    plan = SPath(length_m=length_m, amplitude_m=amplitude_m)
    return surface_joint_part(joint_section("u", size), plan, surface, width_m, tacks, name="u_seam_part")


def surface_joint_part(
    section: JointSection,
    plan: PlanePath,
    surface: CurvedSurface,
    width_m: float,
    tacks: TackWelds | None = None,
    name: str | None = None,
) -> Workpiece:
    """The block with this groove along the curve that lies under (or over) `plan` on the surface.

    The section must be that of a groove without root gap and mismatch; the block is one solid on a flat underside.
    """
    path = SurfacePath(plan=plan, surface=surface)
    groove = _groove(section)
    places = _seam_places(groove, path)
    tacked = tack_solids(section.kind, groove.section.tack, path.frames, places, arc_length(path, places), tacks)
    solid = join([_block(groove, path, width_m), *tacked])
    mesh = solid.to_mesh64()
    return Workpiece(
        name=name or f"{section.kind}_surface_joint",
        vertices_part=mesh.vert_properties[:, :3],
        faces=mesh.tri_verts.astype(np.int64),
        seam_part=_seam(groove, path, places),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Groove:
    """A groove of two walls that meet at the root."""

    section: JointSection
    """The joint, its origin on the surface."""
    middle: str
    """The feature at the root."""
    left: Float[np.ndarray, "k 2"]
    """The left wall from the root upwards, m."""
    right: Float[np.ndarray, "m 2"]
    """The right wall from the root upwards, m."""

    def walls_at(self, path: SurfacePath, x: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "n k 3"], ...]:
        """Both walls at these places of the path, their last points on the surface."""
        frames = path.frames(x)
        walls = []
        for wall in (self.left, self.right):
            points = frames.place(wall)
            edge = path.surface.met_from(points[:, -1], frames.direct(wall[-1] - wall[-2]))
            straight = points[:, -2:-1] + _WALL_SHARES[:, None] * (edge - points[:, -2])[:, None]
            walls.append(np.concatenate([points[:, :-2], straight], axis=1))
        return tuple(walls)

    def lines_at(self, path: SurfacePath, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3 3"]:
        """Left edge, root and right edge at these places of the path."""
        left, right = self.walls_at(path, x)
        return np.stack([left[:, -1], left[:, 0], right[:, -1]], axis=1)


def _groove(section: JointSection) -> _Groove:
    if section.kind not in ("v", "bevel", "u", "j"):
        raise BadGeometry(f"{section.kind}: expected a groove for a curved surface: v, bevel, u or j")
    edges = [member.edge for member in section.members if isinstance(member, PlateEdge)]
    if max(np.abs(edges[0][0, 0]), np.abs(edges[1][0, 0])) > 0 or edges[0][-1, 1] != edges[1][-1, 1]:
        raise BadGeometry(f"{section.kind}: expected root_gap_m and mismatch_m 0 on a curved surface")
    middle = next(name for name in section.features if name not in ("left", "right"))
    section, (root, top) = section.lowered(edges[0][-1, 1]), (section.features[middle], edges[0][-1, 1])
    walls = [np.vstack([root, edge[edge[:, 1] > root[1]]]) - [0, top] for edge in edges]
    return _Groove(section=section, middle=middle, left=walls[0], right=walls[1])


def _seam_places(groove: _Groove, path: SurfacePath) -> Float[np.ndarray, "n"]:
    def lines_at(x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3 3"]:
        return groove.lines_at(path, x)

    reach = float(max(np.abs(groove.left).sum(axis=1).max(), np.abs(groove.right).sum(axis=1).max()))
    start, end = stretch_within(lines_at, path.length_m / 2, reach)
    return chord_places(lines_at, start, end, SEAM_CHORD_M, SEAM_STEP_M)


def _seam(groove: _Groove, path: SurfacePath, places: Float[np.ndarray, "n"]) -> Seam:
    lines = groove.lines_at(path, places)
    points = {name: lines[:, k] for k, name in enumerate(("left", groove.middle, "right"))}
    return Seam(arc_length_m=arc_length(path, places), points=points, approach=path.frames(places).ups)


def _block(groove: _Groove, path: SurfacePath, width_m: float) -> Manifold:
    """The milled block: rings of exact points along the path, made too large and cut to size."""
    half_length, bounds = path.length_m / 2, np.linspace(-path.length_m, path.length_m, 1001)
    frames = path.frames(bounds)
    reach = 1.1 * (width_m / 2 + float(np.abs(frames.points[:, 1]).max())) + _CLEARANCE_M
    _check_bend(groove, path.plan, reach)
    depth = float(-groove.left[0, 1])
    beyond = reach * np.abs(frames.lefts[:, 0]).max() + depth * np.abs(frames.ups[:, 0]).max() + _CLEARANCE_M
    x = chord_places(
        lambda x: np.concatenate(groove.walls_at(path, x), axis=1),
        -half_length - beyond,
        half_length + beyond,
        MESH_CHORD_M,
        _SPACING_M,
    )
    rings = _rings(groove, path, x, reach)
    _check_rings(groove, path.frames(x).tangents, rings[:, 2:], width_m)
    box = Manifold.cube((path.length_m, width_m, 1.0)).translate((-half_length, -width_m / 2, 0))
    return loft(rings) ^ box


def _rings(groove: _Groove, path: SurfacePath, x: Float[np.ndarray, "n"], reach_m: float) -> Float[np.ndarray, "n k 3"]:
    """Outlines of the block across the path: two corners below the underside, then the upper side, left to right."""
    frames = path.frames(x)
    left, right = groove.walls_at(path, x)
    shares = growing_shares(reach_m, _FIRST_STEP_M, _LARGEST_STEP_M, _GROWTH)[1:]
    sides = []
    for wall, far in ((left, reach_m), (right, -reach_m)):
        near = np.einsum("ni,ni->n", wall[:, -1] - frames.points, frames.lefts)
        across = near[:, None] + shares * (far - near[:, None])
        start = frames.points[:, None] + across[..., None] * frames.lefts[:, None]
        sides.append(path.surface.met_from(start, np.broadcast_to(frames.ups[:, None], start.shape)))
    corners = [side[:, -1:] * [1, 1, 0] - [0, 0, _CLEARANCE_M] for side in sides]
    upper = [sides[0][:, ::-1], left[:, ::-1], right[:, 1:], sides[1]]
    return np.concatenate([corners[1], corners[0], *upper], axis=1)


def _check_bend(groove: _Groove, plan: PlanePath, reach_m: float) -> None:
    if reach_m * plan.largest_curvature >= 1:
        raise BadGeometry(
            f"{groove.section.kind}: the block reaches {1e3 * reach_m:.4g} mm from the path, expected less than its "
            f"smallest radius of curvature ({1e3 / plan.largest_curvature:.4g} mm): a gentler path or a narrower block"
        )


def _check_rings(
    groove: _Groove, tangents: Float[np.ndarray, "n 3"], upper: Float[np.ndarray, "n k 3"], width_m: float
) -> None:
    """Every point of the upper side must go forward with the path, stay above the underside and reach the sides.

    Each ring lies in the plane across its tangent, so no two of them cross where all points go forward.
    """
    if not np.all(np.einsum("nki,ni->nk", np.diff(upper, axis=0), tangents[:-1]) > 0):
        raise BadGeometry(f"{groove.section.kind}: its sections cross one another; expected a gentler path or surface")
    inside = np.abs(upper[..., 0]) < 1.0
    if upper[..., 2][inside].min() <= 0:
        raise BadGeometry(f"{groove.section.kind}: the groove or the surface comes below the underside")
    if np.abs(upper[:, [0, -1], 1]).min() <= width_m / 2:
        raise BadGeometry(f"{groove.section.kind}: width_m is {width_m}, expected a block that holds the whole surface")

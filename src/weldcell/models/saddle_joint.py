"""A branch pipe set on a run pipe, welded by a fillet all around: the saddle.

The run's axis is x, the branch's is z. The branch's outer cylinder (radius r) meets the run's (radius R) in the curve

    root(phi) = (r cos phi, r sin phi, sqrt(R^2 - r^2 sin^2 phi)),

led by the angle about the branch's axis, counter-clockwise seen from above, so that the branch's wall is on the left.
Between wall and run the weld has 90 deg at the crowns (phi = 0, 180 deg) and 90 deg + asin(r / R) at the flanks.

The part is the upper half of the run pipe with the branch, bored through: one sheet of exact points around a ring.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold
from scipy.integrate import cumulative_simpson

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam
from weldcell.models.chords import chord_places, growing_shares
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.seam_path import PathFrames
from weldcell.models.shapes import join, solid_of
from weldcell.models.swept_joint import MESH_CHORD_M, SEAM_CHORD_M, TackWelds, tack_solids
from weldcell.models.workpiece import Workpiece

_FIRST_STEP_M, _LARGEST_STEP_M, _GROWTH = 0.6e-3, 4e-3, 1.15  # of the grid on the run, outwards from the root
_INNER_STEPS = 24  # nobody measures there
_LARGEST_RATIO = 0.95  # of the radii: beyond, the curve runs along the run's flank
_LARGEST_STEP_RAD = np.deg2rad(1.0)


@dataclass(frozen=True, kw_only=True)
class SaddleSize:
    """Sizes of both pipes."""

    run_radius_m: float = 0.075
    """Outer radius of the run."""
    branch_radius_m: float = 0.035
    """Outer radius of the branch."""
    run_wall_m: float = 0.008
    """Thickness of the run's wall."""
    branch_wall_m: float = 0.006
    """Thickness of the branch's wall."""
    run_length_m: float = 0.240
    """Length of the run."""
    branch_height_m: float = 0.060
    """How far the branch rises above the run's crown."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and 0 < value <= 10):
                raise BadGeometry(f"saddle: {name} is {value}, expected a positive number up to 10")
        if self.branch_radius_m > _LARGEST_RATIO * self.run_radius_m:
            raise BadGeometry(
                f"saddle: branch_radius_m is {self.branch_radius_m}, expected up to {_LARGEST_RATIO} of the run's "
                f"({self.run_radius_m})"
            )
        if self.branch_wall_m >= self.branch_radius_m or self.run_wall_m >= self.run_radius_m:
            raise BadGeometry("saddle: expected walls thinner than the pipes' radii")
        if self.bore_m >= self.run_inner_m:
            raise BadGeometry(
                f"saddle: the bore's radius is {self.bore_m}, expected less than the run's inner one "
                f"({self.run_inner_m}): a thinner run_wall_m or a smaller branch"
            )
        if self.run_length_m <= 2.2 * self.branch_radius_m:
            raise BadGeometry(f"saddle: run_length_m is {self.run_length_m}, expected more than 2.2 branch radii")

    @property
    def bore_m(self) -> float:
        """Inner radius of the branch."""
        return self.branch_radius_m - self.branch_wall_m

    @property
    def run_inner_m(self) -> float:
        """Inner radius of the run."""
        return self.run_radius_m - self.run_wall_m


@dataclass(frozen=True, kw_only=True)
class SaddlePath:
    """The curve in which two crossing cylinders meet, led by the angle phi about the smaller one's axis."""

    run_radius_m: float
    """Radius of the larger cylinder, about x."""
    branch_radius_m: float
    """Radius of the smaller one, about z."""

    def points(self, phi: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
        """Points of the curve, m."""
        x, y = self.branch_radius_m * np.cos(phi), self.branch_radius_m * np.sin(phi)
        return np.column_stack([x, y, np.sqrt(self.run_radius_m**2 - y**2)])

    def frames(self, phi: Float[np.ndarray, "n"]) -> PathFrames:
        """Where the section stands: upright along the run's normal, left towards the branch's axis."""
        points = self.points(phi)
        ups = points * [0, 1, 1] / self.run_radius_m
        tangents = np.cross(ups, self._branch_normals(phi))
        tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
        return PathFrames(points=points, tangents=tangents, lefts=np.cross(ups, tangents), ups=ups)

    def oblique_frames(self, phi: Float[np.ndarray, "n"]) -> PathFrames:
        """The same with the upright direction along the branch's wall: the section of a T sheared to the saddle's."""
        frames = self.frames(phi)
        walls = np.cross(self._branch_normals(phi), frames.tangents)
        return PathFrames(points=frames.points, tangents=frames.tangents, lefts=frames.lefts, ups=walls)

    def arc_length(self, phi: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Length from the first angle to each, m (Simpson's rule)."""
        x, y, z = self.points(phi).T
        return cumulative_simpson(np.sqrt(self.branch_radius_m**2 + (x * y / z) ** 2), x=phi, initial=0)

    def _branch_normals(self, phi: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
        return np.column_stack([np.cos(phi), np.sin(phi), np.zeros_like(phi)])


def saddle_part(
    size: SaddleSize | None = None,
    start_rad: float = 0.0,
    end_rad: float = 2 * np.pi,
    tacks: TackWelds | None = None,
    name: str = "saddle_joint",
) -> Workpiece:
    """The part; its seam, with the feature `root`, runs from angle to angle about the branch's axis.

    Angles count from the run's direction (x), counter-clockwise seen from above.
    """
    size = size or SaddleSize()
    if not (np.isfinite(start_rad) and 0 < end_rad - start_rad <= 2 * np.pi + 1e-12):
        raise BadGeometry(f"saddle: start_rad is {start_rad} and end_rad {end_rad}, expected up to one turn between")
    path = SaddlePath(run_radius_m=size.run_radius_m, branch_radius_m=size.branch_radius_m)
    phi = _chord_angles(path, start_rad, end_rad, SEAM_CHORD_M)
    arc_length_m = path.arc_length(phi)
    plates = JointSize(thickness_m=size.run_wall_m, upper_thickness_m=size.branch_wall_m, rise_m=size.branch_height_m)
    section = joint_section("fillet", plates).lowered(size.run_wall_m)
    tacked = tack_solids("saddle", section.tack, path.oblique_frames, phi, arc_length_m, tacks)
    mesh = join([_pipes(size, path), *tacked]).to_mesh64()
    frames = path.oblique_frames(phi)
    approach = frames.ups - frames.lefts
    return Workpiece(
        name=name,
        vertices_part=mesh.vert_properties[:, :3],
        faces=mesh.tri_verts.astype(np.int64),
        seam_part=Seam(
            arc_length_m=arc_length_m,
            points={"root": frames.points},
            approach=approach / np.linalg.norm(approach, axis=1, keepdims=True),
        ),
    )


def _chord_angles(path: SaddlePath, start: float, end: float, chord_m: float) -> Float[np.ndarray, "n"]:
    return chord_places(lambda phi: path.points(phi)[:, None], start, end, chord_m, _LARGEST_STEP_RAD)


def _pipes(size: SaddleSize, path: SaddlePath) -> Manifold:
    """Half the run with its branch: a ring for each angle, all rings closed and closed into a ring."""
    corners = np.pi / 4 * np.array([1, 3, 5, 7, 9])  # where rays meet the border's corners
    phi = np.concatenate([_chord_angles(path, *ends, MESH_CHORD_M)[:-1] for ends in pairwise(corners)])
    border = _border(size, phi)
    bore = SaddlePath(run_radius_m=size.run_inner_m, branch_radius_m=size.bore_m)
    farthest = float(np.hypot(size.run_length_m / 2, size.run_radius_m * np.pi / 2))
    shares = growing_shares(farthest, _FIRST_STEP_M, _LARGEST_STEP_M, _GROWTH)
    outer = _sheet(size.run_radius_m, path.points(phi), border, shares)
    inner = _sheet(size.run_inner_m, bore.points(phi), border, np.linspace(0, 1, _INNER_STEPS + 1))
    top = np.full(len(phi), size.run_radius_m + size.branch_height_m)
    tops = [np.column_stack([r * np.cos(phi), r * np.sin(phi), top]) for r in (size.bore_m, size.branch_radius_m)]
    rings = np.concatenate([outer, inner[:, ::-1], tops[0][:, None], tops[1][:, None]], axis=1)
    return solid_of(rings.reshape(-1, 3), _torus_faces(*rings.shape[:2]))


def _unrolled(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Place along the run (m) and angle about its axis from the crown, towards +y."""
    return np.column_stack([points[:, 0], np.arctan2(points[:, 1], points[:, 2])])


def _border(size: SaddleSize, phi: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 2"]:
    """Where each angle's ray meets the border of the half pipe, unrolled: x = +-length/2 or the angle +-90 deg."""
    half = np.array([size.run_length_m / 2, np.pi / 2])
    ray = np.column_stack([np.cos(phi) * half[0], np.sin(phi) * half[1]])
    return ray / np.abs(ray / half).max(axis=1, keepdims=True)


def _sheet(
    radius_m: float, inner: Float[np.ndarray, "n 3"], border: Float[np.ndarray, "n 2"], shares: Float[np.ndarray, "m"]
) -> Float[np.ndarray, "n m 3"]:
    """Points on a cylinder about x from the inner curve to the border, each on a straight way unrolled."""
    start = _unrolled(inner)
    x, angle = np.moveaxis(start[:, None] + shares[:, None] * (border - start)[:, None], -1, 0)
    points = np.stack([x, radius_m * np.sin(angle), radius_m * np.cos(angle)], axis=-1)
    points[:, 0] = inner
    return points


def _torus_faces(n: int, k: int) -> np.ndarray:
    """Triangles of n closed rings of k points each, the last ring joined to the first."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n), np.arange(k), indexing="ij"))
    here, beside = i * k + j, i * k + (j + 1) % k
    here_next, beside_next = (i + 1) % n * k + j, (i + 1) % n * k + (j + 1) % k
    return np.concatenate(
        [np.column_stack([here, beside, beside_next]), np.column_stack([here, beside_next, here_next])]
    )

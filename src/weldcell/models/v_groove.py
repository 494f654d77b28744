"""A plate with a V-groove along an S-shaped path, and the exact lines of the groove.

The path is y(x) = A sin(2 pi x / L) in the plate's plane. The cross-section perpendicular to it is an exact V
(ISO 9692-1: groove angle, root gap, root face), so that every line of the groove is an offset curve of the path.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from manifold3d import Manifold
from scipy.integrate import cumulative_simpson

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam
from weldcell.models.shapes import loft
from weldcell.models.workpiece import Workpiece

_MESH_CHORD_M = 0.5e-6  # a chord of the mesh strays from its curve by less than this
_SEAM_CHORD_M = 1e-8  # and a chord of the seam's lines by less than this
_CLEARANCE_M = 0.002  # the cutting body reaches this far out of the plate
_LARGEST_SIZE_M = 10.0


@dataclass(frozen=True, kw_only=True)
class SPath:
    """The path y(x) = amplitude sin(2 pi x / length), left being +y."""

    length_m: float
    """One period, and the plate's length."""
    amplitude_m: float
    """How far it swings to either side."""

    @property
    def largest_curvature(self) -> float:
        """Curvature at the crests, 1/m: |y''| = A k^2 where y' = 0."""
        return abs(self.amplitude_m) * (2 * np.pi / self.length_m) ** 2

    def slope(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """y'(x)."""
        k = 2 * np.pi / self.length_m
        return self.amplitude_m * k * np.cos(k * x)

    def offset(self, x: Float[np.ndarray, "n"], to_left_m: float) -> Float[np.ndarray, "n 2"]:
        """Points `to_left_m` beside the path, measured along its normal at `x`."""
        y = self.amplitude_m * np.sin(2 * np.pi * x / self.length_m)
        slope = self.slope(x)
        normal = np.stack([-slope, np.ones_like(slope)], axis=-1) / np.sqrt(1 + slope**2)[:, None]
        return np.stack([x, y], axis=-1) + to_left_m * normal

    def chord_spacing(self, chord_m: float, largest_offset_m: float) -> float:
        """Spacing in x whose chords stray less than `chord_m` on the path and on its offset curves.

        Sagitta = curvature spacing^2 / 8; an offset d makes the radius r - d, and steepness lengthens the steps.
        """
        curvature = self.largest_curvature / (1 - self.largest_curvature * largest_offset_m)
        steepness = np.hypot(1, self.amplitude_m * 2 * np.pi / self.length_m)
        return float(np.sqrt(8 * chord_m / max(curvature, 1e-6)) / steepness)


def v_groove_plate(
    length_m: float,
    width_m: float,
    thickness_m: float,
    groove_angle_rad: float,
    root_gap_m: float,
    root_face_m: float,
    amplitude_m: float,
    spacing_m: float = 0.5e-3,
) -> Workpiece:
    """The plate, one solid when `root_gap_m` is 0, else two; `seam_part` has `left`, `root` and `right`.

    `left` and `right` are the groove's top edges, `root` the V's bottom (with a gap: midway between its two edges).
    The seam covers the stretch where the whole cross-section lies within the plate; its arc length is the path's,
    from that stretch's start. `spacing_m` is the largest spacing of the mesh's cross-sections.
    """
    _check(length_m, width_m, thickness_m, groove_angle_rad, root_gap_m, root_face_m, amplitude_m, spacing_m)
    path = SPath(length_m=length_m, amplitude_m=amplitude_m)
    half_gap = root_gap_m / 2
    half_top = half_gap + (thickness_m - root_face_m) * np.tan(groove_angle_rad / 2)
    widest = half_top + _CLEARANCE_M * np.tan(groove_angle_rad / 2)
    if widest * path.largest_curvature >= 0.98:
        raise BadGeometry(
            f"v-groove: half its width ({widest * 1e3:.4g} mm) exceeds the path's smallest radius of curvature "
            f"({1e3 / path.largest_curvature:.4g} mm); expected a gentler or a narrower groove"
        )
    if abs(amplitude_m) + half_top >= width_m / 2:
        raise BadGeometry(
            f"v-groove: it swings {1e3 * (abs(amplitude_m) + half_top):.4g} mm from the plate's middle, "
            f"expected less than half the width ({500 * width_m:.4g} mm)"
        )
    cutter = _cutter(path, thickness_m, root_face_m, half_gap, widest, spacing_m)
    plate = Manifold.cube((length_m, width_m, thickness_m)).translate((-length_m / 2, -width_m / 2, 0)) - cutter
    mesh = plate.to_mesh64()
    return Workpiece(
        name="v_groove_plate",
        vertices_part=mesh.vert_properties[:, :3],
        faces=mesh.tri_verts.astype(np.int64),
        seam_part=_seam(path, thickness_m, root_face_m, half_top),
    )


def _check(
    length_m: float, width_m: float, thickness_m: float, angle_rad: float, gap_m: float, face_m: float,
    amplitude_m: float, spacing_m: float,
) -> None:  # fmt: skip
    values = np.array([length_m, width_m, thickness_m, angle_rad, gap_m, face_m, amplitude_m, spacing_m])
    if not np.all(np.isfinite(values)) or np.abs(values).max() > _LARGEST_SIZE_M:
        raise BadGeometry(f"v-groove: expected finite sizes up to {_LARGEST_SIZE_M} m, found {values}")
    if min(length_m, width_m, thickness_m, spacing_m) <= 0 or min(gap_m, face_m) < 0:
        raise BadGeometry("v-groove: expected positive length, width, thickness, spacing; gap and face not negative")
    if not 0 < angle_rad < np.pi:
        raise BadGeometry(f"v-groove: expected a groove angle of 0 to 180 deg, found {np.rad2deg(angle_rad):.4g} deg")
    if face_m >= thickness_m:
        raise BadGeometry(f"v-groove: expected a root face below the thickness, found {face_m} of {thickness_m} m")
    if gap_m == 0 and face_m == 0:
        raise BadGeometry("v-groove: with neither root gap nor root face the plate falls apart along a line")
    if length_m / spacing_m > 100_000:
        raise BadGeometry(f"v-groove: spacing of {spacing_m} m gives more than 100000 cross-sections")


def _cutter(
    path: SPath, thickness_m: float, root_face_m: float, half_gap_m: float, widest_m: float, spacing_m: float
) -> Manifold:
    """The body that is milled out: the exact section at closely spaced places, reaching out of the plate."""
    spacing = min(spacing_m, path.chord_spacing(_MESH_CHORD_M, widest_m))
    reach = path.length_m / 2 + widest_m + _CLEARANCE_M  # offset curves end beside their place on the path
    x = np.linspace(-reach, reach, 2 * int(np.ceil(reach / spacing)) + 1)
    top_z = thickness_m + _CLEARANCE_M
    below = -_CLEARANCE_M
    edge_m = half_gap_m + (thickness_m - root_face_m) / (top_z - root_face_m) * (widest_m - half_gap_m)
    # (to the left, z), counter-clockwise seen against +x; corners at the plate's top keep the cut free of slivers
    section = [(edge_m, thickness_m), (widest_m, top_z), (-widest_m, top_z), (-edge_m, thickness_m)]
    if half_gap_m == 0:
        section += [(0.0, root_face_m)]
    else:
        section += [(-half_gap_m, root_face_m), (-half_gap_m, below), (half_gap_m, below), (half_gap_m, root_face_m)]
    columns = [np.column_stack([path.offset(x, to_left), np.full(len(x), z)]) for to_left, z in section]
    return loft(np.stack(columns, axis=1))


def _seam(path: SPath, thickness_m: float, root_face_m: float, half_top_m: float) -> Seam:
    """The exact lines, sampled so that even straight chords between the samples are exact to `_SEAM_CHORD_M`."""
    half = path.length_m / 2
    end = min(half, *(_place_at(path, half, side) for side in (half_top_m, -half_top_m)))
    spacing = min(0.25e-3, path.chord_spacing(_SEAM_CHORD_M, half_top_m))
    x = np.linspace(-end, end, 2 * int(np.ceil(end / spacing)) + 1)
    arc_length = cumulative_simpson(np.sqrt(1 + path.slope(x) ** 2), x=x, initial=0)

    def line(to_left_m: float, z_m: float) -> Float[np.ndarray, "n 3"]:
        return np.column_stack([path.offset(x, to_left_m), np.full(len(x), z_m)])

    points = {
        "left": line(half_top_m, thickness_m),
        "root": line(0.0, root_face_m),
        "right": line(-half_top_m, thickness_m),
    }
    return Seam(arc_length_m=arc_length, points=points)


def _place_at(path: SPath, x_m: float, to_left_m: float) -> float:
    """The place on the path whose offset point has this x: offset curves run forwards only, so bisection finds it."""
    low, high = x_m - 2 * abs(to_left_m), x_m + 2 * abs(to_left_m)
    for _ in range(80):
        middle = (low + high) / 2
        if path.offset(np.array([middle]), to_left_m)[0, 0] < x_m:
            low = middle
        else:
            high = middle
    return low

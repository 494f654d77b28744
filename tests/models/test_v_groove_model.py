"""The V-groove plate: mesh sections and seam lines against the groove's definition."""

import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import distance_to_polyline
from weldcell.models.v_groove import v_groove_plate

L, W, T, ANGLE, FACE, A = 0.300, 0.160, 0.060, np.deg2rad(45), 0.004, 0.020
K = 2 * np.pi / L
MESH_M = 1e-6  # the mesh's chords stray from the exact curves by less than this


def plate(gap_m=0.0, face_m=FACE, amplitude_m=A, **more):
    return v_groove_plate(L, W, T, ANGLE, gap_m, face_m, amplitude_m, **more)


@pytest.fixture(scope="module", params=[(0.0, FACE), (0.002, FACE), (0.002, 0.0)], ids=["tight", "gap", "no face"])
def groove(request):
    gap_m, face_m = request.param
    return gap_m, face_m, plate(gap_m, face_m)


def path(x):
    """Point, unit tangent and unit normal to the left, written anew from y = A sin(2 pi x / L)."""
    tangent = np.array([1, A * K * np.cos(K * x), 0])
    tangent /= np.linalg.norm(tangent)
    return np.array([x, A * np.sin(K * x), 0]), tangent, np.array([-tangent[1], tangent[0], 0])


@pytest.mark.parametrize("x", [-0.12, -0.075, -0.031, 0.0013, 0.044, 0.075, 0.118])
def test_perpendicular_section_of_the_mesh_is_the_exact_v(groove, x):
    gap_m, face_m, piece = groove
    point, tangent, left = path(x)
    section = piece.mesh_part().section(plane_origin=point, plane_normal=tangent)
    across = section.vertices @ left - point @ left
    height = section.vertices[:, 2]
    near = np.abs(across) < 0.03
    half_top = gap_m / 2 + (T - face_m) * np.tan(ANGLE / 2)
    wall = near & (height > face_m + 1e-6) & (height < T - 1e-6)
    wall_error = np.abs(across[wall]) - (gap_m / 2 + (height[wall] - face_m) * np.tan(ANGLE / 2))
    assert np.abs(wall_error).max() < MESH_M
    top = across[near & (height > T - 1e-9)]
    edges = [top[top < 0].max(), top[top > 0].min()]
    np.testing.assert_allclose(edges, [-half_top, half_top], atol=MESH_M)
    if gap_m == 0:
        root = near & (height < face_m + 1e-4) & (height > 1e-6)
        np.testing.assert_allclose([across[root].min(), height[root].min()], [0, face_m], atol=MESH_M)
    else:
        bottom = across[near & (height < 1e-9)]
        slot = [bottom[bottom < 0].max(), bottom[bottom > 0].min()]
        np.testing.assert_allclose(slot, [-gap_m / 2, gap_m / 2], atol=MESH_M)


def test_seam_points_are_the_perpendicular_offsets_of_the_path(groove):
    gap_m, face_m, piece = groove
    seam = piece.seam_part
    half_top = gap_m / 2 + (T - face_m) * np.tan(ANGLE / 2)
    for i in range(0, len(seam.arc_length_m), 97):
        point, _, left = path(seam.points["root"][i, 0])
        np.testing.assert_allclose(seam.points["root"][i], point + [0, 0, face_m], atol=1e-12)
        np.testing.assert_allclose(seam.points["left"][i], point + half_top * left + [0, 0, T], atol=1e-12)
        np.testing.assert_allclose(seam.points["right"][i], point - half_top * left + [0, 0, T], atol=1e-12)


def test_top_edges_of_the_mesh_lie_on_the_seam_lines(groove):
    _, _, piece = groove
    mesh = piece.mesh_part()
    sharp = mesh.face_adjacency_edges[mesh.face_adjacency_angles > 0.5]
    ends = mesh.vertices[sharp]
    inside = np.all((np.abs(ends[..., 2] - T) < 1e-9) & (np.abs(ends[..., 1]) < W / 2 - 1e-6), axis=1)
    inside &= np.all(np.abs(ends[..., 0]) < 0.125, axis=1)
    middles = ends[inside][::10].mean(axis=1)  # where chords stray the most
    lines = [distance_to_polyline(middles, piece.seam_part.points[name]) for name in ("left", "right")]
    assert len(middles) > 100
    assert np.min(lines, axis=0).max() < MESH_M


def test_root_line_lies_on_a_mesh_edge():
    piece = plate()
    mesh = piece.mesh_part()
    ends = mesh.vertices[mesh.face_adjacency_edges[mesh.face_adjacency_angles > 0.5]]
    root = ends[np.all(np.abs(ends[..., 2] - FACE) < 1e-9, axis=1)]
    assert np.ptp(root[..., 0]) == pytest.approx(L, abs=1e-9)
    middles = root.mean(axis=1)
    middles = middles[np.abs(middles[:, 0]) < 0.139]  # the seam ends where the whole section does
    assert distance_to_polyline(middles, piece.seam_part.points["root"]).max() < MESH_M


def test_seam_stays_on_the_plate_and_reaches_its_end_with_one_feature(groove):
    seam = groove[2].seam_part
    x = np.stack([points[:, 0] for points in seam.points.values()])
    assert np.abs(x).max() == pytest.approx(L / 2, abs=1e-9)


def test_arc_length_is_the_paths(groove):
    """Against a fine polygon of the path over the same stretch."""
    seam = groove[2].seam_part
    x = np.linspace(*seam.points["root"][[0, -1], 0], 200_001)
    polygon_m = np.sum(np.hypot(np.diff(x), np.diff(A * np.sin(K * x))))
    assert seam.arc_length_m[-1] == pytest.approx(polygon_m, abs=1e-9)  # the polygon's own error: 1e-11 m


def test_seam_chords_stray_less_than_ten_nanometres(groove):
    _, _, piece = groove
    for points in piece.seam_part.points.values():
        a, b, c = points[:-2], points[1:-1], points[2:]
        chord = c - a
        height = np.linalg.norm(np.cross(b - a, chord), axis=1) / np.linalg.norm(chord, axis=1)
        assert (height / 4).max() < 1.05e-8  # sagitta over one step is a quarter of that over two


def test_volume_is_plate_less_groove():
    """By Pappus for a section swept perpendicular to a plane path: the S's bends cancel, the ends are cut square."""
    half_top = (T - FACE) * np.tan(ANGLE / 2)
    straight_m3 = L * (W * T - half_top * (T - FACE))
    assert plate(amplitude_m=0.0).mesh_part().volume == pytest.approx(straight_m3, rel=1e-12)
    # In slices z = const the groove is the strip |offset| < d; its lengths along x at +d and -d differ from the
    # path's by equal and opposite amounts, so its area is 2 d S, S the path's length, less the square cut's excess,
    # which is second order in d times the path's curvature at the ends (zero there).
    s_m = np.sum(np.hypot(np.diff(x := np.linspace(-L / 2, L / 2, 200_001)), np.diff(A * np.sin(K * x))))
    swept_m3 = L * W * T - s_m * half_top * (T - FACE)
    assert plate().mesh_part().volume == pytest.approx(swept_m3, rel=2e-4)


def test_no_gap_gives_one_solid_and_a_gap_two():
    assert plate().mesh_part().body_count == 1
    assert plate(gap_m=0.002).mesh_part().body_count == 2


def test_left_is_left_of_the_direction_of_travel(groove):
    seam = groove[2].seam_part
    middle = len(seam.arc_length_m) // 2
    assert seam.points["left"][middle, 1] > seam.points["root"][middle, 1] > seam.points["right"][middle, 1]
    assert np.all(np.diff(seam.points["root"][:, 0]) > 0)


def test_offsets_beyond_the_radius_of_curvature_are_refused():
    """Radius at the crests 1 / (A k^2) = 22.8 mm, half the groove's width 23.2 mm."""
    with pytest.raises(BadGeometry, match="radius of curvature"):
        v_groove_plate(L, 0.4, T, ANGLE, 0.0, FACE, 0.1)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"amplitude_m": 0.06}, "swings"),
        ({"amplitude_m": np.nan}, "finite"),
        ({"face_m": 0.0}, "falls apart"),
        ({"face_m": 0.07}, "root face"),
        ({"gap_m": -0.001}, "not negative"),
        ({"gap_m": 0.12, "amplitude_m": 0.0}, "half the width"),
        ({"spacing_m": 1e-7}, "cross-sections"),
    ],
)
def test_impossible_plates_are_refused(change, words):
    with pytest.raises(BadGeometry, match=words):
        plate(**change)

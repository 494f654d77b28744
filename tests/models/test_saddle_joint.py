"""The saddle: the root lies on both cylinders, slices have the angle between them, the volume is the integrals'."""

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad

from weldcell.cell.errors import BadGeometry
from weldcell.models.saddle_joint import SaddleSize, saddle_part
from weldcell.models.swept_joint import TackWelds

R, BRANCH, WALL, BRANCH_WALL, L, RISE = 0.075, 0.035, 0.008, 0.006, 0.240, 0.060
MESH_M = 0.6e-6


@pytest.fixture(scope="module")
def part():
    return saddle_part()


def test_root_lies_on_both_cylinders_and_runs_once_around(part):
    x, y, z = part.seam_part.points["root"].T
    np.testing.assert_allclose(np.hypot(x, y), BRANCH, atol=1e-15)
    np.testing.assert_allclose(np.hypot(y, z), R, atol=1e-15)
    turn = np.unwrap(np.arctan2(y, x))
    assert np.all(np.diff(turn) > 0)
    assert np.ptp(turn) == pytest.approx(2 * np.pi)


def test_arc_length_is_the_curves(part):
    """Four equal quarters, each by quadrature."""

    def speed(phi):
        slope = BRANCH**2 * np.sin(phi) * np.cos(phi) / np.sqrt(R**2 - (BRANCH * np.sin(phi)) ** 2)
        return np.hypot(BRANCH, slope)

    assert part.seam_part.arc_length_m[-1] == pytest.approx(4 * quad(speed, 0, np.pi / 2)[0], abs=1e-10)


@pytest.mark.parametrize("phi", [0.013, 0.7, 1.5612, 2.9, 4.4])
def test_slices_across_the_root_have_the_corner_of_both_pipes(part, phi):
    """The angle between wall and run is pi/2 + asin(r sin^2(phi) / R); left is the branch."""
    root = np.array([BRANCH * np.cos(phi), BRANCH * np.sin(phi), np.sqrt(R**2 - (BRANCH * np.sin(phi)) ** 2)])
    run, branch = root * [0, 1, 1] / R, np.array([np.cos(phi), np.sin(phi), 0])
    tangent = np.cross(run, branch)
    tangent /= np.linalg.norm(tangent)
    assert tangent @ np.array([-np.sin(phi), np.cos(phi), 0]) > 0
    lines = trimesh.intersections.mesh_plane(part.mesh_part(), tangent, root)
    ends = (lines - root).reshape(-1, 3)
    assert np.linalg.norm(ends, axis=1).min() < MESH_M
    near = ends[np.linalg.norm(ends, axis=1) < 0.004] + root
    on_run, on_branch = np.hypot(*near[:, 1:].T) - R, np.hypot(*near[:, :2].T) - BRANCH
    assert np.minimum(np.abs(on_run), np.abs(on_branch)).max() < 2e-6
    segments = lines[np.linalg.norm(lines - root, axis=2).min(axis=1) < 2 * MESH_M]
    ways = [(far - near) for near, far in (sorted(s, key=lambda p: np.linalg.norm(p - root)) for s in segments)]
    ways = [way / np.linalg.norm(way) for way in ways if np.linalg.norm(way) > 1e-4]
    assert len(ways) == 2
    angle = np.arccos(ways[0] @ ways[1])
    curved = 1e-3 / R  # rad: the first triangle on the run is a chord of 0.6 mm
    assert angle == pytest.approx(np.pi / 2 + np.arcsin(BRANCH * np.sin(phi) ** 2 / R), abs=2 * curved)
    seam = part.seam_part
    k = np.argmin(np.linalg.norm(seam.points["root"] - root, axis=1))
    np.testing.assert_allclose(seam.approach[k], (ways[0] + ways[1]) / np.linalg.norm(ways[0] + ways[1]), atol=0.02)


def test_mesh_edge_follows_the_root(part):
    mesh = part.mesh_part()
    x, y, z = mesh.vertices.T
    on = np.flatnonzero((np.abs(np.hypot(x, y) - BRANCH) < 1e-12) & (np.abs(np.hypot(y, z) - R) < 1e-12))
    edges = mesh.edges_unique[np.all(np.isin(mesh.edges_unique, on), axis=1)]
    middles = mesh.vertices[edges].mean(axis=1)
    phi = np.arctan2(middles[:, 1], middles[:, 0])
    exact = np.column_stack([BRANCH * np.cos(phi), BRANCH * np.sin(phi), np.sqrt(R**2 - (BRANCH * np.sin(phi)) ** 2)])
    assert len(edges) == len(on) > 300
    assert np.linalg.norm(middles - exact, axis=1).max() < MESH_M


def test_volume_is_the_integral_of_both_pipes(part):
    """Half pipe, less its hole (bore), plus the branch's wall above the run: heights integrated over discs."""

    def under(radius, over):  # integral of sqrt(radius^2 - y^2) over the disc x^2 + y^2 < over^2
        return quad(lambda y: 2 * np.sqrt((over**2 - y**2) * (radius**2 - y**2)), -over, over)[0]

    bore, inner = BRANCH - BRANCH_WALL, R - WALL
    shell = np.pi / 2 * (R**2 - inner**2) * L - (under(R, bore) - under(inner, bore))
    wall = np.pi * (BRANCH**2 - bore**2) * (R + RISE) - (under(R, BRANCH) - under(R, bore))
    assert part.mesh_part().volume == pytest.approx(shell + wall, rel=1e-3)  # inner side: 24 steps to the border


def test_part_is_one_ring_on_its_two_long_edges(part):
    mesh = part.mesh_part()
    assert (mesh.body_count, mesh.euler_number) == (1, 0)
    np.testing.assert_allclose(mesh.bounds, [[-L / 2, -R, 0], [L / 2, R, R + RISE]], atol=1e-12)
    assert len(part.faces) < 100_000


@pytest.mark.parametrize("ratio", [0.2, 0.6, 0.88])
def test_pipes_of_other_sizes_are_sheets_without_folds(ratio):
    """Triangles on the run's outer side all look outwards."""
    size = SaddleSize(branch_radius_m=ratio * R, run_wall_m=0.004, branch_wall_m=0.004)
    mesh = saddle_part(size).mesh_part()
    corners = mesh.triangles
    on_run = np.all(np.abs(np.hypot(corners[..., 1], corners[..., 2]) - R) < 1e-9, axis=1)
    outward = mesh.triangles_center[on_run] * [0, 1, 1] / R
    assert np.einsum("ni,ni->n", mesh.face_normals[on_run], outward).min() > 0.99


def test_seam_covers_the_stretch_asked_for_and_tacks_stand_on_it():
    part = saddle_part(start_rad=-1.0, end_rad=1.5, tacks=TackWelds(stations_m=(0.03,), length_m=0.01))
    root = part.seam_part.points["root"]
    np.testing.assert_allclose(np.arctan2(root[[0, -1], 1], root[[0, -1], 0]), [-1.0, 1.5], atol=1e-12)
    added = 1e9 * (part.mesh_part().volume - saddle_part().mesh_part().volume)
    assert 15 < added < 60  # mm3: a fillet of 3 mm legs (about 5 mm2), 10 mm long, half-elliptic
    assert part.mesh_part().body_count == 1


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        ({"branch_radius_m": 0.074}, "branch_radius_m"),
        ({"branch_wall_m": 0.04}, "thinner"),
        ({"run_radius_m": np.nan}, "run_radius_m"),
        ({"run_wall_m": 0.05}, "bore"),
        ({"run_length_m": 0.05}, "run_length_m"),
    ],
)
def test_impossible_pipes_are_refused(sizes, words):
    with pytest.raises(BadGeometry, match=words):
        SaddleSize(**sizes)


def test_more_than_a_turn_is_refused():
    with pytest.raises(BadGeometry, match="one turn"):
        saddle_part(end_rad=7.0)

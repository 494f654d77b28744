"""The U seam on a curved surface: exact lines, mesh sections, the surface's own curvature."""

import numpy as np
import pytest
import trimesh

from weldcell.cell.errors import BadGeometry
from weldcell.models.curved_surface import CurvedSurface
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.seam_path import SPath
from weldcell.models.surface_joint import surface_joint_part, u_seam_part
from weldcell.models.swept_joint import TackWelds

L, W, A = 0.3, 0.1, 0.012
DEPTH, RADIUS, LEAN = 0.010, 0.004, np.deg2rad(10)
H, WAVE, LENGTH, ACROSS, TWIST = 0.055, 0.018, 0.33, 0.25, 0.3  # the default surface, written anew
K, Q = 2 * np.pi / LENGTH, 2 * np.pi / L
MESH_M, ARC_M = 0.6e-6, 2.6e-6  # chords along the groove, and those of the rounded bottom
SURFACE_M = 15e-6  # triangles of 4 mm on radii of 150 mm and more, far from the groove


def surface_z(x, y):
    return H + WAVE * np.cos(K * x) - y**2 / (2 * ACROSS) + TWIST * x * y


def frame(x):
    """Point of the curve, travel, left and normal there."""
    y, slope = A * np.sin(Q * x), A * Q * np.cos(Q * x)
    gx, gy = -WAVE * K * np.sin(K * x) + TWIST * y, -y / ACROSS + TWIST * x
    normal = np.array([-gx, -gy, 1]) / np.sqrt(gx**2 + gy**2 + 1)
    travel = np.array([1, slope, gx + gy * slope])
    travel /= np.linalg.norm(travel)
    return np.array([x, y, surface_z(x, y)]), travel, np.cross(normal, travel), normal


@pytest.fixture(scope="module")
def part():
    return u_seam_part()


def test_seam_is_the_section_led_along_the_curve(part):
    """`centre` lies the groove's depth below the surface along its normal; left and right lie on the surface, in the
    section's plane, on the wall that is tangent to the bottom's circle.
    """
    seam = part.seam_part
    assert list(seam.points) == ["left", "centre", "right"]
    for i in range(0, len(seam.arc_length_m), 149):
        x = seam.points["centre"][i, 0]
        for _ in range(80):  # fixed point: the centre lies off the curve's x where the surface leans
            point, _, _, normal = frame(x)
            x += seam.points["centre"][i, 0] - (point - DEPTH * normal)[0]
        point, travel, left, normal = frame(x)
        np.testing.assert_allclose(seam.points["centre"][i], point - DEPTH * normal, atol=1e-11)
        np.testing.assert_allclose(seam.approach[i], normal, atol=1e-9)
        circle = point - (DEPTH - RADIUS) * normal
        for name, side in (("left", 1), ("right", -1)):
            edge = seam.points[name][i]
            assert edge[2] == pytest.approx(surface_z(edge[0], edge[1]), abs=1e-12)
            assert (edge - point) @ travel == pytest.approx(0, abs=1e-11)
            outward = side * np.cos(LEAN) * left - np.sin(LEAN) * normal  # normal of the wall
            assert (edge - circle) @ outward == pytest.approx(RADIUS, abs=1e-11)


@pytest.mark.parametrize("x", [-0.1203, -0.061, 0.0007, 0.033, 0.1151])
def test_slices_across_the_curve_are_the_u(part, x):
    point, travel, left, normal = frame(x)
    lines = trimesh.intersections.mesh_plane(part.mesh_part(), travel, point)
    across, up = (lines - point).reshape(-1, 3) @ left, (lines - point).reshape(-1, 3) @ normal
    near = (np.abs(across) < 0.015) & (up > -DEPTH - 1e-4)
    across, up, points = across[near], up[near], lines.reshape(-1, 3)[near]
    tangent_up = -DEPTH + RADIUS * (1 - np.sin(LEAN))
    bottom = up < tangent_up
    assert bottom.sum() > 30
    assert np.abs(np.hypot(across, up + DEPTH - RADIUS)[bottom] - RADIUS).max() < ARC_M
    wall = ~bottom & (np.abs(across) < RADIUS * np.cos(LEAN) + (up - tangent_up) * np.tan(LEAN) + 1e-6)
    expected = RADIUS * np.cos(LEAN) + (up[wall] - tangent_up) * np.tan(LEAN)
    assert np.abs(np.abs(across[wall]) - expected).max() < 1e-6  # m: chords, and diagonals of a wall that turns
    above = ~bottom & ~wall
    assert np.abs(points[above, 2] - surface_z(*points[above, :2].T)).max() < 2e-6  # within 15 mm of the groove
    seam = part.seam_part
    for name in seam.points:
        k = np.argmin(np.abs((seam.points[name] - point) @ travel))
        fine = seam.at(name, np.linspace(*seam.arc_length_m[[k - 1, k + 1]], 4001))
        place = fine[np.argmin(np.abs((fine - point) @ travel))] - point
        assert np.hypot(across - place @ left, up - place @ normal).min() < MESH_M


def test_surface_of_the_mesh_is_the_surface(part):
    mesh = part.mesh_part()
    top = mesh.face_normals[:, 2] > 0.5
    centres = mesh.triangles_center[top]
    off = surface_z(*centres[:, :2].T) - centres[:, 2]
    free = off < 1e-4  # the groove's bottom also looks up
    assert free.sum() > 5000
    assert np.abs(off[free]).max() < SURFACE_M


def test_block_is_one_closed_solid_on_its_underside(part):
    mesh = part.mesh_part()
    assert (mesh.body_count, mesh.euler_number) == (1, 2)
    np.testing.assert_allclose(mesh.bounds[:, :2], [[-L / 2, -W / 2], [L / 2, W / 2]], atol=1e-9)
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=1e-12)
    assert len(part.faces) < 90_000


def test_volume_is_the_blocks_less_the_swept_grooves(part):
    """Block: the surface's integral over the rectangle in closed form. Groove: area of the section up to the surface
    times the curve's length, to first order in the groove's width over the radii (a few percent of the groove).
    """
    block = L * W * H + WAVE * W * 2 / K * np.sin(K * L / 2) - L * W**3 / 12 / (2 * ACROSS)
    tangent_x, tangent_z = RADIUS * np.cos(LEAN), RADIUS * (1 - np.sin(LEAN))
    top = tangent_x + (DEPTH - tangent_z) * np.tan(LEAN)
    circle = RADIUS**2 / 2 * (np.pi / 2 - LEAN) - RADIUS**2 / 2 * np.sin(LEAN) * np.cos(LEAN)
    area = 2 * (circle + (tangent_x + top) / 2 * (DEPTH - tangent_z))
    groove = area * part.seam_part.arc_length_m[-1] * (L / np.ptp(part.seam_part.points["centre"][:, 0]))
    assert block - part.mesh_part().volume == pytest.approx(groove, rel=0.04)


def test_surface_bends_gently_and_both_ways(part):
    """Radii of the normal curvature along the seam: 150 mm and more, hollow and domed; the normal leans 20 deg."""
    seam = part.seam_part
    s = np.linspace(0.005, seam.arc_length_m[-1] - 0.005, 400)
    normals, points = seam.approach_at(s), seam.at("centre", s) + DEPTH * seam.approach_at(s)
    bend = np.einsum("ni,ni->n", np.diff(normals, axis=0), np.diff(points, axis=0))
    bend /= np.sum(np.diff(points, axis=0) ** 2, axis=1)
    assert bend.max() > 1 / 250
    assert bend.min() < -1 / 2
    assert np.abs(bend).max() < 1 / 0.150
    assert np.rad2deg(np.arccos(seam.approach[:, 2])).max() < 20


def test_arc_length_is_that_of_the_curve_on_the_surface(part):
    seam = part.seam_part
    points = seam.points["centre"] + DEPTH * seam.approach
    polygon = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
    assert seam.arc_length_m[-1] == pytest.approx(polygon, abs=2e-8)  # m: sagittas of 0.15 mm steps


def test_tacks_fill_the_groove():
    plain, tacked = u_seam_part(), u_seam_part(tacks=TackWelds(stations_m=(0.08, 0.2), length_m=0.02))
    added = tacked.mesh_part().volume - plain.mesh_part().volume
    assert 2 * 0.2 < 1e6 * added < 2 * 1.0  # cm3: half an ellipse of 20 mm by half of the groove's 75 mm2, each
    assert tacked.mesh_part().body_count == 1
    np.testing.assert_array_equal(tacked.seam_part.points["left"], plain.seam_part.points["left"])


@pytest.mark.parametrize("kind", ["bevel", "j"])
def test_square_faces_stand_on_surfaces_that_lean(kind):
    """Where the surface falls to the right, the square face leans out over its foot, and the block is still sound."""
    size = JointSize(thickness_m=0.02, groove_angle_rad=np.deg2rad(45), root_face_m=0.002, root_radius_m=0.008)
    surface = CurvedSurface(height_m=0.055, wave_m=0.018, wavelength_m=0.33, across_radius_m=0.25, twist=0.3)
    plan = SPath(length_m=0.3, amplitude_m=0.02)
    part = surface_joint_part(joint_section(kind, size), plan, surface, 0.16)
    mesh, seam = part.mesh_part(), part.seam_part
    assert mesh.is_watertight and len(mesh.split()) == 1
    face = (seam.points["right"] - seam.points["root"]) @ [0, 1, 0]
    assert face.min() < -1e-3 and face.max() > 1e-3  # m: it leans to either side somewhere
    normal = seam.approach[len(seam.approach) // 2]
    middle = {name: points[len(points) // 2] for name, points in seam.points.items()}
    point = (middle["root"] + middle["right"]) / 2
    inside = mesh.contains([point - 2e-4 * np.cross(normal, [1, 0, 0]), point + 2e-4 * np.cross(normal, [1, 0, 0])])
    assert inside.tolist() == [False, True] or inside.tolist() == [True, False]  # the face lies between


def test_v_grooves_are_milled_into_surfaces_too():
    size = JointSize(thickness_m=0.02, root_face_m=0.012, groove_angle_rad=np.deg2rad(60))
    surface = CurvedSurface(height_m=0.05, wave_m=0.0, wavelength_m=1.0, across_radius_m=-0.4)
    part = surface_joint_part(joint_section("v", size), SPath(length_m=0.1, amplitude_m=0.0), surface, 0.06)
    root, left = part.seam_part.points["root"], part.seam_part.points["left"]
    np.testing.assert_allclose(root[:, 1:], np.tile([0, 0.042], (len(root), 1)), atol=1e-12)
    np.testing.assert_allclose(left[:, 2], 0.05 + left[:, 1] ** 2 / 0.8, atol=1e-12)
    np.testing.assert_allclose((left[:, 2] - 0.042) * np.tan(np.deg2rad(30)), left[:, 1], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"amplitude_m": 0.1}, "radius of curvature"),
        ({"groove_depth_m": 0.04}, "underside"),
        ({"width_m": 0.8}, "radius of curvature"),
        (
            {
                "groove_depth_m": 0.03,
                "surface": CurvedSurface(height_m=0.08, wave_m=0.01, wavelength_m=0.1, across_radius_m=1),
            },
            "cross one another",  # crests of 25 mm radius: sections meet 25 mm below
        ),
        ({"surface": CurvedSurface(height_m=0.01, wave_m=0.03, wavelength_m=0.3, across_radius_m=1)}, "underside"),
    ],
)
def test_impossible_blocks_are_refused(change, words):
    with pytest.raises(BadGeometry, match=words):
        u_seam_part(**change)


@pytest.mark.parametrize(
    ("kind", "more", "words"),
    [
        ("u", {"root_gap_m": 1e-3}, "root_gap_m"),
        ("u", {"mismatch_m": 1e-3}, "mismatch_m"),
        ("lap", {}, "groove"),
    ],
)
def test_joints_that_cannot_be_milled_are_refused(kind, more, words):
    size = JointSize(thickness_m=0.02, root_face_m=0.01, root_radius_m=0.004, groove_angle_rad=0.3, **more)
    surface = CurvedSurface(height_m=0.05, wave_m=0.0, wavelength_m=1.0, across_radius_m=1.0)
    with pytest.raises(BadGeometry, match=words):
        surface_joint_part(joint_section(kind, size), SPath(length_m=0.1, amplitude_m=0.0), surface, 0.06)


def test_surfaces_without_size_are_refused():
    with pytest.raises(BadGeometry, match="wavelength"):
        CurvedSurface(height_m=0.05, wave_m=0.0, wavelength_m=0.0, across_radius_m=1.0)

"""A part from outside is put right where that is safe, said so, and its seam lies where it was drawn."""

import numpy as np
import pytest
import trimesh

from weldcell.cell.errors import BadGeometry
from weldcell.models.mesh_repair import edge_faults, sound_mesh
from weldcell.models.own_part import DrawnMesh, SeamLines, SeamPick, own_part, seam_of_lines
from weldcell.models.sharp_edges import sharp_line


def box(size, at=(0, 0, 0)):
    mesh = trimesh.creation.box(extents=size)
    return np.array(mesh.vertices) + at, np.array(mesh.faces)


def drawn(vertices, faces, **told):
    return DrawnMesh(vertices=vertices, faces=faces, **told)


def volume(part):
    return part.workpiece.mesh_part().volume


def test_a_box_in_millimetres_stands_on_its_underside_centre_in_metres():
    part = own_part(drawn(*box((200, 100, 20), at=(300, 40, 7))), name="p", unit="mm")
    low, high = part.workpiece.vertices_part.min(axis=0), part.workpiece.vertices_part.max(axis=0)
    assert low == pytest.approx([-0.1, -0.05, 0], abs=1e-12)  # m; rounding alone
    assert high == pytest.approx([0.1, 0.05, 0.02], abs=1e-12)
    assert part.remarks == ()
    # a corner of the file's own frame: (200, -10, -3) mm
    assert part.T_part_drawn.apply([0.2, -0.01, -0.003]) == pytest.approx([-0.1, -0.05, 0], abs=1e-12)


@pytest.mark.parametrize(("up", "size"), [("z", (1, 2, 3)), ("y", (1, 3, 2)), ("x", (3, 2, 1)), ("-y", (1, 3, 2))])
def test_the_axis_called_up_is_up(up, size):
    part = own_part(drawn(*box((0.1, 0.2, 0.3))), name="p", unit="m", up=up)
    assert np.ptp(part.workpiece.vertices_part, axis=0) == pytest.approx(0.1 * np.array(size), abs=1e-12)
    axis = {"x": 0, "y": 1, "z": 2}[up[-1]]
    along = np.eye(3)[axis] * (-1 if up[0] == "-" else 1)
    assert part.T_part_drawn.rotation.apply(along) == pytest.approx([0, 0, 1], abs=1e-15)


def test_a_size_that_only_millimetres_explain_is_read_as_millimetres_and_said():
    part = own_part(drawn(*box((300, 100, 20))), name="p")
    assert np.ptp(part.workpiece.vertices_part[:, 0]) == pytest.approx(0.3)
    assert "no unit given: read in mm" in part.remarks[0] and "units: mm" in part.remarks[0]


def test_units_that_were_said_are_obeyed_with_a_hint():
    part = own_part(drawn(*box((300, 100, 20))), name="p", unit="m")
    assert np.ptp(part.workpiece.vertices_part[:, 0]) == pytest.approx(300)
    assert "300 m large" in part.remarks[0] and "say units: mm" in part.remarks[0]
    tiny = own_part(drawn(*box((0.3, 0.1, 0.02))), name="p", unit="mm")
    assert "say units: m " in tiny.remarks[0]


def test_a_format_in_metres_that_holds_millimetres_is_read_as_such_and_said():
    part = own_part(drawn(*box((300, 100, 20)), unit="m"), name="p")
    assert np.ptp(part.workpiece.vertices_part[:, 0]) == pytest.approx(0.3)
    assert "read in mm, not in the format's m" in part.remarks[0]


def test_an_inverted_part_is_turned_and_said():
    vertices, faces = box((0.2, 0.1, 0.02))
    part = own_part(drawn(vertices, faces[:, ::-1]), name="p", unit="m")
    assert volume(part) == pytest.approx(0.2 * 0.1 * 0.02)
    assert part.remarks == ("1 of 1 shells inside out: turned",)


@pytest.mark.parametrize("seed", range(4))
def test_triangles_turned_at_random_are_turned_back(seed):
    rng = np.random.default_rng(seed)
    one, two = trimesh.creation.icosphere(subdivisions=2, radius=0.1), trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    vertices = np.vstack([one.vertices, two.vertices + [0.5, 0, 0]])
    faces = np.vstack([one.faces, two.faces + len(one.vertices)])
    turned = rng.random(len(faces)) < 0.3
    faces[turned] = faces[turned][:, ::-1]
    mesh = sound_mesh(vertices, faces)
    assert mesh.closed
    fixed = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert fixed.volume == pytest.approx(one.volume + two.volume, rel=1e-9)
    assert any("against the orientation" in remark for remark in mesh.remarks)


def test_an_open_part_is_a_surface_with_a_remark():
    vertices, faces = box((0.2, 0.1, 0.02))
    part = own_part(drawn(vertices, faces[:-1]), name="p", unit="m")
    assert not part.workpiece.closed
    assert part.remarks[0].startswith("open: 3 edges")


def test_a_sheet_looks_upwards():
    vertices = np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]], float)
    part = own_part(drawn(vertices, np.array([[0, 2, 1], [0, 3, 2]])), name="p", unit="m")
    assert part.workpiece.mesh_part().face_normals[:, 2] == pytest.approx(1.0)


def test_a_moebius_strip_stays_and_harms_nothing():
    turn = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    rim = [(1 + s * np.cos(turn / 2)) * np.exp(1j * turn) for s in (-0.1, 0.1)]
    vertices = np.vstack(
        [np.column_stack([r.real, r.imag, s * np.sin(turn / 2)]) for r, s in zip(rim, (-0.1, 0.1), strict=True)]
    )
    k = np.arange(39)
    faces = np.vstack(
        [
            np.column_stack([k, k + 1, k + 40]),
            np.column_stack([k + 1, k + 41, k + 40]),
            [[39, 40, 79], [40, 0, 79]][::-1],
        ]
    )
    mesh = sound_mesh(vertices, faces)
    assert len(mesh.faces) == len(faces) and not mesh.closed


def test_a_part_far_from_its_origin_is_moved_there_and_said():
    part = own_part(drawn(*box((0.2, 0.1, 0.02), at=(100, 0, 0))), name="p", unit="m")
    assert np.abs(part.workpiece.vertices_part).max() == pytest.approx(0.1)
    assert "drawn 100 m from its origin" in part.remarks[0]


def test_corners_given_apart_are_joined():
    vertices, faces = box((0.2, 0.1, 0.02))
    soup = vertices[faces].reshape(-1, 3)
    mesh = sound_mesh(soup, np.arange(len(soup)).reshape(-1, 3))
    assert mesh.closed and len(mesh.vertices) == 8 and mesh.remarks == ()
    shaken = soup + np.random.default_rng(0).uniform(-1e-8, 1e-8, soup.shape)  # m: rounding of another program
    assert sound_mesh(shaken, np.arange(len(soup)).reshape(-1, 3)).closed


def test_triangles_without_area_are_left_out_and_said():
    vertices, faces = box((0.2, 0.1, 0.02))
    mesh = sound_mesh(vertices, np.vstack([faces, [[0, 0, 1], [2, 3, 3]], faces[:1]]))
    assert len(mesh.faces) == 12 and mesh.closed
    assert "3 of 15 triangles" in mesh.remarks[0]
    with pytest.raises(BadGeometry, match="none with an area"):
        sound_mesh(vertices, np.zeros((4, 3), int))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_numbers_that_are_none_are_refused(bad):
    vertices, faces = box((0.2, 0.1, 0.02))
    vertices[3, 1] = bad
    with pytest.raises(BadGeometry, match=r"NaN or infinite|at most"):
        own_part(drawn(vertices, faces), name="p")


def v_groove(length=0.3, half=0.01, depth=0.01, steps=1, bend=0.0):
    """A prism with a V in its top along x, bent sideways by a sine; left is +y."""
    x = np.linspace(0, length, steps + 1)
    section = np.array(
        [(-0.05, 0), (0.05, 0), (0.05, 0.02), (half, 0.02), (0, 0.02 - depth), (-half, 0.02), (-0.05, 0.02)]
    )
    y = bend * np.sin(2 * np.pi * x / length)
    vertices = np.array([[a, b + s, c] for a, s in zip(x, y, strict=True) for b, c in section])
    n = len(section)
    k, j = np.meshgrid(np.arange(steps) * n, np.arange(n), indexing="ij")
    one, two = (k + j).ravel(), (k + (j + 1) % n).ravel()
    faces = np.vstack([np.column_stack([one, one + n, two]), np.column_stack([two, one + n, two + n])])
    caps = np.array([[0, 1, 4], [1, 3, 4], [1, 2, 3], [0, 4, 5], [0, 5, 6]])
    return vertices, np.vstack([faces, caps, caps[:, ::-1] + steps * n])[:, ::-1]


def test_the_root_of_a_groove_is_picked_from_its_inner_edges():
    vertices, faces = v_groove(steps=60, bend=0.01)
    pick = SeamPick(near_m=(0.3, 0.0, 0.03), sharper_than_rad=np.radians(30), kind="concave")
    part = own_part(drawn(vertices, faces), name="p", unit="m", seam=pick)
    assert part.workpiece.closed
    seam = part.workpiece.seam_part
    drawn_root = part.T_part_drawn.inv().apply(seam.points["root"])
    assert drawn_root[0] == pytest.approx([0.3, 0, 0.01], abs=1e-9)  # m: starts at the end near the point
    assert drawn_root[-1] == pytest.approx([0, 0, 0.01], abs=1e-9)
    chords = vertices.reshape(61, 7, 3)[:, 4]
    assert seam.arc_length_m[-1] == pytest.approx(np.linalg.norm(np.diff(chords, axis=0), axis=1).sum(), abs=1e-9)


def test_the_convex_edge_nearest_to_the_point_is_picked_on_either_side():
    vertices, faces = v_groove(steps=20)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    for side in (-1, 1):
        line = sharp_line(mesh, np.array([0.1, side * 0.012, 0.021]), sharper_than_rad=0.5, kind="convex")
        assert line.points[:, 1] == pytest.approx(side * 0.01) and not line.ring
        assert line.distance == pytest.approx(np.hypot(0.002, 0.001))


def test_a_line_ends_at_square_corners_and_a_ring_closes_counter_clockwise():
    square = trimesh.creation.box(extents=(0.2, 0.1, 0.02))
    side = sharp_line(square, np.array([0.0, -0.06, 0.01]), sharper_than_rad=0.5, kind="convex")
    assert len(side.points) == 2 and not side.ring
    pipe = trimesh.creation.cylinder(radius=0.05, height=0.1, sections=64)
    ring = sharp_line(pipe, np.array([0.06, 0.0, 0.05]), sharper_than_rad=1.0, kind="all")
    assert ring.ring and len(ring.points) == 65
    assert ring.points[0] == pytest.approx(ring.points[-1])
    angle = np.unwrap(np.arctan2(ring.points[:, 1], ring.points[:, 0]))
    assert angle[-1] - angle[0] == pytest.approx(2 * np.pi)


def test_a_smooth_part_has_no_sharp_edge_and_says_so():
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    pick = SeamPick(near_m=(0, 0, 0.1), sharper_than_rad=np.radians(30), kind="concave")
    with pytest.raises(BadGeometry, match="no concave edge sharper than 30 deg"):
        own_part(drawn(np.array(ball.vertices), np.array(ball.faces)), name="p", unit="m", seam=pick)


def test_features_of_a_seam_share_the_arc_length_of_the_root():
    x = np.linspace(0, 0.3, 31)
    lines = {"left": np.column_stack([x, 0 * x + 0.01, 0 * x]), "root": np.array([[0, 0, -0.01], [0.3, 0, -0.01]])}
    seam = seam_of_lines(lines)
    assert seam.arc_length_m[-1] == pytest.approx(0.3)
    assert seam.points["left"][:, 0] == pytest.approx(seam.arc_length_m, abs=1e-12)
    middle = seam.at("root", np.array([0.12345]))
    assert middle[0] == pytest.approx([0.12345, 0, -0.01], abs=1e-12)


def test_corners_of_a_drawn_seam_are_kept():
    seam = seam_of_lines({"root": np.array([[0, 0, 0], [0.1003, 0, 0], [0.1003, 0.05, 0]])})
    assert np.min(np.linalg.norm(seam.points["root"] - [0.1003, 0, 0], axis=1)) < 1e-12
    assert seam.arc_length_m[-1] == pytest.approx(0.1503)


def test_a_seam_off_the_part_is_remarked_on():
    on, off = ({"root": np.array([[-0.1, 0, z], [0.1, 0, z]])} for z in (0.01, 10.0))
    mesh = drawn(*box((0.2, 0.1, 0.02)))
    assert own_part(mesh, name="p", unit="m", seam=SeamLines(lines_m=on)).remarks == ()
    assert "off the part" in own_part(mesh, name="p", unit="m", seam=SeamLines(lines_m=off)).remarks[0]


def test_a_fine_mesh_turned_inside_out_is_put_right():
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.1)  # 81920
    mesh = sound_mesh(np.array(ball.vertices), np.array(ball.faces)[:, ::-1])
    assert mesh.closed and edge_faults(mesh.faces) == (0, 0)

"""A user's part is read from its files; hostile ones are refused in one line, quickly, with nothing else opened."""

import sys

import numpy as np
import pytest
import trimesh

from scenarios.user_cell.user_files import BOX, refused, refused_mesh, stl, written
from weldcell.cell.errors import NotReady
from weldcell.scenarios.user_cell.mesh_file import read_mesh
from weldcell.scenarios.user_cell.part_file import read_part
from weldcell.scenarios.user_cell.seam_file import read_seam


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "obj", "ply", "ply_ascii", "glb"])
def test_every_format_gives_the_same_part(folder, kind):
    suffix, _, text = kind.partition("_")
    content = (
        BOX.export(file_type=kind)
        if kind == "stl_ascii"
        else (BOX.export(file_type="ply", encoding="ascii") if text else BOX.export(file_type=suffix))
    )
    written(folder, f"box.{suffix}", content)
    told = written(folder, "part.yaml", f"file: box.{suffix}\nunits: mm\nup: z\n")
    part = read_part(told)
    assert part.remarks == ()
    assert np.ptp(part.workpiece.vertices_part, axis=0) == pytest.approx([0.2, 0.1, 0.02], abs=1e-8)
    assert part.workpiece.mesh_part().volume == pytest.approx(0.2 * 0.1 * 0.02, rel=1e-6)


def test_a_glb_has_y_up_and_metres_unless_told_otherwise(folder):
    written(folder, "box.glb", trimesh.creation.box(extents=(0.2, 0.02, 0.1)).export(file_type="glb"))
    part = read_part(written(folder, "part.yaml", "file: box.glb\n"))
    assert np.ptp(part.workpiece.vertices_part, axis=0) == pytest.approx([0.2, 0.1, 0.02], abs=1e-8)
    assert part.remarks == ()


def test_parts_of_a_glb_stand_where_its_nodes_put_them(folder):
    scene = trimesh.Scene()
    for x in (0.0, 0.5):
        place = trimesh.transformations.translation_matrix([x, 0, 0])
        scene.add_geometry(trimesh.creation.box(extents=(0.1, 0.1, 0.1)), transform=place)
    mesh = read_mesh(written(folder, "two.glb", scene.export(file_type="glb")), "two.glb")
    assert len(mesh.faces) == 24
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([0.6, 0.1, 0.1], abs=1e-7)


def test_the_seam_comes_from_its_file_in_the_meshs_own_frame(folder):
    written(folder, "box.stl", stl())
    written(folder, "seam.csv", "x_mm,y_mm,z_mm\n-100,0,10\n100,0,10\n")
    part = read_part(
        written(folder, "part.yaml", "file: box.stl\nunits: mm\nseam_file: seam.csv\nmaterial: aluminium\n")
    )
    seam = part.workpiece.seam_part
    assert seam.points["root"][[0, -1]] == pytest.approx(np.array([[-0.1, 0, 0.02], [0.1, 0, 0.02]]), abs=1e-12)
    assert part.workpiece.material == "aluminium" and part.remarks == ()


def test_the_seam_is_picked_from_sharp_edges(folder):
    written(folder, "box.stl", stl())
    told = "file: box.stl\nunits: mm\nseam_near_mm: [-90.0, -55.0, 12.0]\nseam_edges: convex\n"
    seam = read_part(written(folder, "part.yaml", told)).workpiece.seam_part
    assert seam.points["root"][[0, -1]] == pytest.approx(np.array([[-0.1, -0.05, 0.02], [0.1, -0.05, 0.02]]), abs=1e-9)


@pytest.mark.parametrize(
    "name",
    [
        "../box.stl",
        "/etc/passwd",
        "a/../../box.stl",
        "~/box.stl",
        "file:///etc/passwd",
        "C:\\box.stl",
        "..\\box.stl",
        "",
        "link.stl",
        "linked/box.stl",
    ],
)
def test_names_that_lead_out_of_the_folder_are_refused_unopened(folder, name):
    outside = folder.parent / "outside"
    outside.mkdir()
    for place in (folder.parent / "box.stl", outside / "box.stl"):
        place.write_bytes(stl())
    (folder / "link.stl").symlink_to(folder.parent / "box.stl")
    (folder / "linked").symlink_to(outside)
    written(folder, "box.stl", stl())
    for field in ("file", "seam_file"):
        lines = {"file": "box.stl", field: name}
        told = written(folder, "part.yaml", "".join(f"{key}: '{value}'\n" for key, value in lines.items()))
        refused(lambda told=told: read_part(told), "part.yaml", field)


def test_a_link_within_the_folder_is_followed(folder):
    written(folder, "box.stl", stl())
    (folder / "link.stl").symlink_to(folder / "box.stl")
    assert read_part(written(folder, "part.yaml", "file: link.stl\nunits: mm\n")).remarks == ()


@pytest.mark.skipif(sys.platform == "win32", reason="pipes in the file system")
def test_a_pipe_is_refused_and_does_not_block(folder):
    import os

    os.mkfifo(folder / "a.stl")
    refused(lambda: read_mesh(folder / "a.stl", "a.stl"), "plain file")
    refused(lambda: read_seam(folder / "a.stl", "seam.csv"), "plain file")


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ("units: mm\n", ["file: found nothing, expected a text"]),
        ("file: box.stl\nunits: inch\n", ["units", "one of mm, m"]),
        ("file: box.stl\nunit: mm\n", ["unit: no such field", "units"]),
        ("file: [box.stl]\n", ["file", "a text"]),
        ("file: box.stl\nseam_near_mm: [1, 2]\n", ["seam_near_mm"]),
        ("file: box.stl\nseam_near_mm: [1, 2, .nan]\n", ["seam_near_mm"]),
        ("file: box.stl\nseam_sharper_than_deg: 1e3\n", ["seam_sharper_than_deg"]),
        ("file: box.stl\nseam_near_mm: [1, 2, 3]\nseam_file: a.csv\n", ["one of the two"]),
        ("file: box.stl\nfile: box.stl\n", ["twice"]),
        ("file: !!python/object/apply:os.system ['true']\n", ["tag"]),
        ("file: missing.stl\n", ["missing.stl", "No such file"]),
        ('file: "a\\nb.stl"\n', ["part.yaml"]),
        ("file: box.stl\nunits: mm\nseam_near_mm: [0, 0, 0]\nseam_edges: concave\n", ["no concave edge"]),
    ],
)
def test_a_wrong_part_file_is_refused_by_field(folder, told, words):
    written(folder, "box.stl", stl())
    refused(lambda: read_part(written(folder, "part.yaml", told)), "part.yaml", *words)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["empty"]),
        ("x,y,z\n1,2,3\n", ["header", "x_mm,y_mm,z_mm"]),
        ("x_mm,y_mm,z_mm\n", ["header alone"]),
        ("x_mm,y_mm,z_mm\n1,2\n", ["line 2", "found 2 cells"]),
        ("x_mm,y_mm,z_mm\n1,5,2,3\n", ["line 2", "decimal"]),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,2,nan\n", ["line 3, column z_mm"]),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,2,1e300\n", ["line 3, column z_mm"]),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,2,3\n", ["one place"]),
        ("feature,x_mm,y_mm,z_mm\n,1,2,3\n", ["line 2, column feature"]),
        ("x_mm,y_mm,z_mm\n" + "1,2,3\n" * 20_001, ["20002 rows"]),
        (b"\xff\xfe\x00", ["UTF-8"]),
    ],
)
def test_a_wrong_seam_is_refused_by_line_and_column(folder, content, words):
    path = written(folder, "seam.csv", content)
    refused(lambda: read_seam(path, "seam.csv"), "seam.csv", *words)


def test_a_seam_with_features_windows_ends_and_a_mark_is_read(folder):
    text = "\ufefffeature,x_mm,y_mm,z_mm\r\nleft,0,5,0\r\nroot,0,0,0\r\nleft,10,5,0\r\nroot,10,0,0\r\n"
    lines = read_seam(written(folder, "seam.csv", text), "seam.csv").lines_m
    assert list(lines) == ["left", "root"]
    assert lines["left"] == pytest.approx(np.array([[0, 0.005, 0], [0.01, 0.005, 0]]))


STEP_HEAD = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('CONFIG_CONTROL_DESIGN'));\nENDSEC;\nDATA;\n"
)


def step_box(size):
    """A box as STEP in mm: six planes, each with its loop of corners."""
    lines = []

    def add(text):
        lines.append(f"#{len(lines) + 1}={text};")
        return f"#{len(lines)}"

    def vector(values):
        return ",".join(f"{x:.3f}" for x in values)

    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * np.array(size, float)
    points = [add(f"CARTESIAN_POINT('',({vector(corner)}))") for corner in corners]
    faces = []
    for loop in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)):
        along = corners[loop[1]] - corners[loop[0]]
        normal = np.cross(along, corners[loop[2]] - corners[loop[0]])
        poly_loop = add(f"POLY_LOOP('',({','.join(points[k] for k in loop)}))")
        bound = add(f"FACE_OUTER_BOUND('',{poly_loop},.T.)")
        axes = [add(f"DIRECTION('',({vector(v / np.linalg.norm(v))}))") for v in (normal, along)]
        placement = add(f"AXIS2_PLACEMENT_3D('',{points[loop[0]]},{axes[0]},{axes[1]})")
        plane = add(f"PLANE('',{placement})")
        faces.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = add(f"FACETED_BREP('',{shell})")
    unit = add("(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))")
    angle = add("(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))")
    context = add(
        f"(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT(({unit},{angle}))REPRESENTATION_CONTEXT('',''))"
    )
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({solid}),{context})")
    application = add("APPLICATION_CONTEXT('mechanical design')")
    field = add(f"PRODUCT_CONTEXT('',{application},'mechanical')")
    product = add(f"PRODUCT('box','box','',({field}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    stage = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{application},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',{formation},{stage})")
    defined = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({defined},{shape})")
    return STEP_HEAD + "\n".join(lines) + "\nENDSEC;\nEND-ISO-10303-21;\n"


def test_a_step_solid_is_read_in_metres_and_closed(folder):
    pytest.importorskip("cascadio", reason="an extra: pip install 'weldcell[step]'")
    written(folder, "box.step", step_box((200, 100, 20)))
    part = read_part(written(folder, "part.yaml", "file: box.step\n"))
    assert part.remarks == () and part.workpiece.closed
    assert np.ptp(part.workpiece.vertices_part, axis=0) == pytest.approx(
        [0.2, 0.1, 0.02], abs=1e-7
    )  # m, single precision
    refused_mesh(folder, "cut.step", step_box((200, 100, 20)).replace("PLANE", "PLAIN"), "cut.step")


def test_step_says_which_package_it_needs(folder, monkeypatch):
    refused_mesh(folder, "a.step", "solid", "STEP header")
    refused_mesh(folder, "b.step", "ISO-10303-21;\nHEADER;\n", "truncated")
    monkeypatch.setattr("weldcell.scenarios.user_cell.step.find_spec", lambda name: None)
    with pytest.raises(NotReady, match=r"weldcell\[step\]"):
        read_mesh(written(folder, "c.step", "ISO-10303-21;\nEND-ISO-10303-21;\n"), "c.step")

"""A user's part is read from its files; hostile ones are refused in one line, quickly, with nothing else opened."""

import contextlib
import io
import json
import struct
import sys
import time
import zipfile

import numpy as np
import pytest
import trimesh

from weldcell.cell.errors import BadInput, NotReady
from weldcell.scenarios.user_cell.mesh_file import LARGEST_FACES, read_mesh
from weldcell.scenarios.user_cell.part_file import read_part
from weldcell.scenarios.user_cell.seam_file import read_seam

LONGEST_S = 5.0
BOX = trimesh.creation.box(extents=(200, 100, 20))  # mm


@pytest.fixture
def folder(tmp_path):
    home = tmp_path / "user"
    home.mkdir()
    return home


def written(folder, name, content):
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def refused(call, *words):
    """The one line of a refusal that comes soon enough and has these words in it."""
    begun = time.monotonic()
    with pytest.raises(BadInput) as caught:
        call()
    assert time.monotonic() - begun < LONGEST_S
    line = str(caught.value)
    assert "\n" not in line and len(line) < 600
    for word in words:
        assert word in line, line
    return line


def refused_mesh(folder, name, content, *words):
    path = written(folder, name, content)
    return refused(lambda: read_mesh(path, name), name, *words)


def stl(mesh=BOX):
    return mesh.export(file_type="stl")


def glb(change=lambda tree: None, mesh=BOX):
    """A GLB whose JSON has been changed."""
    content = mesh.export(file_type="glb")
    length = struct.unpack("<I", content[12:16])[0]
    tree = json.loads(content[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = content[20 + length :]
    return (
        struct.pack("<3I", 0x46546C67, 2, 20 + len(text) + len(rest))
        + struct.pack("<2I", len(text), 0x4E4F534A)
        + text
        + rest
    )


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
    ("content", "words"),
    [
        (b"", ["empty file"]),
        (stl()[:300], ["truncated", "12"]),
        (stl()[:80], ["80 bytes"]),
        (stl()[:80] + struct.pack("<I", 4_000_000_000) + stl()[84:], ["4000000000"]),
        (stl()[:80] + struct.pack("<I", 3) + stl()[84:], ["says 3"]),
        (bytes(84), ["no triangles"]),
        (b"solid nothing\nendsolid nothing\n", ["no triangles"]),
        (BOX.export(file_type="stl_ascii").encode()[:700], ["truncated"]),
        (BOX.export(file_type="stl_ascii").replace("vertex", "vertx", 1).encode(), ["35 corners for 12"]),
        (BOX.export(file_type="stl_ascii").replace("-100.0", "1e999").encode(), ["NaN or infinite"]),
        (BOX.export(file_type="stl_ascii").replace("-100.0", "abc").encode(), ["STL"]),
        (bytes(range(256)) * 40, ["triangles where the header says"]),
    ],
)
def test_a_broken_stl_is_refused_with_the_reason(folder, content, words):
    refused_mesh(folder, "a.stl", content, *words)


def test_more_triangles_than_the_limit_are_refused_before_they_are_parsed(folder):
    count = LARGEST_FACES + 1
    refused_mesh(
        folder, "a.stl", bytes(80) + struct.pack("<I", count) + bytes(50 * count), str(count), str(LARGEST_FACES)
    )
    facet = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    refused_mesh(folder, "b.stl", b"solid\n" + facet * count + b"endsolid\n", str(count))
    refused_mesh(folder, "a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * count, str(count))
    path = written(folder, "small.stl", stl())
    refused(lambda: read_mesh(path, "small.stl", most_faces=11), "12 triangles", "at most 11")


def test_a_file_larger_than_the_limit_is_refused_unread(folder):
    path = folder / "sparse.stl"
    with path.open("wb") as file:
        file.truncate(10**12)  # a hole: takes no place on the disk
    refused(lambda: read_mesh(path, "sparse.stl"), "1000000000000 bytes")


PLY = "ply\nformat ascii 1.0\n{}end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
VERTICES = "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face {}\nproperty list uchar int vertex_indices\n"


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (VERTICES.format(3) + FACES.format(4_000_000_000), ["4000000000"]),
        (VERTICES.format(10**18) + FACES.format(1), [str(10**18)]),
        (VERTICES.format(-3) + FACES.format(1), ["element vertex -3"]),
        (VERTICES.format(3) + FACES.format(50), ["ply"]),
        (VERTICES.format(3), ["ply"]),
        ("property float x\n" + VERTICES.format(3), ["ply"]),
        ("", ["ply"]),
        (VERTICES.format(3) + "".join(f"property float q{k}\n" for k in range(200)) + FACES.format(1), ["properties"]),
    ],
)
def test_a_lying_ply_header_is_refused(folder, header, words):
    refused_mesh(folder, "a.ply", PLY.format(header), *words)


def test_a_truncated_binary_ply_is_refused(folder):
    refused_mesh(folder, "a.ply", BOX.export(file_type="ply")[:-30], "a.ply")


def test_corners_that_do_not_exist_are_refused(folder):
    refused_mesh(folder, "a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "a.obj")
    refused_mesh(
        folder, "a.ply", PLY.format(VERTICES.format(3) + FACES.format(1)).replace("3 0 1 2", "3 0 1 99"), "a.ply"
    )
    refused_mesh(folder, "b.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "NaN")


def loop(tree):
    tree["nodes"] = [{"children": [1]}, {"children": [0], "mesh": 0}]


def multiply(tree):
    tree["nodes"] = [{"children": [k + 1, k + 1]} for k in range(40)] + [{"mesh": 0}]


def instances(tree):
    tree["nodes"] = [{"mesh": 0}] * 10_000 + [{"mesh": 0}]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: t["buffers"][0].update(uri="../../etc/passwd"), ["another file"]),
        (lambda t: t["buffers"][0].update(uri="file:///etc/passwd"), ["another file"]),
        (lambda t: t["buffers"][0].update(byteLength=10**15), ["more data"]),
        (lambda t: t["accessors"][0].update(count=10**15), [str(10**15)]),
        (lambda t: t["accessors"][0].update(count=-5), ["accessors"]),
        (lambda t: t["accessors"][0].pop("bufferView"), ["accessors"]),
        (lambda t: t["accessors"][0].update(sparse={"count": 10**9}), ["sparse"]),
        (lambda t: t["bufferViews"][0].update(byteLength=10**12), ["bufferViews"]),
        (lambda t: t.update(extensionsRequired=["KHR_draco_mesh_compression"]), ["draco"]),
        (loop, ["ring"]),
        (multiply, ["two parents"]),
        (instances, ["10001"]),
        (lambda t: t["nodes"][0].update(children=[77]), ["77"]),
        (lambda t: t["meshes"][0]["primitives"][0].update(indices=99), ["99"]),
        (lambda t: t.update(meshes="none"), ["meshes"]),
        (lambda t: t.update(meshes=[]), ["meshes"]),
        (lambda t: t["meshes"][0]["primitives"][0].update(attributes={}), ["glb"]),
    ],
)
def test_a_hostile_glb_is_refused(folder, change, words):
    refused_mesh(folder, "a.glb", glb(change), *words)


def test_pictures_in_a_glb_are_not_looked_at(folder):
    def bomb(tree):
        tree["images"] = [{"uri": "../../etc/passwd"}]
        tree["textures"] = [{"source": 0}]
        tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        tree["meshes"][0]["primitives"][0]["material"] = 0

    assert len(read_mesh(written(folder, "a.glb", glb(bomb)), "a.glb").faces) == 12


def test_a_truncated_glb_is_refused(folder):
    refused_mesh(folder, "a.glb", glb()[:-40], "truncated")
    refused_mesh(folder, "b.glb", b"glTF", "4 bytes")
    refused_mesh(folder, "c.glb", glb()[:12] + b"\xff" * 8 + glb()[20:], "glb")


def archive():
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        file.writestr("a.stl", stl())
    return buffer.getvalue()


@pytest.mark.parametrize(
    "name", ["model.mjb", "pickled.npz", "pickled.npy", "part.3mf", "part.zip", "part.gltf", "part", "part.dae"]
)
def test_other_kinds_of_files_are_refused_unopened(folder, name):
    refused(lambda: read_mesh(folder / name, name), "expected a mesh")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (archive(), "zip"),
        (b"\x1f\x8b" + bytes(100), "gzip"),
        (b"\x80\x04\x95" + bytes(100), "pickle"),
        (bytes(257) + b"ustar" + bytes(600), "tar"),
    ],
)
def test_archives_and_pickles_called_otherwise_are_refused(folder, content, words):
    for name in ("a.stl", "a.obj", "a.ply", "a.glb", "a.step"):
        refused_mesh(folder, name, content, words)


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


@pytest.mark.parametrize("kind", ["stl", "ply", "obj", "glb"])
def test_no_flipped_or_missing_byte_brings_more_than_a_refusal(folder, kind):
    """Damaged files either give a mesh or are refused: nothing else is raised."""
    rng = np.random.default_rng(3)
    whole = BOX.export(file_type=kind)
    whole = whole.encode() if isinstance(whole, str) else whole
    for trial in range(150):
        content = bytearray(whole)
        for place in rng.integers(0, len(content), 1 + trial % 4):
            content[place] = rng.integers(256)
        if trial % 3 == 0:
            del content[int(rng.integers(len(content))) :]
        path = written(folder, f"a.{kind}", bytes(content))
        with contextlib.suppress(BadInput):
            mesh = read_mesh(path, path.name)
            assert np.all(np.isfinite(mesh.vertices)) and mesh.faces.max() < len(mesh.vertices)

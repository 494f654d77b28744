"""Meshes that are broken, lie or are something else are refused in one line, quickly, unopened where that can be."""

import contextlib
import io
import struct
import zipfile

import numpy as np
import pytest

from scenarios.user_cell.user_files import BOX, glb, refused, refused_mesh, stl, written
from weldcell.cell.errors import BadInput
from weldcell.scenarios.user_cell.mesh_file import LARGEST_FACES, read_mesh


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

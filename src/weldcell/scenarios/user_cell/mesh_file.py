"""Meshes from the user's files: STL, OBJ, PLY, GLB and (as an extra) STEP, bounded before they are parsed."""

import io
import re
from pathlib import Path

import numpy as np
import trimesh
from trimesh.exchange import ply

from weldcell.cell.errors import BadInput, WeldcellError
from weldcell.models.own_part import DrawnMesh
from weldcell.scenarios.user_cell.glb import plain_glb
from weldcell.scenarios.user_cell.jail import bounded_bytes
from weldcell.scenarios.user_cell.step import glb_of_step

LARGEST_FACES = 500_000
"""Triangles; the simulated world takes about 5 s to build with so many."""
LARGEST_BYTES = 150_000_000
"""A text STL of that many triangles."""

_STL_HEADER, _STL_TRIANGLE = 84, 50
_VERTEX = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
_HINTS = {
    ".mjb": "MuJoCo's binary models are not read, as a crafted one can crash it; export a mesh",
    ".npz": "pickled data are not read; export a mesh",
    ".npy": "pickled data are not read; export a mesh",
    ".3mf": "3MF is a zip archive; export as STL",
    ".gltf": "glTF with separate files is not read; export as .glb",
    ".iges": "export as STEP",
    ".igs": "export as STEP",
    ".dae": "Collada is not read; export as STL, OBJ or GLB",
}
_EXPECTED = "a mesh (.stl .obj .ply .glb) or a solid (.step .stp)"


def read_mesh(path: Path, where: str, most_faces: int = LARGEST_FACES) -> DrawnMesh:
    """The mesh of a file, as it stands there; `where` names the file and the field in messages."""
    kind = path.suffix.lower()
    if kind not in _READERS:
        hint = f" ({_HINTS[kind]})" if kind in _HINTS else ""
        raise BadInput(f"{where}: found a file of kind {kind or 'unknown'!r}, expected {_EXPECTED}{hint}")
    content = bounded_bytes(path, LARGEST_BYTES, where)
    if not content:
        raise BadInput(f"{where}: found an empty file, expected {_EXPECTED}")
    try:
        mesh = _READERS[kind](content, where, most_faces)
    except WeldcellError:
        raise
    except Exception as error:  # the parsers of trimesh raise whatever a broken file leads them to
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise BadInput(f"{where}: cannot be read as {kind[1:].upper()}: {reason}") from error
    return _checked(mesh, where, most_faces)


def _checked(mesh: DrawnMesh, where: str, most_faces: int) -> DrawnMesh:
    if not len(mesh.faces):
        raise BadInput(f"{where}: found no triangles, expected a surface")
    _refuse_many(len(mesh.faces), where, most_faces)
    if not np.all(np.isfinite(mesh.vertices)):
        raise BadInput(f"{where}: found NaN or infinite coordinates, expected finite numbers")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise BadInput(f"{where}: found a triangle with a corner that the file does not have")
    return mesh


def _refuse_many(faces: int, where: str, most_faces: int) -> None:
    if faces > most_faces:
        raise BadInput(
            f"{where}: found {faces} triangles, expected at most {most_faces} (coarsen the mesh, or cut out the part "
            "around the seam)"
        )


def _stl(content: bytes, where: str, most_faces: int) -> DrawnMesh:
    """Binary if its length says so, else text; a file of neither kind is told what is wrong with it."""
    count = int.from_bytes(content[80:84], "little") if len(content) >= _STL_HEADER else 0
    expected = _STL_HEADER + _STL_TRIANGLE * count
    text = content.lstrip()[:5].lower() == b"solid" and b"facet" in content[:2000].lower()
    if len(content) == expected and count:
        _refuse_many(count, where, most_faces)
        mesh = trimesh.exchange.stl.load_stl_binary(io.BytesIO(content))
        return DrawnMesh(vertices=mesh["vertices"].astype(float), faces=mesh["faces"])
    if text:
        return _text_stl(content.lower(), where, most_faces)
    if len(content) == expected or content.lstrip()[:5].lower() == b"solid":
        raise BadInput(f"{where}: found no triangles, expected a surface")
    if len(content) < _STL_HEADER:
        raise BadInput(f"{where}: found {len(content)} bytes, expected an STL file (84 bytes and 50 a triangle)")
    held = (len(content) - _STL_HEADER) / _STL_TRIANGLE
    raise BadInput(
        f"{where}: found {held:.10g} triangles where the header says {count} "
        f"({'truncated' if held < count else 'a wrong count or a damaged header'}), expected as many as it says"
    )


def _text_stl(content: bytes, where: str, most_faces: int) -> DrawnMesh:
    count = content.count(b"endfacet")
    _refuse_many(count, where, most_faces)
    corners = _VERTEX.findall(content)
    begun = len(re.findall(rb"\bfacet\b", content))
    if not content.rstrip().rpartition(b"\n")[2].strip().startswith(b"endsolid") or begun != count:
        raise BadInput(f"{where}: found {count} whole triangles of {begun} and no end (truncated), expected endsolid")
    if len(corners) != 3 * count:
        raise BadInput(f"{where}: found {len(corners)} corners for {count} triangles, expected three a triangle")
    return DrawnMesh(
        vertices=np.array(corners).reshape(-1, 3).astype(float), faces=np.arange(len(corners)).reshape(-1, 3)
    )


def _obj(content: bytes, where: str, most_faces: int) -> DrawnMesh:
    polygons = re.findall(rb"^[ \t]*f[ \t][^\n]*", content, re.MULTILINE)
    _refuse_many(sum(max(len(polygon.split()) - 3, 0) for polygon in polygons), where, most_faces)
    return _by_trimesh(content, "obj")


def _ply(content: bytes, where: str, most_faces: int) -> DrawnMesh:
    """Counts in the header are checked before trimesh makes room for what they claim."""
    header, end, _ = content[:20_000].partition(b"end_header")
    if not header.startswith(b"ply") or not end:
        raise BadInput(f"{where}: found no PLY header, expected ply .. end_header")
    for line in header.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words[:1] != ["element"]:
            continue
        if len(words) != 3 or not words[2].isdecimal():
            raise BadInput(f"{where}: found the header line {line[:60]!r}, expected element NAME COUNT")
        if int(words[2]) > len(content):  # each takes a byte or more
            raise BadInput(f"{where}: header says {words[2]} of {words[1][:40]!r}, the file has {len(content)} bytes")
        if words[1] == "face":
            _refuse_many(int(words[2]), where, most_faces)
    elements, _, _ = ply._parse_header(io.BytesIO(content))
    if sum(len(element["properties"]) for element in elements.values()) > 100:
        raise BadInput(f"{where}: found more than 100 properties in the header, expected x, y, z and a list of corners")
    mesh = _by_trimesh(content, "ply")
    told = elements.get("face", {"length": 0})["length"]
    if len(mesh.faces) < told:
        raise BadInput(f"{where}: found {len(mesh.faces)} triangles where the header says {told} (truncated?)")
    return mesh


def _glb(content: bytes, where: str, most_faces: int) -> DrawnMesh:
    mesh = _by_trimesh(plain_glb(content, where, most_faces), "glb")
    return DrawnMesh(vertices=mesh.vertices, faces=mesh.faces, unit="m", up="y")


def _step(content: bytes, where: str, most_faces: int) -> DrawnMesh:
    mesh = _by_trimesh(plain_glb(glb_of_step(content, where), where, most_faces), "glb")
    return DrawnMesh(vertices=mesh.vertices, faces=mesh.faces, unit="m", up="z")


def _by_trimesh(content: bytes, kind: str) -> DrawnMesh:
    """The content as trimesh reads it, from memory: without a resolver it opens no other file."""
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, process=False, skip_materials=True)
    mesh = scene.to_mesh()
    return DrawnMesh(vertices=np.array(mesh.vertices, float), faces=np.array(mesh.faces, np.int64))


_READERS = {".stl": _stl, ".obj": _obj, ".ply": _ply, ".glb": _glb, ".step": _step, ".stp": _step}

"""Files as users bring them, and the one line in which a hostile one is refused."""

import json
import struct
import time

import pytest
import trimesh

from weldcell.cell.errors import BadInput
from weldcell.scenarios.user_cell.mesh_file import read_mesh

LONGEST_S = 5.0


BOX = trimesh.creation.box(extents=(200, 100, 20))  # mm


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

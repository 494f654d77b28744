"""GLB files stripped to plain geometry before a library reads them.

Pictures, other files, compressed meshes, instances that multiply and buffers that claim more than the file holds are
refused or left out here; what remains are nodes, meshes and accessors within the binary chunk.
"""

import json
import struct
from collections.abc import Sequence
from typing import Any

from weldcell.cell.errors import BadInput

_MAGIC, _JSON, _BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
_MOST_NODES, _MOST_JSON_BYTES, _MOST_DEPTH = 10_000, 20_000_000, 200
_KEPT = ("asset", "scene", "scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers")


def plain_glb(content: bytes, where: str, most_faces: int) -> bytes:
    """The file's geometry alone as GLB; refused if it is damaged, refers to other files, or holds too much."""
    text, binary = _chunks(content, where)
    try:
        whole = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{where}: found a JSON chunk that is none ({str(error)[:80]}), expected glTF 2.0") from None
    if not isinstance(whole, dict):
        raise BadInput(f"{where}: found no glTF in its JSON chunk, expected glTF 2.0")
    if required := whole.get("extensionsRequired"):
        raise BadInput(f"{where}: needs {str(required)[:80]}, expected plain glTF 2.0 (export without compression)")
    kept: dict[str, Any] = {key: whole[key] for key in _KEPT if key in whole}
    for key in _KEPT[2:]:
        _check_list(kept, key, where)
    _check_buffers(kept, len(binary), where)
    for mesh in kept.get("meshes", []):
        for primitive in _list(mesh, "primitives"):
            for extra in ("material", "extensions", "targets"):
                primitive.pop(extra, None)
            primitive["attributes"] = {"POSITION": _dict(primitive, "attributes").get("POSITION")}
    _refuse_many(kept, where, most_faces)
    return _packed(kept, binary)


def _chunks(content: bytes, where: str) -> tuple[bytes, bytes]:
    if len(content) < 20:
        raise BadInput(f"{where}: found {len(content)} bytes, expected a GLB file")
    magic, version, length, json_length, json_kind = struct.unpack("<5I", content[:20])
    if magic != _MAGIC or json_kind != _JSON:
        raise BadInput(f"{where}: found no GLB header, expected glTF 2.0 binary")
    if version != 2:
        raise BadInput(f"{where}: found glTF version {version}, expected 2")
    if length != len(content) or 20 + json_length > len(content) or json_length > _MOST_JSON_BYTES:
        raise BadInput(f"{where}: found {len(content)} bytes where its header says {length} (truncated?)")
    rest = content[20 + json_length :]
    if not rest:
        return content[20 : 20 + json_length], b""
    binary_length, kind = struct.unpack("<2I", rest[:8]) if len(rest) >= 8 else (0, 0)
    if kind != _BINARY or 8 + binary_length > len(rest):
        raise BadInput(f"{where}: found a damaged binary chunk (truncated?), expected glTF 2.0 binary")
    return content[20 : 20 + json_length], rest[8 : 8 + binary_length]


def _check_list(kept: dict[str, Any], key: str, where: str) -> None:
    entries = kept.get(key, [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise BadInput(f"{where}: {key}: expected a list of mappings")
    if len(entries) > _MOST_NODES:
        raise BadInput(f"{where}: {key}: found {len(entries)}, expected at most {_MOST_NODES}")


def _check_buffers(kept: dict[str, Any], held: int, where: str) -> None:
    buffers = kept.get("buffers", [])
    if any("uri" in buffer for buffer in buffers):
        raise BadInput(f"{where}: buffers: found a reference to another file, expected all data in the GLB")
    if len(buffers) > 1 or any(_number(buffer, "byteLength") > held for buffer in buffers):
        raise BadInput(f"{where}: buffers: found more data announced than the file's {held} bytes")
    for view in kept.get("bufferViews", []):
        if _number(view, "byteOffset") + _number(view, "byteLength") > held:
            raise BadInput(f"{where}: bufferViews: found one that reaches past the end of the file")
    for accessor in kept.get("accessors", []):
        if "sparse" in accessor:
            raise BadInput(f"{where}: accessors: found a sparse one, expected plain ones")
        if _number(accessor, "count") > held or "bufferView" not in accessor:
            raise BadInput(f"{where}: accessors: found {_number(accessor, 'count')} entries, the file has {held} bytes")


def _refuse_many(kept: dict[str, Any], where: str, most_faces: int) -> None:
    """Counts triangles over all instances, on the way refusing nodes that are no tree."""
    nodes, meshes = kept.get("nodes", []), kept.get("meshes", [])
    parents = [0] * len(nodes)
    total = 0
    for node in nodes:
        for child in _list(node, "children"):
            if not isinstance(child, int) or not 0 <= child < len(nodes):
                raise BadInput(f"{where}: nodes: found the child {str(child)[:40]}, there are {len(nodes)} nodes")
            parents[child] += 1
        if "mesh" in node:
            total += _triangles(kept, _entry(meshes, node["mesh"], where, "meshes"), where)
    if any(count > 1 for count in parents) or _depth(nodes, parents) > _MOST_DEPTH:
        raise BadInput(f"{where}: nodes: found one with two parents, a ring, or too deep a tree, expected a tree")
    if total > most_faces:
        raise BadInput(f"{where}: found {total} triangles, expected at most {most_faces} (coarsen the mesh)")


def _triangles(kept: dict[str, Any], mesh: dict[str, Any], where: str) -> int:
    total = 0
    for primitive in _list(mesh, "primitives"):
        accessor = primitive.get("indices", primitive["attributes"]["POSITION"])
        count = _number(_entry(kept.get("accessors", []), accessor, where, "accessors"), "count")
        total += count // 3 if primitive.get("mode", 4) == 4 else count
    return total


def _depth(nodes: Sequence[dict[str, Any]], parents: Sequence[int]) -> int:
    """Levels of the tree; more than there may be if nodes form a ring (which no root leads to)."""
    level = [k for k, count in enumerate(parents) if count == 0]
    depth, seen = 0, len(level)
    while level and depth <= _MOST_DEPTH:
        level = [child for k in level for child in _list(nodes[k], "children")]
        depth, seen = depth + 1, seen + len(level)
    return depth if seen == len(nodes) else _MOST_DEPTH + 1


def _entry(entries: Sequence[dict[str, Any]], index: object, where: str, name: str) -> dict[str, Any]:
    if not isinstance(index, int) or not 0 <= index < len(entries):
        raise BadInput(f"{where}: {name}: found no entry {str(index)[:40]!r}, there are {len(entries)}")
    return entries[index]


def _number(entry: dict[str, Any], key: str) -> int:
    value = entry.get(key, 0)
    return value if isinstance(value, int) and value >= 0 else 2**62


def _list(entry: dict[str, Any], key: str) -> list[Any]:
    value = entry.get(key, [])
    return value if isinstance(value, list) else []


def _dict(entry: dict[str, Any], key: str) -> dict[str, Any]:
    value = entry.get(key, {})
    return value if isinstance(value, dict) else {}


def _packed(kept: dict[str, Any], binary: bytes) -> bytes:
    text = json.dumps(kept).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<2I", len(text), _JSON) + text + struct.pack("<2I", len(binary), _BINARY) + binary
    return struct.pack("<3I", _MAGIC, 2, 12 + len(body)) + body

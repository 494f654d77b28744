"""MJCF and URDF from outside made safe: parsed here, cut down to a plain kinematic tree, its meshes read here too.

MuJoCo gets a text that this module wrote and meshes from memory: whatever it opens, includes, replicates or generates
by itself is refused or left out before. No document type, so no entities.
"""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
import trimesh

from weldcell.cell.errors import BadInput
from weldcell.scenarios.user_cell.jail import bounded_bytes, named_file, shown
from weldcell.scenarios.user_cell.mesh_file import read_mesh

_MOST_BYTES, _MOST_ELEMENTS, _MOST_DEPTH = 2_000_000, 5_000, 60
_MOST_MESHES, _MOST_FACES, _MOST_BODIES, _MOST_GEOMS = 200, 200_000, 200, 2_000
_LARGEST, _FARTHEST_M = 1e6, 100.0
_LENGTHS = frozenset({"pos", "size", "fromto", "xyz", "radius", "length", "vertex", "mesh_pos", "anchor"})
_WORDS = frozenset(
    {"name", "class", "childclass", "mesh", "material", "file", "filename", "link", "joint", "model", "type", "body"}
)
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_LIKE_NUMBER = re.compile(r"[+-]?(\d|\.|inf|nan)", re.IGNORECASE)

# What of MJCF is kept; what is dropped moves nothing. All else is refused by its name.
_TREE = frozenset({"body", "frame", "joint", "geom", "site", "inertial"})
_MJCF_KEPT: Mapping[str, frozenset[str]] = {
    "mujoco": frozenset({"compiler", "default", "asset", "worldbody"}),
    "default": frozenset({"default", "joint", "geom", "site", "mesh", "material"}),
    "asset": frozenset({"mesh", "material"}),
    "worldbody": _TREE,
    "body": _TREE,
    "frame": _TREE,
}
_MJCF_DROPPED = frozenset(
    {"option", "size", "visual", "statistic", "contact", "sensor", "actuator", "keyframe", "custom", "tendon"}
    | {"camera", "light", "texture", "layer", "pair", "lengthrange"}
    | {"general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion"}
)
_URDF_KEPT: Mapping[str, frozenset[str]] = {
    "robot": frozenset({"link", "joint", "material"}),
    "link": frozenset({"inertial", "visual", "collision"}),
    "joint": frozenset({"origin", "parent", "child", "axis", "limit"}),
    "inertial": frozenset({"origin", "mass", "inertia"}),
    "visual": frozenset({"origin", "geometry", "material"}),
    "collision": frozenset({"origin", "geometry"}),
    "geometry": frozenset({"box", "cylinder", "sphere", "capsule", "mesh"}),
    "material": frozenset({"color"}),
}
_URDF_DROPPED = frozenset(
    {"transmission", "gazebo", "ros2_control", "mujoco", "dynamics", "safety_controller", "calibration", "verbose"}
    | {"contact_coefficients", "contact", "sensor", "texture", "group_state", "disable_collisions"}
)
_REASONS = {
    "include": "other files are not included: put the whole arm into one file",
    "replicate": "copies are not made: write them out",
    "equality": "closed chains and coupled joints are not known: give the arm as a plain chain",
    "hfield": "height fields are no part of an arm",
    "mimic": "coupled joints are not known: give the arm as a plain chain",
    "freejoint": "the arm stands fixed on its base",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class PlainModel:
    """A checked model as MuJoCo may read it."""

    text: str
    """MJCF or URDF, written anew."""
    meshes: Mapping[str, bytes]
    """Content of each mesh by its name in the text."""
    urdf: bool
    speeds_rad_s: Mapping[str, float]
    """Largest speed of joints, where the file says (URDF does)."""
    remarks: tuple[str, ...]
    """What was left out that one might miss."""


def plain_model(path: Path, folder: Path, where: str) -> PlainModel:
    """The model of a file, its meshes in `folder` or below; refused if it is hostile, too large or no MJCF or URDF."""
    root = _parsed(bounded_bytes(path, _MOST_BYTES, where), where)
    if root.tag not in ("mujoco", "robot"):
        raise BadInput(f"{where}: found the element {_tag(root)}, expected mujoco (MJCF) or robot (URDF)")
    urdf = root.tag == "robot"
    speeds = {}
    if urdf:
        for joint in root.iter("joint"):
            limit = joint.find("limit")
            if limit is not None and "velocity" in limit.attrib:
                _check_numbers(limit, where)
                speeds[joint.get("name", "")] = float(limit.get("velocity", "0"))
    _prune(root, _URDF_KEPT if urdf else _MJCF_KEPT, _URDF_DROPPED if urdf else _MJCF_DROPPED, where)
    for element in root.iter():
        _check_numbers(element, where)
    if (count := sum(1 for _ in root.iter("link" if urdf else "body"))) > _MOST_BODIES:
        raise BadInput(f"{where}: found {count} bodies, expected at most {_MOST_BODIES}")
    if (count := sum(1 for e in root.iter() if e.tag in ("geom", "visual", "collision"))) > _MOST_GEOMS:
        raise BadInput(f"{where}: found {count} geoms, expected at most {_MOST_GEOMS}")
    meshes, remarks = (_urdf_meshes if urdf else _mjcf_meshes)(root, folder, where)
    _set_compiler(root, urdf)
    return PlainModel(
        text=ET.tostring(root, encoding="unicode"),
        meshes=meshes,
        urdf=urdf,
        speeds_rad_s=speeds,
        remarks=tuple(remarks),
    )


def _parsed(content: bytes, where: str) -> ET.Element:
    """The root of the tree; refused with a document type, so that no entity is ever expanded."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BadInput(f"{where}: found bytes that are not UTF-8 text, expected MJCF or URDF") from None
    if not text.strip():
        raise BadInput(f"{where}: found an empty file, expected MJCF or URDF")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput(f"{where}: found a document type or entities, expected plain MJCF or URDF")
    if text.count("<") > 3 * _MOST_ELEMENTS:
        raise BadInput(f"{where}: found more than {_MOST_ELEMENTS} elements, expected an arm")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as error:
        raise BadInput(f"{where}: not XML: {error}") from None
    level, depth = [root], 0
    while level:
        level = [child for element in level for child in element]
        depth += 1
        if depth > _MOST_DEPTH:
            raise BadInput(f"{where}: found more than {_MOST_DEPTH} levels of elements, expected an arm")
    return root


def _prune(element: ET.Element, kept: Mapping[str, frozenset[str]], dropped: frozenset[str], where: str) -> None:
    for child in list(element):
        if child.tag in kept.get(element.tag, frozenset()):
            _prune(child, kept, dropped, where)
        elif child.tag in dropped:
            element.remove(child)
        else:
            hint = _REASONS.get(child.tag, "not known in an arm")
            if "}" in child.tag:
                hint = "run xacro on it first" if "xacro" in child.tag else "not known in an arm"
            raise BadInput(f"{where}: {element.tag}: found the element {_tag(child)}, which is refused: {hint}")


def _tag(element: ET.Element) -> str:
    return f"<{shown(element.tag.rpartition('}')[2])[:40]}>"


def _check_numbers(element: ET.Element, where: str) -> None:
    """Refuses numbers that are none, and places that are in no cell."""
    for name, value in element.attrib.items():
        if name in _WORDS:
            continue
        most = _FARTHEST_M if name in _LENGTHS else _LARGEST
        for token in value.split():
            if not _LIKE_NUMBER.match(token):
                continue
            if not _NUMBER.fullmatch(token) or not abs(float(token)) <= most or not math.isfinite(float(token)):
                raise BadInput(
                    f"{where}: {_tag(element)} {shown(element.get('name', ''))}: {shown(name)}: found "
                    f"{shown(token)[:40]}, expected a finite number of at most {most:g}"
                )


def _mjcf_meshes(root: ET.Element, folder: Path, where: str) -> tuple[dict[str, bytes], list[str]]:
    """Reads the meshes and points the text to what was read."""
    prefix = PurePosixPath()
    for compiler in root.findall("compiler"):
        prefix = PurePosixPath(compiler.get("meshdir", compiler.get("assetdir", str(prefix))))
    meshes: dict[str, bytes] = {}
    for mesh in root.iter("mesh"):
        mesh.attrib.pop("content_type", None)
        if "builtin" in mesh.attrib or "params" in mesh.attrib:
            raise BadInput(f"{where}: <mesh> {shown(mesh.get('name', ''))}: builtin: generated meshes are refused")
        if (name := mesh.get("file")) is None:
            continue
        mesh.set("name", mesh.get("name", PurePosixPath(name).stem))
        mesh.set(
            "file", _add_mesh(meshes, folder, str(prefix / name), f"{where}: <mesh> {shown(mesh.get('name'))}: file")
        )
    for geom in root.iter("geom"):
        if geom.get("type") in ("hfield", "sdf") or "hfield" in geom.attrib:
            raise BadInput(f"{where}: <geom> {shown(geom.get('name', ''))}: type: found a height or distance field")
    for material in root.iter("material"):
        material.attrib.pop("texture", None)
    for body in root.iter("body"):
        body.attrib.pop("mocap", None)
    for joint in root.iter("joint"):  # not taken over; without it a light link makes MuJoCo warn, into a file
        joint.set("armature", "1")
    return meshes, []


def _urdf_meshes(root: ET.Element, folder: Path, where: str) -> tuple[dict[str, bytes], list[str]]:
    """As for MJCF; a visual mesh of a kind that is not read is left out if the link has another shape."""
    meshes: dict[str, bytes] = {}
    remarks = []
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            mesh = shape.find("geometry/mesh")
            if mesh is None:
                continue
            name, field = mesh.get("filename", ""), f"{where}: <link> {shown(link.get('name', ''))}: filename"
            if PurePosixPath(name).suffix.lower() == ".dae" and shape.tag == "visual" and link.find("collision"):
                link.remove(shape)
                remarks.append(f"link {shown(link.get('name', ''))}: Collada is not read, its collision shape is shown")
                continue
            mesh.set("filename", _add_mesh(meshes, folder, _without_package(folder, name), field))
    return meshes, remarks


def _without_package(folder: Path, name: str) -> str:
    """A name without `package://`: below the folder with the package's name, if there is one, else below the folder."""
    if not name.startswith("package://"):
        return name
    rest = name.removeprefix("package://")
    package, _, inner = rest.partition("/")
    return rest if package not in ("", ".", "..") and (folder / package).is_dir() else inner


def _add_mesh(meshes: dict[str, bytes], folder: Path, name: str, where: str) -> str:
    """Reads one mesh within its bounds and keeps it as plain STL; returns its name in the text."""
    if len(meshes) >= _MOST_MESHES:
        raise BadInput(f"{where}: found more than {_MOST_MESHES} meshes, expected an arm")
    drawn = read_mesh(named_file(folder, name, where), f"{where}: {shown(name)}", _MOST_FACES)
    if np.abs(drawn.vertices).max() > _LARGEST:
        raise BadInput(f"{where}: {shown(name)}: found a coordinate beyond {_LARGEST:g}, expected an arm's size")
    if sum(map(len, meshes.values())) + 50 * len(drawn.faces) > 50 * 500_000:
        raise BadInput(f"{where}: found more than 500000 triangles in all meshes, expected fewer")
    key = f"mesh_{len(meshes) + 1}.stl"
    mesh = trimesh.Trimesh(drawn.vertices, drawn.faces, process=False)
    meshes[key] = mesh.export(file_type="stl")
    return key


def _set_compiler(root: ET.Element, urdf: bool) -> None:
    """Settings that keep bodies apart and shapes as they are; folders are not MuJoCo's business any more."""
    fixed = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
    bounds = {"boundmass": "0.001", "boundinertia": "1e-6", "balanceinertia": "true"}
    if urdf:
        extension = ET.SubElement(root, "mujoco")
        ET.SubElement(extension, "compiler", fixed | bounds)
        return
    compilers = root.findall("compiler") or [ET.SubElement(root, "compiler")]
    for compiler in compilers:
        for folder in ("meshdir", "assetdir", "texturedir"):
            compiler.attrib.pop(folder, None)
        compiler.attrib.update(fixed)
        for name, value in bounds.items():
            compiler.attrib.setdefault(name, value)

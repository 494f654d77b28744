"""Triangle meshes of everything in a compiled MuJoCo model, ready to be drawn."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8

_CREASE_RAD = np.deg2rad(30.0)  # edges sharper than this are drawn as edges
_DEFAULT_RGBA = np.array([0.5, 0.5, 0.5, 1.0])  # MuJoCo's, of a geom without a colour of its own
_ENDLESS_PLANE_M = 2.0  # half side drawn for a plane that MuJoCo holds to be endless


@dataclass(frozen=True, kw_only=True)
class DrawnGeom:
    """One geom as a mesh in its body's frame."""

    body: int
    """Id of the body that carries it."""
    name: str
    """Unique within its body."""
    points_body: Float[np.ndarray, "v 3"]
    """Vertices, m."""
    normals_body: Float[np.ndarray, "v 3"]
    """Unit normals; vertices are doubled along sharp edges."""
    faces: Int[np.ndarray, "f 3"]
    rgba: UInt8[np.ndarray, "4"]


def drawn_geoms(model: mujoco.MjModel) -> Iterator[DrawnGeom]:
    """Meshes of all visible geoms that have a surface (height fields are left out)."""
    for geom in range(model.ngeom):
        rgba = _rgba(model, geom)
        mesh = _mesh(model, geom) if rgba[3] > 0 else None
        if mesh is None:
            continue
        shaded = trimesh.graph.smooth_shade(mesh, angle=_CREASE_RAD)
        rotation = _matrix(model.geom_quat[geom])
        yield DrawnGeom(
            body=int(model.geom_bodyid[geom]),
            name=entity_name(model.geom(geom).name) or f"geom_{geom}",
            points_body=shaded.vertices @ rotation.T + model.geom_pos[geom],
            normals_body=shaded.vertex_normals @ rotation.T,
            faces=np.asarray(shaded.faces),
            rgba=rgba,
        )


def carriers(model: mujoco.MjModel) -> Int[np.ndarray, "nbody"]:
    """For each body the one that it is rigidly fixed to and that can move; 0 (the world) if it stands still."""
    carrier = np.array(model.body_weldid)
    for body in range(1, model.nbody):
        if model.body_mocapid[body] >= 0:  # MuJoCo welds a mocap body to the world, yet it is moved by hand
            carrier[body] = body
        elif carrier[body] == 0:
            carrier[body] = carrier[model.body_parentid[body]]
    return carrier


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body as one part of an entity path."""
    return entity_name(model.body(body).name) or f"body_{body}"


def entity_name(name: str) -> str:
    """The name as one part of an entity path: MuJoCo's attached models have slashes in theirs (`arm/link_1`)."""
    return re.sub(r"[^0-9A-Za-z_.-]+", "_", name.strip("/ "))


def _rgba(model: mujoco.MjModel, geom: int) -> UInt8[np.ndarray, "4"]:
    """Colour of a geom: its own, or its material's where it has none.

    A picture on the material counts with its mean colour.
    """
    rgba, material = np.array(model.geom_rgba[geom]), int(model.geom_matid[geom])
    if material >= 0:
        if np.array_equal(rgba, _DEFAULT_RGBA):
            rgba = np.array(model.mat_rgba[material])
        rgba[:3] *= _mean_texture(model, material)
    return np.rint(255 * np.clip(rgba, 0, 1)).astype(np.uint8)


def _mean_texture(model: mujoco.MjModel, material: int) -> Float[np.ndarray, "3"]:
    texture = int(model.mat_texid[material][mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0 or model.tex_nchannel[texture] < 3:
        return np.ones(3)
    channels, first = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
    count = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
    return model.tex_data[first : first + count].reshape(-1, channels)[:, :3].mean(axis=0) / 255


def _mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh | None:
    """The geom in its own frame."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    match kind:
        case mujoco.mjtGeom.mjGEOM_PLANE:
            half_x, half_y = (float(side) if side > 0 else _ENDLESS_PLANE_M for side in size[:2])
            corners = [[-half_x, -half_y, 0], [half_x, -half_y, 0], [half_x, half_y, 0], [-half_x, half_y, 0]]
            return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return trimesh.creation.icosphere(subdivisions=3, radius=size[0])
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return trimesh.creation.icosphere(subdivisions=3).apply_scale(size)
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            capsule = trimesh.creation.capsule(radius=size[0], height=2 * size[1], count=[24, 24])
            return capsule.apply_translation(-capsule.bounds.mean(axis=0))
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return trimesh.creation.cylinder(radius=size[0], height=2 * size[1], sections=48)
        case mujoco.mjtGeom.mjGEOM_BOX:
            return trimesh.creation.box(extents=2 * size)
        case mujoco.mjtGeom.mjGEOM_MESH | mujoco.mjtGeom.mjGEOM_SDF:
            return _compiled_mesh(model, int(model.geom_dataid[geom]))
        case _:
            return None


def _compiled_mesh(model: mujoco.MjModel, mesh: int) -> trimesh.Trimesh:
    first_vertex, first_face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
    vertices = model.mesh_vert[first_vertex : first_vertex + model.mesh_vertnum[mesh]]
    faces = model.mesh_face[first_face : first_face + model.mesh_facenum[mesh]]
    return trimesh.Trimesh(np.array(vertices), np.array(faces), process=True)


def _matrix(quaternion: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)

"""Bodies made of coloured meshes: what every generated model adds to its MjSpec."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from manifold3d import Manifold

from weldcell.models.shapes import to_trimesh
from weldcell.models.surface_texture import SurfaceTexture

GROUP_PARTS, GROUP_ARM, GROUP_TORCH, GROUP_SENSOR = 0, 1, 2, 3
"""MuJoCo geom groups: parts and furniture are seen by the sensor; arm, torch and sensor head are not."""


@dataclass(frozen=True, kw_only=True)
class CollisionMask:
    """MuJoCo's collision bits of a geom."""

    contype: int
    """What the geom is."""
    conaffinity: int
    """What the geom collides with."""


ROBOT_MASK = CollisionMask(contype=1, conaffinity=2)
"""Arm, torch and sensor head: collide with parts, not with one another."""
PART_MASK = CollisionMask(contype=2, conaffinity=1)
"""Parts and furniture: collide with the robot, not with one another."""
NO_MASK = CollisionMask(contype=0, conaffinity=0)
"""Collides with nothing."""


@dataclass(frozen=True, kw_only=True)
class Finish:
    """How a surface looks."""

    rgba: tuple[float, float, float, float]
    """Colour and opacity, 0 to 1."""
    specular: float = 0.3
    """Strength of highlights, 0 to 1."""
    shininess: float = 0.4
    """Sharpness of highlights, 0 to 1."""


ORANGE = Finish(rgba=(0.92, 0.36, 0.05, 1.0), specular=0.45, shininess=0.6)
DARK_GREY = Finish(rgba=(0.14, 0.145, 0.155, 1.0), specular=0.25, shininess=0.3)
BLACK = Finish(rgba=(0.055, 0.055, 0.06, 1.0), specular=0.2, shininess=0.2)
LIGHT_GREY = Finish(rgba=(0.74, 0.75, 0.76, 1.0), specular=0.5, shininess=0.6)
STEEL = Finish(rgba=(0.62, 0.63, 0.65, 1.0), specular=0.7, shininess=0.7)
COPPER = Finish(rgba=(0.72, 0.42, 0.24, 1.0), specular=0.7, shininess=0.7)
BRASS = Finish(rgba=(0.73, 0.6, 0.3, 1.0), specular=0.7, shininess=0.7)
BLUE = Finish(rgba=(0.10, 0.24, 0.42, 1.0), specular=0.4, shininess=0.5)


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """One solid of one colour, in the frame of its body."""

    name: str
    """Name of its mesh and geom."""
    solid: Manifold
    """Its shape, m, body frame."""
    finish: Finish
    """Its look."""


def add_mesh_geom(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    name: str,
    vertices: Float[np.ndarray, "n 3"],
    faces: np.ndarray,
    finish: Finish,
    *,
    group: int,
    mask: CollisionMask,
    flat: bool = False,
    material: str | None = None,
    texture: SurfaceTexture | None = None,
) -> mujoco.MjsGeom:
    """The geom of a mesh given in the body's frame (m); it carries no mass. `flat` shades each triangle by itself.

    Its MuJoCo material is called `NAME/material` (by default `NAME_finish`). A texture, given in the body's frame,
    needs flat triangles; `sensor_sim.texture` reads it back from the compiled model.

    MuJoCo moves each mesh to its own centre and principal axes; the compiled `geom_pos` and `geom_quat`
    bring `mesh_vert` back to the body's frame.
    """
    mesh = spec.add_mesh(name=name)
    if flat:  # shared vertices get averaged normals, which smears light over sharp edges: none is shared then
        corners = np.asarray(vertices, float)[faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        vertices, faces = corners.reshape(-1, 3), np.arange(3 * len(faces))
        mesh.usernormal = np.repeat(normals, 3, axis=0).ravel().tolist()
        if texture is not None:
            places = texture.places_px(vertices, np.repeat(normals, 3, axis=0)) + 0.5
            mesh.usertexcoord = (places / texture.grey.shape[::-1]).ravel().tolist()
            mesh.userfacetexcoord = faces.tolist()
    mesh.uservert = np.asarray(vertices, float).ravel().tolist()
    mesh.userface = np.asarray(faces, int).ravel().tolist()
    drawn = spec.add_material(
        name=f"{name}/{material}" if material else f"{name}_finish",
        rgba=finish.rgba,
        specular=finish.specular,
        shininess=finish.shininess,
    )
    if texture is not None:
        _add_texture(spec, drawn, texture)
    return body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=drawn.name,
        rgba=finish.rgba,
        group=group,
        contype=mask.contype,
        conaffinity=mask.conaffinity,
        mass=0,
    )


def _add_texture(spec: mujoco.MjSpec, drawn: mujoco.MjsMaterial, texture: SurfaceTexture) -> None:
    """The texture as MuJoCo's, and where it lies on the part as a custom number: both named after the material."""
    rows, columns = texture.grey.shape
    picture = spec.add_texture(
        name=drawn.name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=columns, height=rows, nchannel=3
    )
    picture.data = np.repeat(texture.grey[..., None], 3, axis=2).tobytes()
    drawn.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = drawn.name
    box = [*texture.low_part, *texture.high_part, texture.texel_m]
    spec.add_numeric(name=drawn.name, data=box, size=len(box))


def add_pieces(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, pieces: Sequence[Piece], *, group: int, mask: CollisionMask = ROBOT_MASK
) -> None:
    """Adds each piece as a mesh geom without mass; MuJoCo collides with each piece's convex hull."""
    for piece in pieces:
        mesh = to_trimesh(piece.solid)
        add_mesh_geom(spec, body, piece.name, mesh.vertices, mesh.faces, piece.finish, group=group, mask=mask)


def set_inertia(body: mujoco.MjsBody, pieces: Sequence[Piece], mass_kg: float) -> None:
    """Sets mass, centre of mass and inertia of the body as if `mass_kg` filled its pieces evenly."""
    volume_m3, centre, inertia = volume_properties(pieces)
    density = mass_kg / volume_m3
    ixx, iyy, izz = np.diagonal(inertia) * density
    body.mass = mass_kg
    body.ipos = centre
    body.fullinertia = [ixx, iyy, izz, *(inertia[[0, 0, 1], [1, 2, 2]] * density)]
    body.explicitinertial = True


def volume_properties(pieces: Sequence[Piece]) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Volume (m3), centroid (m) and inertia about the centroid at density 1 (m5) of the pieces together."""
    meshes = [to_trimesh(piece.solid) for piece in pieces]
    volumes = np.array([mesh.volume for mesh in meshes])
    centres = np.array([mesh.center_mass for mesh in meshes])
    centre = volumes @ centres / volumes.sum()
    inertia = np.sum([mesh.moment_inertia for mesh in meshes], axis=0)
    for volume, offset in zip(volumes, centres - centre, strict=True):  # Huygens-Steiner
        inertia = inertia + volume * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    return float(volumes.sum()), centre, inertia

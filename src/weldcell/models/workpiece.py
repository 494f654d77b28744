"""A workpiece: its mesh together with the exact features that the mesh was made from."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam
from weldcell.models.mesh_body import GROUP_PARTS, PART_MASK, Finish, add_mesh_geom

MACHINED_STEEL = Finish(rgba=(0.56, 0.57, 0.58, 1.0), specular=0.15, shininess=0.2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Workpiece:
    """A closed mesh and its truth, all in the part frame: origin at the underside's centre, z up."""

    name: str
    """Name of its body, geom and mesh."""
    vertices_part: Float[np.ndarray, "n 3"]
    """Corners of the triangles, m."""
    faces: Int[np.ndarray, "m 3"]
    """Three vertex indices a triangle, counter-clockwise seen from outside."""
    seam_part: Seam | None = None
    """Exact lines of the seam's features, if it has a seam."""
    corners_part: Mapping[str, Float[np.ndarray, "k 3"]] = field(default_factory=dict)
    """Named exact corner points, m."""
    planes_part: Mapping[str, Float[np.ndarray, "4"]] = field(default_factory=dict)
    """Named exact faces as (nx, ny, nz, d): n.p = d (m) with n unit and outward."""

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.vertices_part)):
            raise BadGeometry(f"workpiece {self.name}: expected finite vertices, found NaN or infinity")
        if self.faces.size == 0 or self.faces.min() < 0 or self.faces.max() >= len(self.vertices_part):
            raise BadGeometry(f"workpiece {self.name}: expected face indices within the vertices")
        mesh = self.mesh_part()
        if not mesh.is_watertight or not mesh.is_winding_consistent:
            raise BadGeometry(f"workpiece {self.name}: expected a closed mesh of one orientation, found it open")
        if any(shell.volume <= 0 for shell in mesh.split(only_watertight=False)):
            raise BadGeometry(f"workpiece {self.name}: expected outward normals, found a shell turned inside out")

    def mesh_part(self) -> trimesh.Trimesh:
        """The mesh for measuring and export."""
        return trimesh.Trimesh(self.vertices_part, self.faces, process=False)

    def add_to(
        self, spec: mujoco.MjSpec, T_base_part: RigidTransform, finish: Finish = MACHINED_STEEL
    ) -> mujoco.MjsBody:
        """The body that now stands at `T_base_part` in the spec's world, its geom in group 0."""
        quaternion = T_base_part.rotation.as_quat(scalar_first=True)
        body = spec.worldbody.add_body(name=self.name, pos=T_base_part.translation, quat=quaternion)
        add_mesh_geom(
            spec,
            body,
            self.name,
            self.vertices_part,
            self.faces,
            finish,
            group=GROUP_PARTS,
            mask=PART_MASK,
            flat=True,
        )
        return body

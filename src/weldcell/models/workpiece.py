"""A workpiece: its mesh together with the exact features that the mesh was made from."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import MaterialName, TextureName
from weldcell.cell.errors import BadGeometry
from weldcell.cell.randomness import generator
from weldcell.cell.seam import Seam
from weldcell.models.finishes import FINISHES
from weldcell.models.mesh_body import GROUP_PARTS, PART_MASK, add_mesh_geom
from weldcell.models.surface_texture import SurfaceTexture, even_spots, surface_texture

MIDDLE = "middle"
"""Name of a seam's middle line."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Workpiece:
    """A mesh and its truth, all in the part frame: origin at the underside's centre, z up."""

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
    material: MaterialName = "matt-white"
    """What the surface is."""
    texture: SurfaceTexture | None = None
    """Pattern of the surface's brightness, if it has one."""
    closed: bool = True
    """Whether the mesh must be closed, as all generated ones are; a user's own part may be an open surface."""

    def __post_init__(self) -> None:
        if not np.all(np.isfinite(self.vertices_part)):
            raise BadGeometry(f"workpiece {self.name}: expected finite vertices, found NaN or infinity")
        if self.faces.size == 0 or self.faces.min() < 0 or self.faces.max() >= len(self.vertices_part):
            raise BadGeometry(f"workpiece {self.name}: expected face indices within the vertices")
        if not self.closed:
            return
        mesh = self.mesh_part()
        if not mesh.is_watertight or not mesh.is_winding_consistent:
            raise BadGeometry(f"workpiece {self.name}: expected a closed mesh of one orientation, found it open")
        if any(shell.volume <= 0 for shell in mesh.split(only_watertight=False)):
            raise BadGeometry(f"workpiece {self.name}: expected outward normals, found a shell turned inside out")

    def mesh_part(self) -> trimesh.Trimesh:
        """The mesh for measuring and export."""
        return trimesh.Trimesh(self.vertices_part, self.faces, process=False)

    def with_surface(
        self, material: MaterialName, texture: TextureName = "none", tack_spots: int = 0, seed: int = 0
    ) -> "Workpiece":
        """The same part of this material, with this pattern and with tack spots evenly along its seam."""
        if texture == "none" and tack_spots == 0:
            return replace(self, material=material, texture=None)
        root = self.middle_seam().points[MIDDLE] if tack_spots > 0 else np.empty((0, 3))
        low, high = self.vertices_part.min(axis=0), self.vertices_part.max(axis=0)
        rng = generator(seed, f"texture of {self.name}")
        pattern = surface_texture(low, high, texture, even_spots(root, tack_spots), rng)
        return replace(self, material=material, texture=pattern)

    def middle_seam(self) -> Seam:
        """The seam's one line `middle` (its root, a U's centre, or midway between its features), with its approach.

        The approach is upright where nobody knows better.
        """
        if self.seam_part is None:
            raise BadGeometry(f"workpiece {self.name}: expected a seam, found none")
        seam, points = self.seam_part, self.seam_part.points
        middle = next((points[name] for name in ("root", "centre") if name in points), None)
        upright = np.tile([0.0, 0.0, 1.0], (len(seam.arc_length_m), 1))
        return Seam(
            arc_length_m=seam.arc_length_m,
            points={MIDDLE: np.mean(list(points.values()), axis=0) if middle is None else middle},
            approach=upright if seam.approach is None else seam.approach,
        )

    def add_to(self, spec: mujoco.MjSpec, T_base_part: RigidTransform) -> mujoco.MjsBody:
        """The body that now stands at `T_base_part` in the spec's world, its geom in group 0."""
        quaternion = T_base_part.rotation.as_quat(scalar_first=True)
        body = spec.worldbody.add_body(name=self.name, pos=T_base_part.translation, quat=quaternion)
        add_mesh_geom(
            spec,
            body,
            self.name,
            self.vertices_part,
            self.faces,
            FINISHES[self.material],
            group=GROUP_PARTS,
            mask=PART_MASK,
            flat=True,
            material=self.material,
            texture=self.texture,
        )
        return body

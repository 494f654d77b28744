"""A fixed point for hand-eye calibration: the apex of a matt white pyramid on a black post.

Body frame: origin at the apex, z up, faces towards x and y. A light plane through the apex that is more across x than
y cuts the two x faces in lines that meet in the apex. One that misses it by d along y still cuts these faces in lines
whose crossing lies at (0, d, 0): the miss shows only across the light plane, where a line sensor sees nothing anyway.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry
from weldcell.models.finishes import FINISHES
from weldcell.models.mesh_body import BLACK, GROUP_PARTS, PART_MASK, add_mesh_geom

_BLOCK_M = 0.006  # below the pyramid's base


@dataclass(frozen=True, kw_only=True)
class Pyramid:
    """Four faces, square base."""

    half_width_m: float = 0.016
    """From the middle to the foot of a face."""
    slope_rad: float = float(np.radians(40))
    """Of the faces against the base."""
    post_m: float = 0.26
    """Length of the post under it."""
    post_radius_m: float = 0.006
    name: str = "pyramid"
    """Name of its body."""

    def __post_init__(self) -> None:
        if not (self.half_width_m > self.post_radius_m > 0 and self.post_m > 0 and 0 < self.slope_rad < np.pi / 2):
            raise BadGeometry(f"pyramid: expected lengths above 0 and a slope below 90 deg, found {self}")

    @property
    def pattern(self) -> None:
        """Nothing is printed on it."""
        return None

    def add_to(self, spec: mujoco.MjSpec, T_base_board: RigidTransform) -> mujoco.MjsBody:
        """The body, its apex at `T_base_board`."""
        quaternion = T_base_board.rotation.as_quat(scalar_first=True)
        body = spec.worldbody.add_body(name=self.name, pos=T_base_board.translation, quat=quaternion, mocap=True)
        foot_z = -self.half_width_m * np.tan(self.slope_rad)
        square = self.half_width_m * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        rings = [np.column_stack([square, np.full(4, z)]) for z in (foot_z - _BLOCK_M, foot_z)]
        walls = [(k, (k + 1) % 4) for k in range(4)]
        faces = [(0, 2, 1), (0, 3, 2), *((a, b, b + 4) for a, b in walls), *((a, b + 4, a + 4) for a, b in walls)]
        faces += [(a + 4, b + 4, 8) for a, b in walls]
        add_mesh_geom(
            spec,
            body,
            self.name,
            np.vstack([*rings, np.zeros((1, 3))]),
            np.array(faces),
            FINISHES["matt-white"],
            group=GROUP_PARTS,
            mask=PART_MASK,
            flat=True,
            material="matt-white",
        )
        body.add_geom(
            name=f"{self.name}_post",
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            pos=[0, 0, foot_z - _BLOCK_M - self.post_m / 2],
            size=[self.post_radius_m, self.post_m / 2, 0],
            rgba=BLACK.rgba,
            group=GROUP_PARTS,
            contype=PART_MASK.contype,
            conaffinity=PART_MASK.conaffinity,
            mass=0,
        )
        return body

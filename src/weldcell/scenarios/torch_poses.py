"""Orientations of the torch and the flange poses that go with them."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.frames import rigid_from


def torch_rotation(heading_rad: float, tilt_rad: float = 0.0, tilt_towards_rad: float = 0.0) -> Rotation:
    """R_base_torch with the torch pointing down and travelling along `heading_rad` (from the base's x).

    The torch then leans by `tilt_rad` about the horizontal axis at `tilt_towards_rad`.
    """
    forward = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0])
    down = np.array([0.0, 0.0, -1.0])
    upright = Rotation.from_matrix(np.column_stack([forward, np.cross(down, forward), down]))
    axis = np.array([np.cos(tilt_towards_rad), np.sin(tilt_towards_rad), 0.0])
    return Rotation.from_rotvec(tilt_rad * axis) * upright


def torch_rotations(travel_base: Float[np.ndarray, "n 3"], approach_base: Float[np.ndarray, "n 3"]) -> Rotation:
    """R_base_torch (stack) with the wire against each approach and x along the travel, as far as that is across it."""
    wire = -approach_base / np.linalg.norm(approach_base, axis=1, keepdims=True)
    side = np.cross(wire, travel_base)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    return Rotation.from_matrix(np.stack([np.cross(side, wire), side, wire], axis=2))


def flange_at(
    point_base: Float[np.ndarray, "3"], rotation_base_flange: Rotation, point_flange: Float[np.ndarray, "3"]
) -> RigidTransform:
    """T_base_flange that brings a point fixed to the flange (e.g. the tip) to a point of the base."""
    return rigid_from(rotation_base_flange, point_base - rotation_base_flange.apply(point_flange))

"""How far the contact tip is from the work, as an arc feels it: along the wire, over the arc's footprint.

The arc lands on some millimetres of metal, and rather where the way is short. A few rays spread from the contact tip
to a footprint of radius f around the wire's aim; d_k is how far along the wire each one gets. The arc's distance is
their soft minimum, -s ln(mean exp(-d_k / s)), with s = 1 mm: the distance itself over a plate, the mean over gentle
relief, the nearest where a ray falls into a gap. A ray that meets nothing adds nothing: no metal at all gives inf.
In a V of half-angle h the distance falls towards the walls by less than cot(h), as the foot reaches up the wall first.
f = 1.5 mm: half of a pool's width or of a spray arc's visible foot at some 200 A (chosen).
"""

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform
from scipy.special import logsumexp

from weldcell.sensor_sim.rays import RayCaster

CONTACT_TIP_M = 0.018
"""From the torch's wire tip, where the work should be, back to the contact tip: as the torch's model."""
WORK_GROUPS = (0,)
"""Geom groups for the caster: parts and room. Torch, arm and sensor's head stop no arc."""
FOOTPRINT_M = 0.0015
_SOFT_M = 1e-3
_AROUND = 6


def contact_distance(
    caster: RayCaster, data: mujoco.MjData, T_base_torch: RigidTransform, contact_tip_m: float = CONTACT_TIP_M
) -> Float[np.ndarray, "*poses"]:
    """Distance (m) from the contact tip to the work for one pose of the torch (a number) or a stack; inf: no work.

    `caster` must see `WORK_GROUPS` only; `data` hold the scene's pose, the same for all the poses of a stack. All rays
    are cast at once.
    """
    matrices = T_base_torch.as_matrix()
    poses = matrices.reshape(-1, 4, 4)
    directions_torch = _cone(FOOTPRINT_M / contact_tip_m)
    origins_base = poses[:, :3, 3] - contact_tip_m * poses[:, :3, 2]
    directions_base = np.einsum("nij,kj->nki", poses[:, :3, :3], directions_torch).reshape(-1, 3)
    hits = caster.cast(data, np.repeat(origins_base, len(directions_torch), axis=0), _unit(directions_base))
    along_m = np.where(hits.hit, hits.distance_m, np.inf).reshape(len(poses), -1) * directions_torch[:, 2]
    distance_m = -_SOFT_M * logsumexp(-along_m / _SOFT_M, axis=1, b=1 / len(directions_torch))
    return distance_m.reshape(matrices.shape[:-2])


def _cone(slope: float) -> Float[np.ndarray, "k 3"]:
    """Unit directions along z: one straight, six at half the slope, six at the whole; mirrored left and right."""
    turn = 2 * np.pi * np.arange(_AROUND) / _AROUND
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    sides = slope * np.vstack([np.zeros((1, 2)), ring / 2, ring])
    return _unit(np.column_stack([sides, np.ones(len(sides))]))


def _unit(directions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)

"""Nearest hits by MuJoCo's own rays, safe from their traps: the reference, and the rarer kinds of geoms.

MuJoCo's `mj_multiRay` culls bodies by the extent of their colliding geoms, so it misses visual-only geoms. It is given
a copy of the model whose bodies have no bounding volume: then it tests every geom, as `mj_ray` does.
"""

import copy

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

_JITTER = 1e-11  # rays exactly through mesh vertices leak; at 0.3 m this moves a hit by 3e-12 m
_LEFT_OUT_GROUP = mujoco.mjNGROUP - 1
_NO_CUTOFF = 1e10  # MuJoCo's mjMAXVAL


class MujocoRays:
    """Traces rays against chosen geoms of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        self._model.body_bvhadr[:] = -1  # no bounding volumes: no culling by collision extent
        self._group_mask = np.eye(1, mujoco.mjNGROUP, dtype=np.uint8)[0]

    def nearest(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
        """Distances (m), outward normals and geoms (-1 for a miss) of the first hits on the chosen geoms."""
        count = len(directions)
        self._model.geom_group[:] = np.where(chosen, 0, _LEFT_OUT_GROUP)
        rays = directions + _JITTER * np.random.default_rng(0).uniform(-1, 1, directions.shape)
        distance_m, normals, geom_id = (np.empty(count), np.empty(3 * count), np.empty(count, np.int32))
        mujoco.mj_multiRay(
            self._model, data, origin, rays.ravel(), self._group_mask, True, -1,
            geom_id, distance_m, normals, count, _NO_CUTOFF,
        )  # fmt: skip
        return distance_m, normals.reshape(count, 3), geom_id

"""Nearest hits by MuJoCo's own rays, safe from their traps: the reference, and the rarer kinds of geoms.

MuJoCo's `mj_multiRay` culls bodies by the extent of their colliding geoms, so it misses visual-only geoms. It is given
a copy of the model whose bodies have no bounding volume: then it tests every geom, as `mj_ray` does.
"""

import copy
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.sensor_sim.solid_rays import Origins

_JITTER = 1e-11  # rays exactly through mesh vertices leak; at 0.3 m this moves a hit by 3e-12 m
_LEFT_OUT_GROUP = mujoco.mjNGROUP - 1
_NO_CUTOFF = 1e10  # MuJoCo's mjMAXVAL


class NearestHits(NamedTuple):
    """What rays meet first on the geoms that were asked for."""

    distance_m: Float[np.ndarray, "n"]
    """Distance from the ray's origin; any number for a miss."""
    normals: Float[np.ndarray, "n 3"]
    """Outward unit normal of the surface there."""
    geom_id: Int[np.ndarray, "n"]
    """The geom; -1 for a miss."""
    face_id: Int[np.ndarray, "n"]
    """The triangle of the geom's mesh; -1 on solids and where the tracer does not know it."""


class MujocoRays:
    """Traces rays against chosen geoms of a model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = copy.copy(model)
        self._model.body_bvhadr[:] = -1  # no bounding volumes: no culling by collision extent
        self._group_mask = np.eye(1, mujoco.mjNGROUP, dtype=np.uint8)[0]

    def maybe_blocked(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Float[np.ndarray, "3"],
        directions: Float[np.ndarray, "n 3"],
        within_m: Float[np.ndarray, "n"],
    ) -> Bool[np.ndarray, "n"]:
        """Every ray: MuJoCo has no quicker question than what is nearest."""
        return np.ones(len(directions), dtype=bool)

    def nearest(
        self,
        data: mujoco.MjData,
        chosen: Bool[np.ndarray, "geoms"],
        origin: Origins,
        directions: Float[np.ndarray, "n 3"],
    ) -> NearestHits:
        """The first hits on the chosen geoms; MuJoCo tells no triangles."""
        count = len(directions)
        self._model.geom_group[:] = np.where(chosen, 0, _LEFT_OUT_GROUP)
        rays = directions + _JITTER * np.random.default_rng(0).uniform(-1, 1, directions.shape)
        distance_m, normals, geom_id = (np.empty(count), np.empty((count, 3)), np.empty(count, np.int32))
        if origin.ndim == 1:
            mujoco.mj_multiRay(
                self._model, data, origin, rays.ravel(), self._group_mask, True, -1,
                geom_id, distance_m, normals.reshape(-1), count, _NO_CUTOFF,
            )  # fmt: skip
        else:  # one by one: MuJoCo has no call for these
            for ray in range(count):
                distance_m[ray] = mujoco.mj_ray(
                    self._model, data, origin[ray], rays[ray], self._group_mask, True, -1,
                    geom_id[ray : ray + 1], normals[ray],
                )  # fmt: skip
        return NearestHits(distance_m, normals, geom_id, np.full(count, -1))

"""Whether a robot comes too close to anything, or its tools to its own arm.

Two stages. MuJoCo collides the convex hulls of all meshes: cheap, and enough where nothing is near. A hull fills every
groove and inner corner, so what touches a workpiece's hull (or the arm's own) is asked again by the real meshes.
Simple solids (spheres, capsules of a user's arm) and furniture are left at the first stage.

The clearance of two geoms is the larger one of their margins in the model. Wire and tip collide with nothing.
"""

from collections.abc import Iterable
from itertools import product

import mujoco
import numpy as np

from weldcell.cell.errors import BadGeometry
from weldcell.cell.world.mesh_clearance import MeshClearance

_TOOLS = ("torch/torch_body", "sensor/sensor_head")
_OWN_ARM = ("arm/base", "arm/link_1", "arm/link_2", "arm/link_3", "arm/link_4")  # the wrist beyond carries the tools
_BEYOND_M = 1e-6  # a search must reach beyond the clearance, or all that is further away would seem to lie at its end


class Collisions:
    """Tests the postures of one model's robot."""

    def __init__(self, model: mujoco.MjModel, workpieces: Iterable[str]) -> None:
        """`workpieces` names the bodies whose meshes count as they are."""
        self._model, self._meshes = model, MeshClearance(model)
        # The broad phase goes by the bodies' margins, which the compiler left at 0 if geoms got theirs afterwards.
        np.maximum.at(model.body_margin, model.geom_bodyid, model.geom_margin)
        self._clearance_m = float(model.geom_margin.max())
        self._is_work = np.isin(model.geom_bodyid, [model.body(name).id for name in workpieces])
        tools, links = ([g for name in names for g in _colliding(model, name)] for names in (_TOOLS, _OWN_ARM))
        self._own_pairs = np.array(list(product(tools, links)))

    def any(self, data: mujoco.MjData, work_clearance_m: float | None = None) -> bool:
        """Whether anything is closer than its clearance; `data` needs up-to-date kinematics.

        `work_clearance_m` stands in the place of the clearance from workpieces; raises BadGeometry if it is larger.
        """
        if work_clearance_m is not None and not 0 <= work_clearance_m <= self._clearance_m:
            raise BadGeometry(f"clearance: found {work_clearance_m} m, expected 0 to {self._clearance_m} m")
        mujoco.mj_collision(self._model, data)
        geoms = data.contact.geom
        if not self._is_work[geoms].any(axis=1).all():
            return True
        usual_m = dict(zip(map(tuple, geoms.tolist()), data.contact.includemargin.tolist(), strict=True))
        for (one, other), clearance_m in usual_m.items():
            if self._close(data, one, other, clearance_m if work_clearance_m is None else work_clearance_m):
                return True
        return self._meets_itself(data)

    def _meets_itself(self, data: mujoco.MjData) -> bool:
        """Whether torch or head come close to base or arm."""
        model, (tools, links) = self._model, self._own_pairs.T
        clearance_m = np.maximum(model.geom_margin[tools], model.geom_margin[links])
        apart_m = np.linalg.norm(data.geom_xpos[tools] - data.geom_xpos[links], axis=1)
        near = apart_m <= model.geom_rbound[tools] + model.geom_rbound[links] + clearance_m
        return any(
            self._close(data, tool, link, within_m)
            for (tool, link), within_m in zip(self._own_pairs[near].tolist(), clearance_m[near].tolist(), strict=True)
            if mujoco.mj_geomDistance(model, data, tool, link, within_m + _BEYOND_M, None) <= within_m
        )

    def _close(self, data: mujoco.MjData, one: int, other: int, clearance_m: float) -> bool:
        """Whether two geoms whose hulls are close are so themselves."""
        if np.all(self._model.geom_type[[one, other]] == mujoco.mjtGeom.mjGEOM_MESH):
            return self._meshes.within(data, one, other, clearance_m)
        apart_m = mujoco.mj_geomDistance(self._model, data, one, other, clearance_m + _BEYOND_M, None)
        return bool(apart_m <= clearance_m)


def _colliding(model: mujoco.MjModel, body: str) -> list[int]:
    """The geoms of a body that collide at all."""
    geoms = np.flatnonzero(model.geom_bodyid == model.body(body).id)
    return geoms[(model.geom_contype[geoms] | model.geom_conaffinity[geoms]) != 0].tolist()

"""The bodies of a MuJoCo model as entities: who carries which mesh, and where each stands at a moment."""

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import UnknownFrame
from weldcell.cell.frames import rigid_from
from weldcell.scenarios.recording.meshes import body_name, carriers, drawn_geoms


@dataclass(frozen=True, kw_only=True, eq=False)
class Bodies:
    """Bodies of one model, each hung under the body that carries it."""

    model: mujoco.MjModel
    carrier: Int[np.ndarray, "nbody"]
    """The movable body that each body is fixed to; 0 for those that stand still."""
    T_carrier_body: list[RigidTransform]

    @staticmethod
    def of(model: mujoco.MjModel) -> "Bodies":
        """All bodies of a model."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        T_base_body = [rigid_from(_rotation(data.xmat[k]), data.xpos[k]) for k in range(model.nbody)]
        carrier = carriers(model)
        return Bodies(
            model=model,
            carrier=carrier,
            T_carrier_body=[T_base_body[c].inv() * T for c, T in zip(carrier, T_base_body, strict=True)],
        )

    @property
    def moving(self) -> list[int]:
        """Ids of the bodies that move by themselves, with what is fixed to them."""
        return sorted({int(c) for c in self.carrier} - {0})

    def path(self, body: int) -> str:
        """Entity of a body."""
        name, carrier = body_name(self.model, body), int(self.carrier[body])
        return f"cell/{name}" if carrier in (0, body) else f"cell/{body_name(self.model, carrier)}/{name}"

    def site(self, name: str) -> tuple[int, RigidTransform]:
        """The body that carries a site, and the site in it."""
        names = [self.model.site(k).name for k in range(self.model.nsite)]
        if name not in names:
            raise UnknownFrame(name, names)
        site = names.index(name)
        rotation = Rotation.from_quat(self.model.site_quat[site], scalar_first=True)
        return int(self.model.site_bodyid[site]), rigid_from(rotation, self.model.site_pos[site])

    def drawn(self) -> Iterator[tuple[str, rr.AsComponents]]:
        """What never changes: meshes, and the places of bodies that are fixed to others or stand still."""
        for geom in drawn_geoms(self.model):
            mesh = rr.Mesh3D(
                vertex_positions=geom.points_body.astype(np.float32),
                vertex_normals=geom.normals_body.astype(np.float32),
                triangle_indices=geom.faces.astype(np.uint32),
                albedo_factor=geom.rgba,
            )
            yield f"{self.path(geom.body)}/{geom.name}", mesh
        for body in range(1, self.model.nbody):
            if self.carrier[body] != body:
                T = self.T_carrier_body[body]
                yield self.path(body), rr.Transform3D(translation=T.translation, mat3x3=T.rotation.as_matrix())


def _rotation(matrix: Float[np.ndarray, "9"]) -> Rotation:
    return Rotation.from_matrix(matrix.reshape(3, 3))

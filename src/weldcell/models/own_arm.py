"""Any six-axis arm in the shape that the cell expects, taken from a compiled MuJoCo model of it.

What is taken is plain: joint axes, masses and shapes where they stand at reading zero. From these a new arm is built
with the names of the cell's own (`base`, `link_1`..`link_6`, `joint_1`..`joint_6`, site `flange`, motors), so that
nothing else of a foreign model (defaults, contact rules, constraints, plugins) can reach the cell. Every link's frame
has the base's orientation and its origin on its joint's axis, at reading zero.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from
from weldcell.models.arm import add_motor
from weldcell.models.mesh_body import GROUP_ARM, NO_MASK, ROBOT_MASK, Finish, add_mesh_geom

JOINTS = 6

_SOLIDS = tuple(
    getattr(mujoco.mjtGeom, f"mjGEOM_{name}") for name in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER", "BOX")
)
_FARTHEST_M = 50.0
_LEAST_MASS_KG = 1e-3  # of a link that the model gives none, such as the middle one of a two-axis joint
_LEAST_INERTIA_KGM2 = 1e-6
_GRAVITY = 9.81
# Torch, sensor head and cables, for the drives' strength: how far out of the flange and beside its axis.
_PAYLOAD_KG, _PAYLOAD_OUT_M, _PAYLOAD_ASIDE_M = 8.0, 0.2, 0.1
_ROTOR_RAD_S2 = 300.0  # at which a drive's largest torque turns up its own rotor: 225 to 470 in the cell's own arm
_STRENGTH = 4.0  # largest torque over the largest static load, as the cell's own arm
_COULOMB_SHARE, _VISCOUS_SHARE = 0.03, 0.04  # of the largest torque: dry friction, and friction at full speed
_FLANGE_SIZE_M = 0.004


@dataclass(frozen=True, kw_only=True, eq=False)
class LinkShape:
    """One solid or mesh of a link."""

    kind: int
    """MuJoCo's geom type: a simple solid or a mesh."""
    T_base_shape: RigidTransform
    """Where it is at reading zero."""
    size_m: Float[np.ndarray, "3"]
    """Of a solid, as MuJoCo has it."""
    vertices_shape: Float[np.ndarray, "n 3"]
    """Of a mesh, m; else empty."""
    faces: Int[np.ndarray, "m 3"]
    rgba: tuple[float, float, float, float]
    collides: bool
    """Whether it takes part in collisions; what only does that is transparent."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmLink:
    """What moves with one joint, or stands with the base, at reading zero."""

    mass_kg: float
    centre_base: Float[np.ndarray, "3"]
    """Centre of mass, m."""
    inertia_base: Float[np.ndarray, "3 3"]
    """About the centre of mass, axes of the base, kg m2."""
    shapes: tuple[LinkShape, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnArm:
    """A six-axis arm as plain numbers."""

    name: str
    axes_base: Float[np.ndarray, "6 3"]
    """Joint axes at reading zero, unit; a positive reading turns right-handed about them."""
    anchors_base: Float[np.ndarray, "6 3"]
    """A point on each axis at reading zero, m."""
    T_base_flange_zero: RigidTransform
    """The flange, z out of it."""
    limits_rad: Float[np.ndarray, "6 2"]
    speeds_rad_s: Float[np.ndarray, "6"]
    home_rad: Float[np.ndarray, "6"]
    """A posture with the tool above the table, clear of everything, in the arm's usual configuration."""
    links: tuple[ArmLink, ...]
    """Base, then link 1 to 6."""

    def __post_init__(self) -> None:
        low, high = self.limits_rad.T
        if not np.all(low < high) or np.abs(self.limits_rad).max() > np.radians(540):
            raise BadGeometry("limits: expected each lower one below the upper, all within 540 deg")
        if not np.all(np.isfinite(self.speeds_rad_s)) or self.speeds_rad_s.min() <= 0:
            raise BadGeometry("speeds: expected six above 0")
        for k in range(JOINTS):
            if not low[k] <= self.home_rad[k] <= high[k]:
                raise BadGeometry(
                    f"home: joint {k + 1}: found {np.degrees(self.home_rad[k]):.4g} deg, expected "
                    f"{np.degrees(low[k]):.4g} to {np.degrees(high[k]):.4g}"
                )

    @property
    def reach_m(self) -> float:
        """Upper bound of the distance of the flange from the first axis' anchor: the links' lengths together."""
        points = np.vstack([self.anchors_base, self.T_base_flange_zero.translation])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def arm_of_model(
    model: mujoco.MjModel,
    joints: Sequence[int],
    flange_body: int,
    T_body_flange: RigidTransform,
    *,
    name: str,
    limits_rad: Float[np.ndarray, "6 2"],
    speeds_rad_s: Float[np.ndarray, "6"],
    home_rad: Float[np.ndarray, "6"],
    T_base_world: RigidTransform,
) -> OwnArm:
    """The arm of a compiled model whose chain of joints is known; other joints are frozen as drawn.

    `T_base_world` places the model's world in the cell. Raises BadGeometry for places that are not in any cell.
    """
    data = mujoco.MjData(model)
    data.qpos[model.jnt_qposadr[list(joints)]] = 0
    mujoco.mj_kinematics(model, data)
    carrier = _carriers(model, joints)
    for what in (data.xpos, data.geom_xpos, data.xanchor):
        if not np.all(np.isfinite(what)) or np.abs(what).max(initial=0) > _FARTHEST_M:
            raise BadGeometry(f"found a place that is not within {_FARTHEST_M:.0f} m of the origin")
    T_world_body = rigid_from(Rotation.from_matrix(data.xmat[flange_body].reshape(3, 3)), data.xpos[flange_body].copy())
    return OwnArm(
        name=name,
        axes_base=T_base_world.rotation.apply(data.xaxis[list(joints)]),
        anchors_base=T_base_world.apply(data.xanchor[list(joints)]),
        T_base_flange_zero=T_base_world * T_world_body * T_body_flange,
        limits_rad=np.asarray(limits_rad, float),
        speeds_rad_s=np.asarray(speeds_rad_s, float),
        home_rad=np.asarray(home_rad, float),
        links=tuple(_link(model, data, carrier == k, T_base_world) for k in range(JOINTS + 1)),
    )


def build_own_arm(arm: OwnArm) -> mujoco.MjSpec:
    """The arm with the names of the cell's own: bodies, joints, site `flange`, motors `motor_1`..`_6`."""
    spec = mujoco.MjSpec()
    spec.modelname = "arm"
    spec.compiler.degree = False  # limits are in rad
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0's Newton solver errs with sparse Jacobians
    body = spec.worldbody.add_body(name="base")
    _furnish(spec, body, arm.links[0], np.zeros(3), "base")
    origin = np.zeros(3)
    for k, (axis, anchor) in enumerate(zip(arm.axes_base, arm.anchors_base, strict=True)):
        body = body.add_body(name=f"link_{k + 1}", pos=anchor - origin)
        origin = anchor
        torque_nm = _torque_nm(arm, k)
        body.add_joint(
            name=f"joint_{k + 1}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=arm.limits_rad[k],
            armature=torque_nm / _ROTOR_RAD_S2,
            damping=_VISCOUS_SHARE * torque_nm / arm.speeds_rad_s[k],
            frictionloss=_COULOMB_SHARE * torque_nm,
        )
        _furnish(spec, body, arm.links[k + 1], anchor, f"link_{k + 1}")
    zero = arm.T_base_flange_zero
    body.add_site(
        name="flange",
        pos=zero.translation - origin,
        quat=zero.rotation.as_quat(scalar_first=True),
        size=[_FLANGE_SIZE_M] * 3,
        group=5,
    )
    for k in range(JOINTS):
        add_motor(spec, k, _torque_nm(arm, k))
    return spec


def _carriers(model: mujoco.MjModel, joints: Sequence[int]) -> Int[np.ndarray, "nbody"]:
    """For each body the number of the last joint of the chain that moves it, 0 for the base."""
    carrier = np.zeros(model.nbody, int)
    for body in range(1, model.nbody):
        own = [k + 1 for k, joint in enumerate(joints) if model.jnt_bodyid[joint] == body]
        carrier[body] = max(own, default=carrier[model.body_parentid[body]])
    return carrier


def _link(
    model: mujoco.MjModel, data: mujoco.MjData, own: Bool[np.ndarray, "nbody"], T_base_world: RigidTransform
) -> ArmLink:
    bodies = np.flatnonzero(own & (model.body_mass > 0))
    mass_kg = float(model.body_mass[bodies].sum())
    centres = data.xipos[bodies]
    centre = model.body_mass[bodies] @ centres / mass_kg if mass_kg else np.zeros(3)
    inertia = np.zeros((3, 3))
    for body, offset in zip(bodies, centres - centre, strict=True):  # Huygens-Steiner
        turn = data.ximat[body].reshape(3, 3)
        inertia += turn @ np.diag(model.body_inertia[body]) @ turn.T
        inertia += model.body_mass[body] * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    turn = T_base_world.rotation.as_matrix()
    return ArmLink(
        mass_kg=mass_kg,
        centre_base=T_base_world.apply(centre),
        inertia_base=turn @ inertia @ turn.T,
        shapes=tuple(_shapes(model, data, np.flatnonzero(own[model.geom_bodyid]), T_base_world)),
    )


def _shapes(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: Int[np.ndarray, "n"], T_base_world: RigidTransform
) -> list[LinkShape]:
    """The geoms of a link. Where it has some that collide and some that do not, the latter are what is seen of it."""
    mesh = mujoco.mjtGeom.mjGEOM_MESH
    geoms = geoms[np.isin(model.geom_type[geoms], [*map(int, _SOLIDS), int(mesh)])]
    touching = (model.geom_contype[geoms] | model.geom_conaffinity[geoms]) != 0
    split = bool(touching.any() and not touching.all())
    shapes = []
    for geom, touches in zip(geoms, touching, strict=True):
        material = model.geom_matid[geom]
        rgba = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        vertices, faces = _mesh(model, int(model.geom_dataid[geom])) if model.geom_type[geom] == mesh else _NO_MESH
        turn = Rotation.from_matrix(data.geom_xmat[geom].reshape(3, 3))
        red, green, blue = (float(x) for x in np.clip(rgba[:3], 0, 1))
        shapes.append(
            LinkShape(
                kind=int(model.geom_type[geom]),
                T_base_shape=T_base_world * rigid_from(turn, data.geom_xpos[geom].copy()),
                size_m=model.geom_size[geom].copy(),
                vertices_shape=vertices,
                faces=faces,
                rgba=(red, green, blue, 0.0 if split and touches else 1.0),
                collides=bool(touches or not split),
            )
        )
    return shapes


_NO_MESH = (np.empty((0, 3)), np.empty((0, 3), int))


def _mesh(model: mujoco.MjModel, mesh: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(float)
    first, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return vertices, model.mesh_face[first : first + count].astype(int)


def _furnish(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, link: ArmLink, origin_base: Float[np.ndarray, "3"], prefix: str
) -> None:
    """Gives a body its shapes and its mass."""
    for index, shape in enumerate(link.shapes):
        name = f"{prefix}_shape_{index + 1}"
        mask = ROBOT_MASK if shape.collides else NO_MASK
        place, turn = shape.T_base_shape.translation - origin_base, shape.T_base_shape.rotation
        if len(shape.faces):
            vertices = turn.apply(shape.vertices_shape) + place
            add_mesh_geom(spec, body, name, vertices, shape.faces, Finish(rgba=shape.rgba), group=GROUP_ARM, mask=mask)
            continue
        body.add_geom(
            name=name,
            type=mujoco.mjtGeom(shape.kind),
            size=shape.size_m,
            pos=place,
            quat=turn.as_quat(scalar_first=True),
            rgba=shape.rgba,
            group=GROUP_ARM,
            contype=mask.contype,
            conaffinity=mask.conaffinity,
            mass=0,
        )
    inertia = link.inertia_base if link.mass_kg > _LEAST_MASS_KG else np.zeros((3, 3))
    inertia = inertia + _LEAST_INERTIA_KGM2 * np.eye(3)
    body.mass = max(link.mass_kg, _LEAST_MASS_KG)
    body.ipos = link.centre_base - origin_base if link.mass_kg > _LEAST_MASS_KG else np.zeros(3)
    body.fullinertia = [*np.diagonal(inertia), *inertia[[0, 0, 1], [1, 2, 2]]]
    body.explicitinertial = True


def _torque_nm(arm: OwnArm, joint: int) -> float:
    """The drive's largest torque: several times what holds all that the joint carries, level and stretched."""
    payload_base = arm.T_base_flange_zero.apply([0, 0, _PAYLOAD_OUT_M])
    load_nm = _PAYLOAD_KG * _GRAVITY * (_farthest_m(arm, joint, JOINTS - 1, payload_base) + _PAYLOAD_ASIDE_M)
    for carried, link in enumerate(arm.links[joint + 1 :], start=joint):
        load_nm += link.mass_kg * _GRAVITY * _farthest_m(arm, joint, carried, link.centre_base)
    return _STRENGTH * load_nm


def _farthest_m(arm: OwnArm, joint: int, carried: int, point: Float[np.ndarray, "3"]) -> float:
    """Bound of a point's distance from a joint's axis, whatever the joints between it and the link that carries it."""
    stops = np.vstack([arm.anchors_base[joint + 1 : carried + 1], point])
    first_m = np.linalg.norm(np.cross(stops[0] - arm.anchors_base[joint], arm.axes_base[joint]))
    return float(first_m + np.linalg.norm(np.diff(stops, axis=0), axis=1).sum())

"""The six-axis welding arm: geometry of the KUKA KR 5 arc class, our own shapes, as an MjSpec.

Joint angles are those on the controller's display. Zero is the arm stretched out forwards; the vector
(0, -90, 90, 0, 0, 0) deg stands the lower arm up and lays the upper arm level, flange z along +x.
"""

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadGeometry
from weldcell.models import arm_shapes
from weldcell.models.mesh_body import GROUP_ARM, Piece, add_pieces, set_inertia, volume_properties

Six = tuple[float, float, float, float, float, float]


def _rad(*values_deg: float) -> Six:
    a, b, c, d, e, f = (math.radians(value) for value in values_deg)
    return a, b, c, d, e, f


@dataclass(frozen=True, kw_only=True)
class ArmGeometry:
    """An ortho-parallel arm with a spherical wrist (Brandstoetter, Angerer, Hofbaur 2014, Fig. 2)."""

    a1_m: float
    """From axis 1 forwards to axis 2."""
    a2_m: float
    """From axis 3 to the upper arm's axis; negative is above it when the upper arm points forwards."""
    b_m: float
    """Sideways offset of the upper arm from axis 1."""
    c1_m: float
    """Height of axis 2 above the floor."""
    c2_m: float
    """From axis 2 to axis 3."""
    c3_m: float
    """From axis 3 to the wrist's centre along the upper arm."""
    c4_m: float
    """From the wrist's centre to the flange."""
    signs: Six
    """Sense of each joint against the ortho-parallel angles: theta = sign * q - offset."""
    offsets_rad: Six
    """Offset of each joint in the same formula."""
    lower_rad: Six
    """Lower joint limits."""
    upper_rad: Six
    """Upper joint limits."""
    speeds_rad_s: Six
    """Largest joint speeds."""

    def __post_init__(self) -> None:
        lengths = [self.a1_m, self.a2_m, self.b_m, self.c1_m, self.c2_m, self.c3_m, self.c4_m]
        if not np.all(np.isfinite(lengths)) or min(self.c1_m, self.c2_m, self.c3_m, self.c4_m) <= 0:
            raise BadGeometry(f"arm: expected finite lengths with c1..c4 positive, found {lengths}")
        if not np.all(np.less(self.lower_rad, self.upper_rad)):
            raise BadGeometry("arm: expected each lower joint limit below the upper one")

    @property
    def limits_rad(self) -> Float[np.ndarray, "6 2"]:
        """Lower and upper limit of each joint."""
        return np.column_stack([self.lower_rad, self.upper_rad])


# Lengths, limits and speeds: ROS-Industrial's kuka_experimental, its package for the KR 5 arc.
KR5_ARC = ArmGeometry(
    a1_m=0.180,
    a2_m=-0.120,
    b_m=0.0,
    c1_m=0.400,
    c2_m=0.600,
    c3_m=0.620,
    c4_m=0.115,
    signs=(-1, 1, 1, -1, 1, -1),
    offsets_rad=_rad(0, -90, 0, 0, 0, 0),
    lower_rad=_rad(-155, -180, -15, -350, -130, -350),
    upper_rad=_rad(155, 65, 158, 350, 130, 350),
    speeds_rad_s=_rad(154, 154, 228, 343, 384, 721),
)

ARM_MASS_KG = 127.0
"""Mass of the whole arm with its base (the class's published figure)."""

# Effective densities, kg/m3, of the closed outer shapes before they are scaled to the total mass. Solid aluminium has
# 2700 and iron 7200: the castings are hollow but hold motors, gears and cables; the flange is nearly solid steel.
_EFFECTIVE_DENSITY = {
    "base": 2200.0,
    "link_1": 2200.0,
    "link_2": 2000.0,
    "link_3": 2300.0,
    "link_4": 1850.0,
    "link_5": 2200.0,
    "link_6": 4200.0,
}


@dataclass(frozen=True, kw_only=True)
class _Drive:
    """Motor and gear of one axis, at the joint: chosen for this class of arm, not measured."""

    torque_nm: float
    """What the motor can give for a moment: about four times the largest static load of axes 2 and 3."""
    armature_kgm2: float
    """Rotor inertia times the gear's ratio squared: 5e-4 kg m2 behind 1:110 for the large motors."""
    coulomb_nm: float
    """Dry friction: some 3 % of the largest torque, as geared joints of robots have it when warm."""
    viscous_nms_rad: float
    """Friction that grows with speed: some 4 % of the largest torque at full speed, 9 % for the quick last axis."""


_DRIVES = (
    *(_Drive(torque_nm=1500, armature_kgm2=6.0, coulomb_nm=45, viscous_nms_rad=20),) * 2,
    _Drive(torque_nm=900, armature_kgm2=4.0, coulomb_nm=27, viscous_nms_rad=15),
    *(_Drive(torque_nm=120, armature_kgm2=0.3, coulomb_nm=3.6, viscous_nms_rad=1),) * 2,
    _Drive(torque_nm=70, armature_kgm2=0.15, coulomb_nm=2.1, viscous_nms_rad=0.5),
)


def build_arm(geometry: ArmGeometry = KR5_ARC) -> mujoco.MjSpec:
    """The arm with its base on the floor at the origin, site `flange` on `link_6` and motors `motor_1`..`_6`.

    Each joint sits at its body's origin, so that bodies and axes can be moved to make an imperfect robot.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "arm"
    spec.compiler.degree = False  # limits are in rad
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0's Newton solver errs with sparse Jacobians
    bodies = _add_chain(spec, geometry)
    pieces = link_pieces(geometry)
    masses_kg = link_masses_kg(pieces)
    for body in bodies:
        add_pieces(spec, body, pieces[body.name], group=GROUP_ARM)
        set_inertia(body, pieces[body.name], masses_kg[body.name])
    bodies[-1].add_site(name="flange", pos=[0, 0, geometry.c4_m], size=[0.004, 0.004, 0.004], group=5)
    for i, drive in enumerate(_DRIVES):
        add_motor(spec, i, drive.torque_nm)
    return spec


def add_motor(spec: mujoco.MjSpec, joint: int, torque_nm: float) -> None:
    """Gives a joint (from 0 on) its motor, commanded by a torque; the servos are those of `cell.world.drives`."""
    motor = spec.add_actuator(
        name=f"motor_{joint + 1}",
        target=f"joint_{joint + 1}",
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        ctrllimited=mujoco.mjtLimited.mjLIMITED_TRUE,
        ctrlrange=[-torque_nm, torque_nm],
    )
    motor.set_to_motor()


def link_pieces(geometry: ArmGeometry = KR5_ARC) -> dict[str, list[Piece]]:
    """The coloured solids of each body, in its own frame."""
    return {
        "base": arm_shapes.base_pieces(geometry.c1_m),
        "link_1": arm_shapes.carousel_pieces(geometry.a1_m),
        "link_2": arm_shapes.lower_arm_pieces(geometry.c2_m),
        "link_3": arm_shapes.elbow_pieces(geometry.a2_m),
        "link_4": arm_shapes.upper_arm_pieces(geometry.c3_m),
        "link_5": arm_shapes.wrist_pieces(),
        "link_6": arm_shapes.flange_pieces(geometry.c4_m),
    }


def link_masses_kg(pieces: dict[str, list[Piece]]) -> dict[str, float]:
    """The mass of each body: volume times effective density, scaled together to `ARM_MASS_KG`."""
    raw = {name: volume_properties(solids)[0] * _EFFECTIVE_DENSITY[name] for name, solids in pieces.items()}
    scale = ARM_MASS_KG / sum(raw.values())
    return {name: mass * scale for name, mass in raw.items()}


def _add_chain(spec: mujoco.MjSpec, geometry: ArmGeometry) -> list[mujoco.MjsBody]:
    """The seven bodies with their joints; the body's own turn holds the joint's offset."""
    origins = [
        (0, 0, geometry.c1_m),
        (geometry.a1_m, 0, 0),
        (0, 0, geometry.c2_m),
        (geometry.a2_m, geometry.b_m, geometry.c3_m),
        (0, 0, 0),
        (0, 0, 0),
    ]
    axes = np.array([(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)], float)
    bodies = [spec.worldbody.add_body(name="base")]
    for i, (origin, axis) in enumerate(zip(origins, axes, strict=True)):
        half_turn = -0.5 * geometry.offsets_rad[i]
        quaternion = [math.cos(half_turn), *(math.sin(half_turn) * axis)]  # w x y z
        body = bodies[-1].add_body(name=f"link_{i + 1}", pos=origin, quat=quaternion)
        drive = _DRIVES[i]
        body.add_joint(
            name=f"joint_{i + 1}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=geometry.signs[i] * axis,
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=[geometry.lower_rad[i], geometry.upper_rad[i]],
            armature=drive.armature_kgm2,
            damping=drive.viscous_nms_rad,
            frictionloss=drive.coulomb_nm,
        )
        bodies.append(body)
    return bodies

"""The MIG/MAG torch: bent neck, gas nozzle, contact tip and a wire that ends in a small ball."""

import mujoco
import numpy as np
from manifold3d import Manifold
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from
from weldcell.models.mesh_body import (
    BLACK,
    BRASS,
    COPPER,
    DARK_GREY,
    GROUP_TORCH,
    NO_MASK,
    STEEL,
    Piece,
    add_pieces,
    set_inertia,
)
from weldcell.models.shapes import bezier, bolt_circle, box, hose, join, rod, turned

NECK_BEND_RAD = np.deg2rad(35.0)
"""Angle between flange and wire, about the flange's y."""
_STRAIGHT_M, _BENT_M = 0.22, 0.12  # along the flange's z, then along the wire

TORCH_MASS_KG = 2.1
"""Torch with crash sensor and bracket; plausible for a gas-cooled robot torch, not measured."""

T_FLANGE_TORCH: RigidTransform = rigid_from(
    Rotation.from_euler("y", -NECK_BEND_RAD),
    np.array([-_BENT_M * np.sin(NECK_BEND_RAD), 0, _STRAIGHT_M + _BENT_M * np.cos(NECK_BEND_RAD)]),
)
"""Nominal torch: origin at the wire's tip, z along the wire towards the work, x towards the sensor."""


def build_torch(T_flange_torch: RigidTransform = T_FLANGE_TORCH, tip_radius_m: float = 0.0006) -> mujoco.MjSpec:
    """Body `torch_body` in the flange frame with site `torch` at the wire's tip.

    The wire ends in the sphere geom `torch_tip` whose centre is the torch frame's origin. Wire and tip collide
    with nothing, since the tip is meant to touch.
    """
    if not (np.isfinite(tip_radius_m) and tip_radius_m > 0):
        raise BadGeometry(f"torch: expected a positive tip radius, found {tip_radius_m} m")
    spec = mujoco.MjSpec()
    spec.modelname = "torch"
    body = spec.worldbody.add_body(name="torch_body")
    solid_pieces = torch_pieces(T_flange_torch)
    add_pieces(spec, body, solid_pieces, group=GROUP_TORCH)
    wire = _at(T_flange_torch, rod((0, 0, -0.03), (0, 0, 0), min(0.0005, tip_radius_m), edge=1e-4, segments=12))
    wire_pieces = [Piece(name="torch_wire", solid=wire, finish=COPPER)]
    add_pieces(spec, body, wire_pieces, group=GROUP_TORCH, mask=NO_MASK)
    tip_flange = T_flange_torch.translation
    body.add_geom(
        name="torch_tip",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[tip_radius_m, 0, 0],
        pos=tip_flange,
        rgba=COPPER.rgba,
        group=GROUP_TORCH,
        contype=NO_MASK.contype,
        conaffinity=NO_MASK.conaffinity,
        mass=0,
    )
    body.add_site(name="torch", pos=tip_flange, quat=T_flange_torch.rotation.as_quat(scalar_first=True), group=5)
    set_inertia(body, solid_pieces, TORCH_MASS_KG)
    return spec


def torch_pieces(T_flange_torch: RigidTransform = T_FLANGE_TORCH) -> list[Piece]:
    """The coloured solids of the torch without its wire, in the flange frame."""
    return _mount_pieces() + _neck_pieces(T_flange_torch)


def _mount_pieces() -> list[Piece]:
    """Adapter, crash sensor and clamp, straight out of the flange."""
    adapter = join(
        [rod((0, 0, 0), (0, 0, 0.022), 0.038, edge=0.002), rod((0, 0, 0.02), (0, 0, 0.03), 0.030, edge=0.002)]
    )
    crash_sensor = turned(
        [
            (0, 0.026), (0.036, 0.026), (0.041, 0.031), (0.041, 0.050), (0.034, 0.056), (0.034, 0.066),
            (0.038, 0.070), (0.038, 0.084), (0.030, 0.092), (0, 0.092),
        ]
    )  # fmt: skip
    clamp = join(
        [
            box((-0.034, -0.026, 0.088), (0.034, 0.026, 0.128), 0.005),
            rod((-0.026, -0.031, 0.108), (-0.026, 0.031, 0.108), 0.006, edge=0.001, segments=6),
            rod((0.026, -0.031, 0.108), (0.026, 0.031, 0.108), 0.006, edge=0.001, segments=6),
        ]
    )
    bolts = bolt_circle((0, 0, 0.021), (0, 0, 1), radius=0.0335, count=6, bolt=0.0032, height=0.004)
    return [
        Piece(name="torch_adapter", solid=adapter, finish=STEEL),
        Piece(name="torch_crash_sensor", solid=crash_sensor, finish=DARK_GREY),
        Piece(name="torch_clamp", solid=clamp, finish=STEEL),
        Piece(name="torch_bolts", solid=bolts, finish=DARK_GREY),
    ]


def _neck_pieces(T_flange_torch: RigidTransform) -> list[Piece]:
    """Handle, neck bent towards the wire, insulator, nozzle and contact tip."""
    handle = join(
        [
            rod((0, 0, 0.085), (0, 0, 0.160), 0.021, edge=0.004),
            rod((0, 0, 0.155), (0, 0, 0.176), 0.0165, edge=0.003, end_radius=0.0125),
        ]
    )
    start, end = np.array([0, 0, 0.165]), T_flange_torch.apply(np.array([0, 0, -0.082]))
    reach = 0.4 * np.linalg.norm(end - start)
    wire_flange = T_flange_torch.rotation.apply([0.0, 0, 1])
    neck = hose(bezier([start, start + [0, 0, reach], end - reach * wire_flange, end]), 0.0095, 24)
    insulator = rod((0, 0, -0.098), (0, 0, -0.080), 0.0135, edge=0.002)
    nozzle = turned(
        [
            (0, -0.082), (0.0122, -0.082), (0.0125, -0.081), (0.0125, -0.040), (0.0095, -0.019), (0.0095, -0.015),
            (0.0080, -0.015), (0.0080, -0.022), (0.0105, -0.042), (0, -0.042),
        ]
    )  # fmt: skip
    tip = rod((0, 0, -0.045), (0, 0, -0.018), 0.0040, edge=0.001, end_radius=0.0026, segments=20)
    return [
        Piece(name="torch_handle", solid=handle, finish=BLACK),
        Piece(name="torch_neck", solid=neck, finish=STEEL),
        Piece(name="torch_insulator", solid=_at(T_flange_torch, insulator), finish=BLACK),
        Piece(name="torch_nozzle", solid=_at(T_flange_torch, nozzle), finish=BRASS),
        Piece(name="torch_contact_tip", solid=_at(T_flange_torch, tip), finish=COPPER),
    ]


def _at(T_flange_torch: RigidTransform, solid: Manifold) -> Manifold:
    """The solid, given in the torch frame, in the flange frame."""
    return solid.transform(T_flange_torch.as_matrix()[:3])

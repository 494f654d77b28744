"""The cell's room: floor, welding table, lights, and the cabinets behind the arm."""

import mujoco
import numpy as np
from manifold3d import CrossSection, Manifold

from weldcell.models.mesh_body import (
    BLACK,
    BLUE,
    DARK_GREY,
    GROUP_PARTS,
    LIGHT_GREY,
    ORANGE,
    PART_MASK,
    Finish,
    Piece,
    add_pieces,
)
from weldcell.models.shapes import box, join, rod

TABLE_TOP_M = 0.300
"""Height of the table's upper side above the floor."""
TABLE_X_M, TABLE_Y_M = (0.55, 1.35), (-0.70, 0.70)
"""Extent of the table in the base frame."""

BENCH_TOP_M = 0.500
"""Height of the bench for parts that are not in use."""
BENCH_X_M, BENCH_Y_M = (-0.10, 1.05), (0.85, 1.15)
"""Extent of the bench in the base frame."""

_BORE_M, _GRID_M = 0.014, 0.100  # radius and pitch of the bores: a common modular welding table, D28 on 100 mm
_TABLE_STEEL = Finish(rgba=(0.33, 0.34, 0.36, 1.0), specular=0.15, shininess=0.2)


def build_room() -> mujoco.MjSpec:
    """The spec that arm and parts are attached to: world frame = robot base, z up, floor at z = 0."""
    spec = mujoco.MjSpec()
    spec.modelname = "weldcell"
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE  # 4.0.0's Newton solver errs with sparse Jacobians
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _set_visuals(spec)
    _add_floor(spec)
    table = spec.worldbody.add_body(name="table")
    add_pieces(spec, table, _table_pieces(), group=GROUP_PARTS, mask=PART_MASK)
    bench = spec.worldbody.add_body(name="bench")
    add_pieces(spec, bench, _bench_pieces(), group=GROUP_PARTS, mask=PART_MASK)
    cabinets = spec.worldbody.add_body(name="cabinets")
    add_pieces(spec, cabinets, _cabinet_pieces(), group=GROUP_PARTS, mask=PART_MASK)
    _add_lights(spec)
    return spec


def _table_pieces() -> list[Piece]:
    """Bored top plate with skirt, and legs; the top plate's hull is its box."""
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    outline = CrossSection.square((x1 - x0, y1 - y0)).translate((x0, y0))
    for x in np.arange(x0 + 0.05, x1, _GRID_M):
        for y in np.arange(y0 + 0.05, y1, _GRID_M):
            outline = outline - CrossSection.circle(_BORE_M, 24).translate((x, y))
    top = Manifold.extrude(outline, 0.025).translate((0, 0, TABLE_TOP_M - 0.025))
    skirt = join(
        [
            box((x0, y0, 0.20), (x0 + 0.016, y1, TABLE_TOP_M - 0.025), 0.002),
            box((x1 - 0.016, y0, 0.20), (x1, y1, TABLE_TOP_M - 0.025), 0.002),
            box((x0, y0, 0.20), (x1, y0 + 0.016, TABLE_TOP_M - 0.025), 0.002),
            box((x0, y1 - 0.016, 0.20), (x1, y1, TABLE_TOP_M - 0.025), 0.002),
        ]
    )
    legs = join(
        join(
            [
                box((x, y, 0.01), (x + 0.08, y + 0.08, 0.21), 0.006),
                rod((x + 0.04, y + 0.04, 0), (x + 0.04, y + 0.04, 0.02), 0.05),
            ]
        )
        for x in (x0 + 0.03, x1 - 0.11)
        for y in (y0 + 0.03, y1 - 0.11)
    )
    return [
        Piece(name="table_top", solid=top, finish=_TABLE_STEEL),
        Piece(name="table_skirt", solid=skirt, finish=_TABLE_STEEL),
        Piece(name="table_legs", solid=legs, finish=DARK_GREY),
    ]


def _bench_pieces() -> list[Piece]:
    """A bench beside the arm for what is not on the table."""
    (x0, x1), (y0, y1) = BENCH_X_M, BENCH_Y_M
    top = box((x0, y0, BENCH_TOP_M - 0.04), (x1, y1, BENCH_TOP_M), 0.004)
    legs = join(
        box((x, y, 0.0), (x + 0.05, y + 0.05, BENCH_TOP_M - 0.03), 0.004)
        for x in (x0 + 0.03, x1 - 0.08)
        for y in (y0 + 0.03, y1 - 0.08)
    )
    return [
        Piece(name="bench_top", solid=top, finish=LIGHT_GREY),
        Piece(name="bench_legs", solid=legs, finish=DARK_GREY),
    ]


def _cabinet_pieces() -> list[Piece]:
    """Robot controller and welding power source, out of the arm's reach behind it."""
    controller = join(
        [box((-1.75, -0.95, 0.06), (-1.15, -0.25, 1.0), 0.012), box((-1.155, -0.90, 0.12), (-1.14, -0.30, 0.94), 0.004)]
    )
    feet = join(
        [
            box((-1.72, -0.92, 0), (-1.18, -0.28, 0.07), 0.004),
            box((-1.70, 0.17, 0), (-1.20, 0.58, 0.10), 0.004),
            box((-1.137, -0.80, 0.62), (-1.132, -0.52, 0.82), 0.001),
            box((-1.137, -0.42, 0.45), (-1.115, -0.39, 0.60), 0.002),
            box((-1.152, 0.24, 0.55), (-1.140, 0.51, 0.68), 0.002),
        ]
    )
    source = box((-1.75, 0.15, 0.09), (-1.15, 0.60, 0.72), 0.03)
    drum = join(
        [
            rod((-1.45, 0.95, 0.0), (-1.45, 0.95, 0.80), 0.26, edge=0.02),
            rod((-1.45, 0.95, 0.78), (-1.45, 0.95, 0.86), 0.20, edge=0.02, end_radius=0.06),
        ]
    )
    return [
        Piece(name="controller_cabinet", solid=controller, finish=LIGHT_GREY),
        Piece(name="cabinet_details", solid=feet, finish=BLACK),
        Piece(name="power_source", solid=source, finish=BLUE),
        Piece(name="wire_drum", solid=drum, finish=ORANGE),
    ]


def _add_floor(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.60, 0.61, 0.62],
        rgb2=[0.565, 0.575, 0.585],
        width=256,
        height=256,
    )
    material = spec.add_material(name="floor", texrepeat=[1, 1], texuniform=True, specular=0.1, shininess=0.1)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "floor"
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[6, 6, 0.5],
        material="floor",
        group=GROUP_PARTS,
        contype=PART_MASK.contype,
        conaffinity=PART_MASK.conaffinity,
    )


def _add_lights(spec: mujoco.MjSpec) -> None:
    """A key light over the table that casts shadows, and two soft ones from the sides."""
    for name, position, target, strength, shadow in (
        ("key_light", (1.6, -1.6, 3.2), (0.8, 0, 0.3), 0.55, True),
        ("fill_light", (0.2, 2.6, 2.6), (0.8, 0, 0.4), 0.22, False),
        ("rear_light", (-2.2, -0.4, 2.8), (0.3, 0, 0.6), 0.20, False),
    ):
        spec.worldbody.add_light(
            name=name,
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=position,
            dir=np.subtract(target, position),
            diffuse=[strength] * 3,
            specular=[0.4 * strength] * 3,
            castshadow=shadow,
        )


def _set_visuals(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.86, 0.89, 0.92],
        rgb2=[0.55, 0.60, 0.66],
        width=256,
        height=1536,
    )
    spec.visual.headlight.ambient = [0.34, 0.34, 0.34]
    spec.visual.headlight.diffuse = [0.32, 0.32, 0.32]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.visual.map.znear = 0.005
    spec.visual.map.zfar = 30
    spec.visual.map.shadowclip = 2.5  # times the extent: the whole cell casts shadows
    spec.visual.quality.shadowsize = 4096
    spec.stat.extent = 1.5
    spec.stat.center = [0.6, 0, 0.5]

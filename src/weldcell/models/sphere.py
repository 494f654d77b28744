"""The standard sphere on its stand: an exact sphere, not a polygon."""

import math

import mujoco

from weldcell.cell.errors import BadGeometry
from weldcell.models.finishes import FINISHES
from weldcell.models.mesh_body import BLACK, DARK_GREY, GROUP_PARTS, PART_MASK, Piece, add_pieces
from weldcell.models.shapes import join, rod


def sphere_stand(
    radius_m: float, centre_height_m: float = 0.130, crank_m: float = 0.085, post_radius_m: float = 0.005
) -> mujoco.MjSpec:
    """Body `sphere_stand` with the geom `standard_sphere` centred at its origin, z up.

    The foot stands `centre_height_m` below the centre and `crank_m` behind it (-x), so that the sphere can hang
    over the edge of a part; straight ahead of the upper three quarters of its height nothing stands in the way.
    """
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise BadGeometry(f"sphere: expected a positive radius, found {radius_m} m")
    if centre_height_m < 2 * radius_m + 0.02 or crank_m < 0 or not 0 < post_radius_m < 0.6 * radius_m:
        raise BadGeometry(
            f"sphere: expected the centre above {2 * radius_m + 0.02:.3g} m and a post thinner than 0.6 radii, "
            f"found {centre_height_m} m and {post_radius_m} m"
        )
    spec = mujoco.MjSpec()
    spec.modelname = "sphere_stand"
    body = spec.worldbody.add_body(name="sphere_stand")
    body.add_geom(
        name="standard_sphere",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius_m, 0, 0],
        material=_material(spec),
        rgba=FINISHES["matt-white"].rgba,
        group=GROUP_PARTS,
        contype=PART_MASK.contype,
        conaffinity=PART_MASK.conaffinity,
        mass=0,
    )
    add_pieces(
        spec,
        body,
        _stand_pieces(radius_m, centre_height_m, crank_m, post_radius_m),
        group=GROUP_PARTS,
        mask=PART_MASK,
    )
    return spec


def _stand_pieces(radius_m: float, height_m: float, crank_m: float, post_m: float) -> list[Piece]:
    """Stem under the sphere, arm backwards, post and foot; each straight, so that its hull is itself."""
    arm_z = -(radius_m + 7.6 * post_m)
    foot = join(
        [
            rod((-crank_m, 0, -height_m), (-crank_m, 0, 0.018 - height_m), 0.030, edge=0.003),
            rod((-crank_m, 0, 0.016 - height_m), (-crank_m, 0, 0.026 - height_m), 0.014, edge=0.002),
        ]
    )
    stem = rod((0, 0, arm_z), (0, 0, -0.9 * radius_m), post_m, edge=0.001, segments=24)
    post = rod((-crank_m, 0, 0.02 - height_m), (-crank_m, 0, arm_z), post_m, edge=0.001, segments=24)
    pieces = [
        Piece(name="sphere_foot", solid=foot, finish=DARK_GREY),
        Piece(name="sphere_stem", solid=stem, finish=BLACK),
    ]
    if crank_m > 0:
        arm = rod((-crank_m - post_m, 0, arm_z), (post_m, 0, arm_z), post_m, edge=0.001, segments=24)
        pieces += [
            Piece(name="sphere_arm", solid=arm, finish=BLACK),
            Piece(name="sphere_post", solid=post, finish=BLACK),
        ]
    else:
        pieces[1] = Piece(name="sphere_stem", solid=join([stem, post]), finish=BLACK)
    return pieces


def _material(spec: mujoco.MjSpec) -> str:
    """Matt ceramic, as spheres for optical sensors are."""
    finish = FINISHES["matt-white"]
    material = spec.add_material(
        name="standard_sphere/matt-white", rgba=finish.rgba, specular=finish.specular, shininess=finish.shininess
    )
    return str(material.name)

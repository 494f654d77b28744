"""The shapes of the arm's links: castings, motors, wrist and cables in the look of a small welding robot.

Only the axes are a real robot's (see `arm.KR5_ARC`); all outer forms are our own. Each function returns the
pieces of one link in that link's frame at the ortho-parallel zero (arm stretched upwards, x forward).
"""

import numpy as np
from manifold3d import Manifold

from weldcell.models.mesh_body import BLACK, DARK_GREY, LIGHT_GREY, ORANGE, STEEL, Piece
from weldcell.models.shapes import bezier, bolt_circle, box, chain, hose, hull, join, place, rod, turned

ARM_SIDE_Y_M = 0.058  # the lower arm runs beside the shoulder, on its left, from here outwards


def base_pieces(c1_m: float) -> list[Piece]:
    """Foot plate with bolts, conical column, connector box; the origin is on the floor, z up."""
    plate = join(
        [
            box((-0.185, -0.185, 0), (0.185, 0.185, 0.022), 0.006),
            rod((0, 0, 0.01), (0, 0, 0.04), 0.175, edge=0.008),
        ]
    )
    collar_m = c1_m - 0.215
    column = turned(
        [
            (0, 0.02), (0.168, 0.02), (0.162, 0.045), (0.146, 0.075), (0.138, 0.11),
            (0.138, collar_m - 0.03), (0.150, collar_m - 0.012), (0.150, collar_m), (0, collar_m),
        ]
    )  # fmt: skip
    ribs = join(
        hull(
            [
                box((0.10, -0.009, 0.02), (0.172, 0.009, 0.034), 0.003),
                box((0.10, -0.009, 0.03), (0.14, 0.009, 0.12), 0.003),
            ]
        ).rotate((0, 0, angle))
        for angle in (45, 135, 225, 315)
    )
    connectors = join(
        [
            box((-0.245, -0.075, 0.03), (-0.11, 0.075, 0.135), 0.008),
            *(rod((-0.275, y, 0.095), (-0.24, y, 0.095), 0.017, edge=0.003) for y in (-0.045, 0.0)),
            rod((-0.285, 0.045, 0.095), (-0.24, 0.045, 0.095), 0.022, edge=0.003),
        ]
    )
    bolts = join(
        rod((x, y, 0.02), (x, y, 0.036), 0.0125, edge=0.002, segments=12) for x in (-0.16, 0.16) for y in (-0.16, 0.16)
    )
    return [
        Piece(name="base_casting", solid=join([plate, column, ribs]), finish=ORANGE),
        Piece(name="base_connectors", solid=connectors, finish=DARK_GREY),
        Piece(name="base_bolts", solid=bolts, finish=STEEL),
    ]


def carousel_pieces(a1_m: float) -> list[Piece]:
    """Link 1: turntable, shoulder with the bearing of axis 2 at (a1, 0, 0), motors of axes 1 and 2."""
    turntable = join(
        [
            rod((0, 0, -0.212), (0, 0, -0.165), 0.158, edge=0.010),
            rod((0, 0, -0.17), (0, 0, -0.13), 0.150, edge=0.010, end_radius=0.128),
        ]
    )
    shoulder = chain(
        [
            rod((-0.02, 0, -0.15), (-0.02, 0, -0.10), 0.125, edge=0.012),
            rod((0.065, -0.072, -0.075), (0.065, 0.050, -0.075), 0.095, edge=0.016),
            rod((a1_m, -0.075, 0), (a1_m, 0.052, 0), 0.094, edge=0.014),
        ]
    )
    rear = hull(
        [
            rod((-0.095, 0, -0.155), (-0.095, 0, -0.06), 0.075, edge=0.010),
            rod((-0.02, 0, -0.155), (-0.02, 0, -0.055), 0.085, edge=0.012),
        ]
    )
    cover = bolt_circle((a1_m, -0.075, 0), (0, -1, 0), radius=0.08, count=10, bolt=0.006, height=0.005)
    turntable_bolts = bolt_circle((0, 0, -0.132), (0, 0, 1), radius=0.138, count=12, bolt=0.007, height=0.008)
    motors = join(
        [
            _motor((-0.095, 0, -0.06), (0, 0, 1), radius=0.056, length=0.19),
            _motor((a1_m, -0.075, 0), (0, -1, 0), radius=0.062, length=0.185),
        ]
    )
    lead = hose(bezier([(-0.16, 0.03, -0.10), (-0.26, 0.05, 0.02), (-0.2, 0.1, -0.25), (-0.15, 0.11, -0.19)]), 0.011)
    return [
        Piece(name="carousel_casting", solid=join([turntable, shoulder, rear]), finish=ORANGE),
        Piece(name="carousel_motors", solid=motors, finish=DARK_GREY),
        Piece(name="carousel_bolts", solid=join([cover, turntable_bolts]), finish=STEEL),
        Piece(name="carousel_lead", solid=lead, finish=BLACK),
    ]


def lower_arm_pieces(c2_m: float) -> list[Piece]:
    """Link 2: a curved casting from axis 2 (the origin) to axis 3 at (0, 0, c2), beside the shoulder."""
    y = ARM_SIDE_Y_M
    stations = [  # x, z, radius, width across y: the arm bows backwards and slims in the middle
        (0.0, 0.0, 0.098, 0.080),
        (-0.026, 0.12 * c2_m / 0.6, 0.076, 0.078),
        (-0.040, 0.26 * c2_m / 0.6, 0.064, 0.074),
        (-0.036, 0.40 * c2_m / 0.6, 0.060, 0.070),
        (-0.018, 0.52 * c2_m / 0.6, 0.066, 0.068),
        (0.0, c2_m, 0.080, 0.068),
    ]
    casting = chain([rod((x, y, z), (x, y + width, z), radius, edge=0.016) for x, z, radius, width in stations])
    groove = chain(
        [
            rod((x, y + width - 0.009, z), (x, y + 0.2, z), 0.55 * radius, edge=0.003)
            for x, z, radius, width in stations[1:5]
        ]
    )
    counterweight = hull(
        [
            rod((0, y + 0.006, -0.02), (0, y + 0.066, -0.02), 0.085, edge=0.014),
            rod((0.012, y + 0.010, -0.105), (0.012, y + 0.060, -0.105), 0.042, edge=0.014),
        ]
    )
    caps = join(
        [
            rod((0, y + 0.07, 0), (0, y + 0.092, 0), 0.074, edge=0.008),
            rod((0, y + 0.06, c2_m), (0, y + 0.079, c2_m), 0.058, edge=0.007),
        ]
    )
    bolts = join(
        [
            bolt_circle((0, y + 0.078, 0), (0, 1, 0), radius=0.086, count=12, bolt=0.0055, height=0.007),
            bolt_circle((0, y + 0.066, c2_m), (0, 1, 0), radius=0.069, count=10, bolt=0.005, height=0.007),
        ]
    )
    lead_y = y + 0.016
    lead = hose(
        np.concatenate(
            [
                bezier([(-0.05, lead_y, -0.08), (-0.15, lead_y, 0.0), (-0.14, lead_y, 0.12), (-0.118, lead_y, 0.24)]),
                bezier(
                    [(-0.117, lead_y, 0.25), (-0.10, lead_y, 0.36), (-0.12, lead_y, 0.46), (-0.06, lead_y, c2_m - 0.02)]
                ),
            ]
        ),
        0.013,
    )
    clamps = join(box((-0.135, y + 0.004, z), (-0.07, y + 0.034, z + 0.022), 0.004) for z in (0.17, 0.37))
    return [
        Piece(name="lower_arm_casting", solid=join([casting - groove, counterweight]), finish=ORANGE),
        Piece(name="lower_arm_caps", solid=caps, finish=DARK_GREY),
        Piece(name="lower_arm_bolts", solid=bolts, finish=STEEL),
        Piece(name="lower_arm_lead", solid=join([lead, clamps]), finish=BLACK),
    ]


def elbow_pieces(a2_m: float) -> list[Piece]:
    """Link 3: elbow casting about axis 3 (the origin, along y), motors of axes 3 to 6, cable hump.

    The upper arm's axis runs along z through x = a2.
    """
    side = ARM_SIDE_Y_M - 0.004
    hub = rod((0, -0.070, 0), (0, side, 0), 0.080, edge=0.012)
    barrel = rod((a2_m, 0, -0.075), (a2_m, 0, 0.125), 0.078, edge=0.012)
    nose = rod((a2_m, 0, 0.11), (a2_m, 0, 0.195), 0.074, edge=0.010, end_radius=0.060)
    casting = join(
        [
            hull([hub, rod((a2_m + 0.01, -0.06, 0.015), (a2_m + 0.01, 0.05, 0.015), 0.066, edge=0.02)]),
            barrel,
            hull(
                [
                    rod((a2_m, 0, -0.04), (a2_m, 0, 0.10), 0.076, edge=0.012),
                    rod((-0.03, -0.055, 0.0), (-0.03, 0.045, 0.0), 0.072, edge=0.02),
                ]
            ),
            nose,
        ]
    )
    motors = join(
        [
            _motor((0, -0.07, 0), (0, -1, 0), radius=0.052, length=0.150),
            *(
                _motor((a2_m + 0.037 * np.cos(a), 0.037 * np.sin(a), -0.07), (0, 0, -1), radius=0.031, length=length)
                for a, length in ((np.pi, 0.14), (np.pi / 3, 0.115), (-np.pi / 3, 0.115))
            ),
        ]
    )
    hump = hull(
        [
            box((a2_m - 0.105, -0.042, -0.04), (a2_m - 0.055, 0.042, 0.105), 0.012),
            box((a2_m - 0.075, -0.05, -0.055), (a2_m - 0.04, 0.05, 0.12), 0.012),
        ]
    )
    bolts = join(
        [
            bolt_circle((0, -0.070, 0), (0, -1, 0), radius=0.068, count=10, bolt=0.005, height=0.005),
            bolt_circle((a2_m, 0, 0.19), (0, 0, 1), radius=0.054, count=8, bolt=0.004, height=0.006),
        ]
    )
    return [
        Piece(name="elbow_casting", solid=casting, finish=ORANGE),
        Piece(name="elbow_motors", solid=motors, finish=DARK_GREY),
        Piece(name="elbow_hump", solid=hump, finish=DARK_GREY),
        Piece(name="elbow_bolts", solid=bolts, finish=STEEL),
    ]


def upper_arm_pieces(c3_m: float) -> list[Piece]:
    """Link 4: slim tube from the elbow to the fork of axis 5; the origin is the wrist's centre, z forward."""
    back = 0.205 - c3_m
    tube = chain(
        [
            rod((0, 0, back), (0, 0, back + 0.03), 0.059, edge=0.008),
            rod((0, 0, back + 0.05), (0, 0, back + 0.09), 0.052, edge=0.008),
            rod((0, 0, -0.14), (0, 0, -0.11), 0.043, edge=0.008),
        ]
    )
    shoulder = hull(
        [rod((0, 0, -0.14), (0, 0, -0.115), 0.043), box((-0.034, -0.062, -0.105), (0.034, 0.062, -0.075), 0.012)]
    )
    cheeks = join(
        hull(
            [
                box((-0.034, min(y0, y1), -0.105), (0.034, max(y0, y1), -0.06), 0.008),
                rod((0, min(y0, y1), 0), (0, max(y0, y1), 0), 0.043, edge=0.007),
            ]
        )
        for y0, y1 in ((0.042, 0.066), (-0.042, -0.066))
    )
    caps = join(
        [
            rod((0, 0.062, 0), (0, 0.073, 0), 0.033, edge=0.004),
            rod((0, -0.073, 0), (0, -0.062, 0), 0.033, edge=0.004),
            rod((0, 0, back - 0.006), (0, 0, back + 0.004), 0.052, edge=0.002),
        ]
    )
    return [
        Piece(name="upper_arm_casting", solid=join([tube, shoulder, cheeks]), finish=ORANGE),
        Piece(name="upper_arm_caps", solid=caps, finish=DARK_GREY),
    ]


def wrist_pieces() -> list[Piece]:
    """Link 5: the light wrist between the fork's cheeks; the origin is its centre, axis 5 along y."""
    body = join(
        [
            rod((0, -0.040, 0), (0, 0.040, 0), 0.042, edge=0.008),
            hull(
                [
                    rod((0, -0.034, 0), (0, 0.034, 0), 0.040, edge=0.01),
                    rod((0, 0, 0.05), (0, 0, 0.072), 0.036, edge=0.004),
                ]
            ),
            rod((0, 0, 0.06), (0, 0, 0.088), 0.034, edge=0.003),
        ]
    )
    return [Piece(name="wrist_casting", solid=body, finish=LIGHT_GREY)]


def flange_pieces(c4_m: float) -> list[Piece]:
    """Link 6: the flange disc with its bolts and pin; the origin is the wrist's centre."""
    disc = join(
        [
            rod((0, 0, 0.086), (0, 0, c4_m - 0.010), 0.030, edge=0.002),
            rod((0, 0, c4_m - 0.014), (0, 0, c4_m), 0.0375, edge=0.002),
        ]
    )
    bolts = bolt_circle((0, 0, c4_m - 0.014), (0, 0, -1), radius=0.0335, count=6, bolt=0.003, height=0.004)
    return [
        Piece(name="flange_disc", solid=disc, finish=STEEL),
        Piece(name="flange_bolts", solid=bolts, finish=DARK_GREY),
    ]


def _motor(
    origin: tuple[float, float, float], z: tuple[float, float, float], *, radius: float, length: float
) -> Manifold:
    """A servo motor: round flange, ribbed housing, encoder cap, plug."""
    outline = [(0.0, -0.004), (1.14 * radius, -0.004), (1.16 * radius, -0.002), (1.16 * radius, 0.013)]
    outline += [(1.13 * radius, 0.016), (0.93 * radius, 0.016)]
    for start in np.linspace(0.14, 0.58, 4) * length:  # four ribs
        rib = 0.075 * length
        outline += [
            (0.93 * radius, start),
            (radius, start + 0.003),
            (radius, start + rib),
            (0.93 * radius, start + rib + 0.003),
        ]
    outline += [(0.93 * radius, 0.71 * length), (0.86 * radius, 0.725 * length), (0.86 * radius, 0.94 * length)]
    outline += [(0.82 * radius, 0.98 * length), (0.74 * radius, length), (0.0, length)]
    housing = place(turned(outline, 36 if radius > 0.04 else 20), origin, z)
    axis = np.asarray(z, float)
    foot = np.asarray(origin, float) + 0.8 * length * axis
    side = np.cross(axis, [0, 1, 0]) if abs(axis[1]) < 0.9 else np.array([0.0, 0, 1])
    plug = rod(foot, foot + side * (radius + 0.020), min(0.012, 0.35 * radius), edge=0.003, segments=20)
    return housing + plug

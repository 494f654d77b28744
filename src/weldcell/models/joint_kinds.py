"""Cross-sections of joints in ISO 9692-1's terms: the members' outlines and the exact places of the features.

A section lies in the plane perpendicular to the seam: its first axis points to the left of travel, the second upright;
its origin is on the path, at the underside of the lower (or right) member. All grooves are those of ISO 9692-1:

    butt            both sides square
    v, v-gap        both sides lean by half the groove angle above the root face
    bevel           the left side leans by the groove angle, the right one is square
    u               both sides rise from the root face by an arc of the root radius that starts level, then lean by half
                    the groove angle
    j               the left side as of a U with the whole groove angle, the right one square
    corner          two plates that fall away at half the supplement of the corner angle, a V between their edges
    lap             the upper plate lies on the left; fillet: the web stands on the left

A height mismatch raises the left member (negative: the right one). A `root` (of a U: `centre`) lies midway between the
root edges of both members; without gap and mismatch that is the bottom of the groove. The gap of lap and fillet lies
between the plates, below the `root`, which is on the lower plate under the upper one's side.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadGeometry
from weldcell.models.chords import arc
from weldcell.models.joint_section import (
    Bar,
    FullPlate,
    JointKind,
    JointSection,
    JointSize,
    Member,
    PlateEdge,
    TackShape,
)

SECTION_CHORD_M = 2e-6
"""The polygons of rounded sections stray from their arcs by less than this."""
_LARGEST_SIZE_M = 10.0


def joint_section(kind: JointKind, size: JointSize, may_close: bool = False) -> JointSection:
    """The section of a joint of this kind and size; refuses sizes that no such joint has.

    A joint that lives by its gap may be closed (`may_close`) only where another section goes over into this one.
    """
    _check(kind, size)
    if (
        kind in ("butt", "v-gap")
        and size.root_gap_m == 0
        and not may_close
        and (kind == "v-gap" or not size.mismatch_m)
    ):
        more = " (or a mismatch_m): nothing shows a closed joint" if kind == "butt" else ""
        raise BadGeometry(f"{kind}: root_gap_m is 0, expected a gap{more}")
    return _SECTIONS[kind](kind, size)


def _check(kind: JointKind, size: JointSize) -> None:
    if kind not in _SECTIONS:
        raise BadGeometry(f"joint: {kind!r} is not a kind of joint. Available: {', '.join(_SECTIONS)}")
    for name, value in vars(size).items():
        if not np.isfinite(value) or abs(value) > _LARGEST_SIZE_M:
            raise BadGeometry(f"{kind}: {name} is {value}, expected a finite number up to {_LARGEST_SIZE_M}")
        if value < 0 and name != "mismatch_m":
            raise BadGeometry(f"{kind}: {name} is {value}, expected it not negative")
    if size.thickness_m <= 0:
        raise BadGeometry(f"{kind}: thickness_m is {size.thickness_m}, expected it positive")
    if abs(size.mismatch_m) >= size.thickness_m:
        raise BadGeometry(f"{kind}: mismatch_m is {size.mismatch_m}, expected less than the thickness")


# Grooves between the edges of two plates


def _butt(kind: JointKind, size: JointSize) -> JointSection:
    edge = _square_edge(size)
    return _groove(kind, size, edge, edge, None)


def _v(kind: JointKind, size: JointSize) -> JointSection:
    _check_groove(kind, size)
    edge = _leaning_edge(size, size.groove_angle_rad / 2)
    return _groove(kind, size, edge, edge, "root")


def _bevel(kind: JointKind, size: JointSize) -> JointSection:
    _check_groove(kind, size, np.pi / 2)
    return _groove(kind, size, _leaning_edge(size, size.groove_angle_rad), _square_edge(size), "root")


def _u(kind: JointKind, size: JointSize) -> JointSection:
    _check_groove(kind, size)
    edge = _rounded_edge(kind, size, size.groove_angle_rad / 2)
    return _groove(kind, size, edge, edge, "centre")


def _j(kind: JointKind, size: JointSize) -> JointSection:
    _check_groove(kind, size, np.pi / 2)
    return _groove(kind, size, _rounded_edge(kind, size, size.groove_angle_rad), _square_edge(size), "root")


def _check_groove(kind: JointKind, size: JointSize, widest_rad: float = np.pi) -> None:
    if not (0 < size.groove_angle_rad < widest_rad or (kind in ("u", "j") and size.groove_angle_rad == 0)):
        raise BadGeometry(
            f"{kind}: groove_angle_rad is {size.groove_angle_rad:.4g} ({np.rad2deg(size.groove_angle_rad):.4g} deg), "
            f"expected 0 to {np.rad2deg(widest_rad):.0f} deg"
        )
    if size.root_face_m >= size.thickness_m:
        raise BadGeometry(
            f"{kind}: root_face_m is {size.root_face_m}, expected a root face below the thickness ({size.thickness_m})"
        )
    if size.root_gap_m == 0 and size.root_face_m <= abs(size.mismatch_m):
        raise BadGeometry(
            f"{kind}: root_face_m is {size.root_face_m} without a root gap, expected more than the mismatch "
            f"({abs(size.mismatch_m)}): the part falls apart along a line"
        )


def _square_edge(size: JointSize) -> Float[np.ndarray, "k 2"]:
    half_gap = size.root_gap_m / 2
    return np.array([(half_gap, 0.0), (half_gap, size.thickness_m)])


def _leaning_edge(size: JointSize, lean_rad: float) -> Float[np.ndarray, "k 2"]:
    half_gap, face, depth = size.root_gap_m / 2, size.root_face_m, size.thickness_m - size.root_face_m
    land = [(half_gap, 0.0)] if face > 0 else []
    return np.array([*land, (half_gap, face), (half_gap + depth * np.tan(lean_rad), size.thickness_m)])


def _rounded_edge(kind: JointKind, size: JointSize, lean_rad: float) -> Float[np.ndarray, "k 2"]:
    half_gap, face, radius = size.root_gap_m / 2, size.root_face_m, size.root_radius_m
    depth = size.thickness_m - face
    if radius <= 0 or radius * (1 - np.sin(lean_rad)) >= depth:
        raise BadGeometry(
            f"{kind}: root_radius_m is {radius}, expected more than 0 and a bottom that ends below the upper side "
            f"(root_radius_m < {depth / (1 - np.sin(lean_rad)):.4g})"
        )
    bottom = arc((half_gap, face + radius), radius, -np.pi / 2, -lean_rad, SECTION_CHORD_M)
    bottom[0] = half_gap, face
    above = size.thickness_m - bottom[-1, 1]
    land = [(half_gap, 0.0)] if face > 0 else []
    return np.array([*land, *bottom, (bottom[-1, 0] + above * np.tan(lean_rad), size.thickness_m)])


def _groove(
    kind: JointKind,
    size: JointSize,
    left_edge: Float[np.ndarray, "k 2"],
    right_edge: Float[np.ndarray, "m 2"],
    middle: str | None,
) -> JointSection:
    """The groove between two edges (both given as if on the left), with the higher member raised."""
    rise = max(size.mismatch_m, 0.0), max(-size.mismatch_m, 0.0)
    left, right = left_edge + [0, rise[0]], right_edge * [-1, 1] + [0, rise[1]]
    root_z = size.root_face_m + abs(size.mismatch_m) / 2
    features = {"left": left[-1], "right": right[-1]}
    if middle is not None:
        features = {"left": left[-1], middle: np.array([0.0, root_z]), "right": right[-1]}
    up = np.array([0.0, 1.0])
    low = root_z + 0.4 * (size.thickness_m - root_z) if middle is None else root_z / 2
    tack = _filling(left, right, low, root_z, min(left[-1, 1], right[-1, 1]))
    members = (PlateEdge(side=1, edge=left), PlateEdge(side=-1, edge=right))
    return JointSection(kind=kind, members=members, features=features, approach=up, tack=tack)


def _filling(
    left: Float[np.ndarray, "k 2"], right: Float[np.ndarray, "m 2"], low_z: float, root_z: float, high_z: float
) -> TackShape:
    """A tack between two walls, up to half a millimetre into them, up to half the groove's depth in its middle."""
    depth = high_z - root_z
    side_z, into = root_z + 0.45 * depth, min(5e-4, 0.1 * depth)
    low_z = max(low_z, root_z - 0.1 * depth)
    sides = [np.interp(side_z, wall[:, 1], wall[:, 0]) for wall in (left, right)]
    across = np.linspace(sides[0] + into, sides[1] - into, 9)
    middle, half = across[4], (across[0] - across[-1]) / 2
    crown = min(0.15 * half, 0.2 * depth) * (1 - ((across - middle) / half) ** 2)
    bottom = np.array([(across[-1], low_z), (across[0], low_z)])
    full = np.vstack([bottom, np.column_stack([across, side_z + crown])])
    seed = np.vstack([bottom, np.column_stack([across, np.full(9, low_z + 0.02 * depth)])])
    return TackShape(seed=seed, full=full)


# Joints of plates that lie or stand on one another


def _lap(kind: JointKind, size: JointSize) -> JointSection:
    _check_no_mismatch(kind, size)
    lower, upper = size.thickness_m, size.upper_thickness_m or size.thickness_m
    foot, edge = lower + size.root_gap_m, lower + size.root_gap_m + upper
    members = (
        FullPlate(low_m=0.0, high_m=lower),
        PlateEdge(side=1, edge=np.array([(0.0, foot), (0.0, edge)])),
    )
    features = {"edge": np.array([0.0, edge]), "root": np.array([0.0, lower])}
    return _between_walls(kind, members, features, size, 0.6 * upper + size.root_gap_m)


def _fillet(kind: JointKind, size: JointSize) -> JointSection:
    _check_no_mismatch(kind, size)
    lower, web = size.thickness_m, size.upper_thickness_m or size.thickness_m
    if size.rise_m <= 0:
        raise BadGeometry(f"{kind}: rise_m is {size.rise_m}, expected a web of positive height")
    foot = lower + size.root_gap_m
    top = foot + size.rise_m
    outline = np.array([(0.0, foot), (web, foot), (web, top), (0.0, top)])
    members = (FullPlate(low_m=0.0, high_m=lower), Bar(outline=outline))
    leg = min(0.5 * min(web, lower), 0.5 * size.rise_m) + size.root_gap_m
    return _between_walls(kind, members, {"root": np.array([0.0, lower])}, size, leg)


def _check_no_mismatch(kind: JointKind, size: JointSize) -> None:
    if size.mismatch_m != 0:
        raise BadGeometry(f"{kind}: mismatch_m is {size.mismatch_m}, expected 0: this joint has none")


def _between_walls(
    kind: JointKind,
    members: tuple[Member, ...],
    features: dict[str, Float[np.ndarray, "2"]],
    size: JointSize,
    leg: float,
) -> JointSection:
    """A joint with a wall on the left and a floor on the right of the root, tacked by a fillet with this leg."""
    into = 0.3 * min(size.thickness_m, size.upper_thickness_m or size.thickness_m)
    root = np.array([0.0, size.thickness_m])

    def outline(reach: float) -> Float[np.ndarray, "k 2"]:
        turn = np.linspace(0, np.pi / 2, 9)
        face = 0.75 * reach * np.column_stack([-np.sin(turn), np.cos(turn)]) + 0.25 * reach * np.column_stack(
            [-(turn / (np.pi / 2)), 1 - turn / (np.pi / 2)]
        )
        return root + np.vstack([[(-reach, -into), (into, -into), (into, reach)], face])

    approach = np.array([-np.sqrt(0.5), np.sqrt(0.5)])
    tack = TackShape(seed=outline(0.02 * leg), full=outline(leg))
    return JointSection(kind=kind, members=members, features=features, approach=approach, tack=tack)


def _corner(kind: JointKind, size: JointSize) -> JointSection:
    """Two plates that lean on each other like a roof; the V's depth D follows from their thickness t.

    With the plates falling at b, walls leaning at a and a root face f, the outer edge lies at (D tan a, D) from the
    root and t off the inner side: D tan a sin b + (D + f) cos b = t.
    """
    fall, lean = (np.pi - size.corner_angle_rad) / 2, size.groove_angle_rad / 2
    if not np.deg2rad(30) <= size.corner_angle_rad <= np.deg2rad(150):
        raise BadGeometry(
            f"corner: corner_angle_rad is {size.corner_angle_rad:.4g} "
            f"({np.rad2deg(size.corner_angle_rad):.4g} deg), expected 30 to 150 deg"
        )
    _check_groove(kind, size)
    depth = (size.thickness_m - size.root_face_m * np.cos(fall)) / (np.tan(lean) * np.sin(fall) + np.cos(fall))
    if depth <= 0 or size.rise_m <= size.thickness_m:
        raise BadGeometry(
            f"corner: rise_m is {size.rise_m} and root_face_m {size.root_face_m}, expected plates longer than thick "
            f"({size.thickness_m}) and room for a groove above the root face"
        )
    half_gap, inner_z = size.root_gap_m / 2, size.rise_m * np.sin(fall)
    root_z = inner_z + size.root_face_m
    edge = np.array([half_gap + depth * np.tan(lean), root_z + depth])
    land = [(half_gap, inner_z)] if size.root_face_m > 0 else []
    wall = np.array([*land, (half_gap, root_z), edge])
    outer_foot = (edge[0] + edge[1] / np.tan(fall), 0.0)
    plate = np.array([(half_gap + size.rise_m * np.cos(fall), 0.0), outer_foot, edge, *wall[:-1][::-1]])
    rise = max(size.mismatch_m, 0.0), max(-size.mismatch_m, 0.0)
    members = (Bar(outline=plate + [0, rise[0]]), Bar(outline=plate[::-1] * [-1, 1] + [0, rise[1]]))
    root = np.array([0.0, root_z + abs(size.mismatch_m) / 2])
    features = {"left": edge + [0, rise[0]], "root": root, "right": edge * [-1, 1] + [0, rise[1]]}
    left, right = wall + [0, rise[0]], wall * [-1, 1] + [0, rise[1]]
    low_z = root[1] - size.root_face_m / 2
    tack = _filling(left, right, low_z, root[1], min(left[-1, 1], right[-1, 1]))
    return JointSection(kind=kind, members=members, features=features, approach=np.array([0.0, 1.0]), tack=tack)


_SECTIONS: dict[JointKind, Callable[[JointKind, JointSize], JointSection]] = {
    "butt": _butt,
    "v": _v,
    "v-gap": _v,
    "bevel": _bevel,
    "u": _u,
    "j": _j,
    "lap": _lap,
    "fillet": _fillet,
    "corner": _corner,
}

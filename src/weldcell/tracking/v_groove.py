"""The V-groove's features: left plate, left wall, right wall and right plate, and the corners between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from weldcell.tracking.candidates import (
    EXPLAINED_M,
    PLATE_LENGTH_M,
    best_of,
    is_near,
    mismatch_m,
    near_words,
    on_model,
    risen_words,
    share_of,
    uncertain_words,
)
from weldcell.tracking.curves import Curve, crossing_at, crossing_m, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.section import Corner, Section
from weldcell.tracking.v_root import open_root, stepped_root

V_NAMES = ("left", "root", "right")
_FEWEST_POINTS = 30
_TRIES = ((6.0, 12), (6.0, 6), (25.0, 6))  # dz/dx of 80 and 88 degrees, and neighbours that tell a stray
_MOST_PIECES = 16
_MOST_CANDIDATES = 12
_LEAST_EDGE_TURN_RAD = math.radians(10)
_LEAST_ROOT_TURN_RAD = math.radians(20)
_LEAST_DEPTH_M = 1e-3
_CORNER_SLACK_M = 1.5e-3  # a corner lies this close to the space between its two pieces
_GUARD_M = 4e-4  # about corners the stripe of both sides mixes: its window is five columns there
_GUARD_SHARE = 0.15
_FIT_ROUNDS = 3
_PLATE_DEGREE = 3
_FEWEST_ON_LINE = 6
_LEAST_INLIER_SHARE = 0.4
_LEAST_GROOVE_SHARE = 0.5
_MOST_RISEN_M = 7e-4
_WIDEST_GAP_M = 6e-3
_LEAST_MISMATCH_M = 1e-4


@dataclass(frozen=True, kw_only=True)
class VShape:
    """What distinguishes the joints that are made of plate, wall, wall and plate."""

    name: str
    """As reasons call it."""
    gapped: bool = False
    """With a root gap: the root is the middle between the walls' lower ends."""
    roof_rad: tuple[float, float] = (-math.radians(25), math.radians(25))
    """From the left plate to the right one, how far the profile turns into the depth, least and most."""


V = VShape(name="V-groove")
GAPPED_V = VShape(name="V-groove", gapped=True)
OUTSIDE_CORNER = VShape(name="corner joint", roof_rad=(math.radians(40), math.radians(140)))
"""Two plates that fall away on both sides, with an open V between their edges."""


def find_v(
    section: Section,
    previous_x_m: float | None = None,
    *,
    shape: VShape = V,
    previous_depth_m: float | None = None,
) -> Found:
    """The groove's left edge, root and right edge.

    The root is where the walls cross, seen or not; with a root gap the middle between their lower ends. With a mismatch
    it is midway between the members' root edges, one of which stands higher.
    With `previous_x_m` (x of the last root) only grooves with their root within 15 mm of it count.
    A gap that has risen above the last frame's depth is filled, as by a tack weld, and refused.
    """
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a {shape.name} (at least {_FEWEST_POINTS})")
    pieces: list[Piece] = []
    for steepest, neighbours in _TRIES:
        pieces = straight_pieces(section, steepest=steepest, neighbours=neighbours)
        best = _best_four(section, pieces, previous_x_m, shape)
        if best is not None:
            return _refined(section, best[0], shape, best[1], previous_depth_m)
    return Found(reason=f"no {shape.name}{near_words(previous_x_m)}: of {len(pieces)} straight pieces no four form one")


def _best_four(
    section: Section, pieces: list[Piece], previous_x_m: float | None, shape: VShape
) -> tuple[tuple[Piece, ...], float] | None:
    """The four pieces that form a V on whose lines the most points lie, and its margin."""
    pieces = sorted(sorted(pieces, key=lambda piece: -piece.count)[:_MOST_PIECES], key=lambda piece: piece.start_m)
    pairs = [pair for pair in combinations(pieces, 2) if _meets(*pair)]
    edges = [pair for pair in pairs if _turn(*pair) >= _LEAST_EDGE_TURN_RAD]
    roots = [pair for pair in pairs if _turn(*pair) <= -_LEAST_ROOT_TURN_RAD]
    fours = [
        (*left, *right)
        for root in roots
        for left in edges
        if left[1] is root[0]
        for right in edges
        if right[0] is root[1] and _forms_v((*left, *right), previous_x_m, shape)
    ]
    likely = sorted(fours, key=lambda four: -sum(piece.count for piece in four))[:_MOST_CANDIDATES]
    best = best_of([_explained_points(section, four) for four in likely], [_crossing_x(*four[1:3]) for four in likely])
    return None if best is None else (likely[best[0]], best[1])


def _meets(left: Piece, right: Piece) -> bool:
    """Whether the lines of two pieces cross in the space between them."""
    if abs(_turn(left, right)) < _LEAST_EDGE_TURN_RAD:
        return False
    return left.end_m - _CORNER_SLACK_M <= _crossing_x(left, right) <= right.start_m + _CORNER_SLACK_M


def _turn(left: Piece, right: Piece) -> float:
    """Angle by which the profile turns into the depth from one piece to the next."""
    return right.angle_rad - left.angle_rad


def _crossing_x(left: Piece, right: Piece) -> float:
    return (right.intercept_m - left.intercept_m) / (left.slope - right.slope)


def _forms_v(four: tuple[Piece, ...], previous_x_m: float | None, shape: VShape) -> bool:
    left, root, right = (_crossing_x(*pair) for pair in zip(four[:-1], four[1:], strict=True))
    if not left < root < right or not shape.roof_rad[0] <= _turn(four[0], four[3]) <= shape.roof_rad[1]:
        return False
    left_z, right_z = four[0].z_at(left), four[3].z_at(right)
    edges_z = left_z + (right_z - left_z) * (root - left) / (right - left)
    return is_near(root, previous_x_m) and four[1].z_at(root) - edges_z >= _LEAST_DEPTH_M


def _explained_points(section: Section, four: tuple[Piece, ...]) -> int:
    """Points that lie on the walls, or on as much of the plates as the fit will use."""
    left, root, right = (_crossing_x(*pair) for pair in zip(four[:-1], four[1:], strict=True))
    nodes_x = [max(four[0].start_m, left - PLATE_LENGTH_M), left, root, right]
    nodes_x.append(min(four[3].end_m, right + PLATE_LENGTH_M))
    nodes_z = [piece.z_at(x) for piece, x in zip((four[0], *four), nodes_x, strict=True)]
    about = section.between(nodes_x[0], nodes_x[-1])
    distance = np.abs(section.z_m[about] - np.interp(section.x_m[about], nodes_x, nodes_z))
    return int(np.count_nonzero(distance < EXPLAINED_M))


def _turns_like_v(curves: Sequence[Curve], corner_x: Sequence[float], shape: VShape) -> bool:
    """Down at the first edge, up at the root, level again at the last edge."""
    turns = [
        right.angle_at(x_m) - left.angle_at(x_m)
        for left, right, x_m in zip(curves[:-1], curves[1:], corner_x, strict=True)
    ]
    left, root, right = corner_x
    return bool(
        left < root < right
        and turns[0] >= _LEAST_EDGE_TURN_RAD
        and turns[1] <= -_LEAST_ROOT_TURN_RAD
        and turns[2] >= _LEAST_EDGE_TURN_RAD
        and shape.roof_rad[0] <= sum(turns) <= shape.roof_rad[1]
    )


def _refined(
    section: Section, four: tuple[Piece, ...], shape: VShape, margin: float, previous_depth_m: float | None
) -> Found:
    """The corners of curves fitted to all the section's own points between the corners."""
    corner_x = [_crossing_x(*pair) for pair in zip(four[:-1], four[1:], strict=True)]
    curves = [line_curve(piece.slope, piece.intercept_m) for piece in four]
    for turn in range(_FIT_ROUNDS):
        last = turn == _FIT_ROUNDS - 1
        fits = [
            fit_curve(
                section.only(section.between(start, end, ends=False)),
                curve,
                highest_degree=degree,
                rounds=3 if last else 2,
            )
            for curve, (start, end), degree in zip(
                curves,
                _spans(corner_x, four),
                (_PLATE_DEGREE, 1, 1, _PLATE_DEGREE) if last else (1, 1, 1, 1),
                strict=True,
            )
        ]
        complaint = _complaint(fits, shape)
        if complaint:
            return Found(reason=complaint)
        curves = [curve for curve in fits if curve is not None]
        crossed = [crossing_m(a, b, x_m) for a, b, x_m in zip(curves[:-1], curves[1:], corner_x, strict=True)]
        corner_x = [x_m for x_m in crossed if x_m is not None]
        if len(corner_x) < 3 or not _turns_like_v(curves, corner_x, shape):
            return Found(reason=f"no {shape.name}: the lines fitted to the pieces do not form one")
    corners = tuple(crossing_at(a, b, x_m) for a, b, x_m in zip(curves[:-1], curves[1:], corner_x, strict=True))
    explained = _explained_share(section, curves, four, corners)
    if explained < _LEAST_GROOVE_SHARE:
        return Found(reason=f"no {shape.name}: most points between its edges lie off its walls")
    measures = _measures(curves, corners)
    if shape.gapped:
        root = open_root(section, curves, corners, previous_depth_m)
        measures["gap_m"] = 0.0 if root is None else root.gap_m
        if root is not None:
            if root.filled:
                return Found(reason=f"no {shape.name}: something stands in its gap, such as a tack weld")
            if root.gap_m > _WIDEST_GAP_M:
                return Found(reason=f"no {shape.name}: its walls' ends are hidden, or {root.gap_m * 1e3:.0f} mm apart")
            complaint = risen_words(shape.name, root.seen_depth_m, previous_depth_m, _MOST_RISEN_M)
            if complaint:
                return Found(reason=complaint)
            corners = (corners[0], root.corner, corners[2])
            measures["depth_m"] = root.depth_m
    elif shape is V and abs(measures["mismatch_m"]) > _LEAST_MISMATCH_M:
        corners = (corners[0], stepped_root(section, curves, corners[1], measures["mismatch_m"]), corners[2])
    doubt = uncertain_words(shape.name, *corners)
    if doubt:
        return Found(reason=doubt)
    trust = Trust(explained=explained, margin=margin, support=min(curve.count for curve in curves))
    return Found(corners=corners[::-1], measures=measures, trust=trust)


def _measures(curves: Sequence[Curve], corners: Sequence[Corner]) -> dict[str, float]:
    """Groove angle, angle between the plates, the edges' distance, and how far the left plate stands above."""
    (first, _, last), left_wall, right_wall = corners, curves[1], curves[2]
    return {
        "groove_angle_rad": math.pi - (left_wall.angle_at(first.x_m) - right_wall.angle_at(last.x_m)),
        "plates_angle_rad": curves[3].angle_at(last.x_m) - curves[0].angle_at(first.x_m),
        "width_m": math.hypot(last.x_m - first.x_m, last.z_m - first.z_m),
        "mismatch_m": mismatch_m(curves[0], first, curves[3], last),
    }


def _explained_share(
    section: Section, curves: Sequence[Curve], four: tuple[Piece, ...], corners: Sequence[Corner]
) -> float:
    """Share of the points on the four curves: within the groove's own width on both sides, or between its edges."""
    first, root, last = (corner.x_m for corner in corners)
    ends = (max(four[0].start_m, first - (last - first)), min(four[3].end_m, last + (last - first)))
    nodes = (ends[0], first, root, last, ends[1])
    explained = on_model(section, list(zip(curves, nodes[:-1], nodes[1:], strict=True)))
    return min(share_of(explained[section.between(*span, ends=False)]) for span in (ends, (first, last)))


def _spans(corner_x: Sequence[float], four: tuple[Piece, ...]) -> list[tuple[float, float]]:
    """The x from which to which each line takes its points, clear of the corners."""
    left, root, right = corner_x
    left_guard, right_guard = (min(_GUARD_M, _GUARD_SHARE * width) for width in (root - left, right - root))
    return [
        (max(four[0].start_m, left - PLATE_LENGTH_M), left - left_guard),
        (left + left_guard, root - left_guard),
        (root + right_guard, right - right_guard),
        (right + right_guard, min(four[3].end_m, right + PLATE_LENGTH_M)),
    ]


def _complaint(lines: Sequence[Curve | None], shape: VShape) -> str:
    """Why these lines cannot be trusted; empty if they can."""
    for name, line in zip(("left plate", "left wall", "right wall", "right plate"), lines, strict=True):
        if line is None or line.count < _FEWEST_ON_LINE:
            return f"no {shape.name}: too few points on its {name}"
        if line.inlier_share < _LEAST_INLIER_SHARE:
            return f"no {shape.name}: only {line.inlier_share:.0%} of the points of its {name} lie on one line"
    return ""

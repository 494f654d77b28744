"""U and J grooves: plates fitted by themselves, the groove between them by its drawing.

The drawing is in the plates' own frame (s along them, d into the depth): a bottom at `depth`, a quarter circle of
`radius` that begins `half` beside the middle, and a straight wall that leaves the circle at its inclination. Noise
goes along one direction that is known for every point, so d(s) is a regression, and Levenberg-Marquardt with
Tukey's weights finds the drawing's numbers and their covariance. The edges are where the walls cross the plates.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float

from weldcell.tracking.candidates import (
    MOST_SIGMA_M,
    PLATE_LENGTH_M,
    as_deep,
    best_of,
    is_near,
    is_plate_pair,
    mirrored,
    near_words,
)
from weldcell.tracking.curve_end import PLATE_LOST_SHARE, curve_end
from weldcell.tracking.curves import Curve, fit_curve, flipped_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.groove_drawing import Drawing, fit_drawing
from weldcell.tracking.pieces import Piece, flipped_piece, straight_pieces
from weldcell.tracking.plates_frame import PlatesFrame, plates_frame
from weldcell.tracking.section import Corner, Section

U_NAMES = ("left", "centre", "right")
J_NAMES = ("left", "root", "right")
_STEEPEST, _NEIGHBOURS = 2.0, 12  # only the plates are looked for
_FEWEST_POINTS = 60
_FEWEST_ON_PLATE = 25
_LEAST_INLIER_SHARE = 0.4
_LEAST_PLATE_M = 3e-3
_WIDTH_M = (2e-3, 6e-2)
_LEAST_DEPTH_M = 1.5e-3
_GUARD_M = 4e-4
_BESIDE_M = 3e-3
_SURE_M = 1e-4  # a wall that tells its edge less well is as good as not seen
_EDGE_SLACK_M = 5e-4
_EDGES_APART_M = 3e-4
_LEAST_NATS = 10.0
_MOST_UNSEEN_M = 8e-3  # of a plate before its edge, if the wall tells that
_FEW_SEEN, _FEW_SEEN_SHARE = 2, 0.1  # of the columns in between: strays
_END_HIDDEN = 0.07  # share of plates' ends beside unseen walls that are no edges
_LOPSIDED_SHARE = 0.1
_FEWEST_BETWEEN = 15
_MOST_RISEN_M = 1.5e-3


@dataclass(frozen=True, kw_only=True)
class _Opening:
    """Two plates with something deeper between them."""

    right: Piece
    left: Piece

    @property
    def middle_m(self) -> float:
        return (self.right.end_m + self.left.start_m) / 2


def find_u(section: Section, previous_x_m: float | None = None, *, previous_depth_m: float | None = None) -> Found:
    """The U groove's left edge, the middle of its bottom, and its right edge.

    A groove that has become much shallower than the last frame's is filled, as by a tack weld, and refused.
    """
    return as_deep(_find(section, previous_x_m, "U groove", _u_groove), "U groove", previous_depth_m, _MOST_RISEN_M)


def find_j(section: Section, previous_x_m: float | None = None, *, previous_depth_m: float | None = None) -> Found:
    """The J groove's left edge, root and right edge, whichever plate has the J.

    The root is midway between the circle's end, at the depth of its bottom, and the other plate's square face; with a
    mismatch it is midway between both root edges in height as well. What is filled is refused as in a U.
    """
    return as_deep(_find(section, previous_x_m, "J groove", _j_groove), "J groove", previous_depth_m, _MOST_RISEN_M)


def _find(
    section: Section,
    previous_x_m: float | None,
    name: str,
    groove: Callable[[Section, "_Opening", tuple[Curve, Curve], float], Found],
) -> Found:
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a {name} (at least {_FEWEST_POINTS})")
    pieces = straight_pieces(section, steepest=_STEEPEST, neighbours=_NEIGHBOURS)
    found = [_opening(section, right, left) for right, left in combinations(pieces, 2)]
    openings = [one for one in found if one is not None and is_near(one.middle_m, previous_x_m)]
    chosen = best_of([_weight(section, one) for one in openings], [one.middle_m for one in openings])
    if chosen is None:
        return Found(reason=f"no {name}{near_words(previous_x_m)}: of {len(pieces)} straight pieces no two enclose one")
    best, margin = openings[chosen[0]], chosen[1]
    right = _plate(section, best.right, best.right.end_m)
    left = _plate(section, best.left, best.left.start_m)
    if right is None or left is None:
        return Found(reason=f"no {name}: too few points on one of its plates")
    return groove(section, best, (right, left), margin)


def _opening(section: Section, right: Piece, left: Piece) -> _Opening | None:
    if min(right.end_m - right.start_m, left.end_m - left.start_m) < _LEAST_PLATE_M or not is_plate_pair(right, left):
        return None
    if not _WIDTH_M[0] <= left.start_m - right.end_m <= _WIDTH_M[1]:
        return None
    one = _Opening(right=right, left=left)
    depths = _depths_between(section, one)
    if len(depths) < _FEWEST_BETWEEN or np.median(depths) < _LEAST_DEPTH_M:
        return None
    return one


def _depths_between(section: Section, one: _Opening) -> Float[np.ndarray, "k"]:
    """How far the points between two plates lie below them."""
    inside = (section.x_m > one.right.end_m) & (section.x_m < one.left.start_m)
    ends = [one.right.end_m, one.left.start_m]
    return section.z_m[inside] - np.interp(section.x_m[inside], ends, [one.right.z_at(ends[0]), one.left.z_at(ends[1])])


def _weight(section: Section, one: _Opening) -> float:
    """Points of the plates, and those between that lie below them."""
    plate_m = min(one.right.end_m - one.right.start_m, one.left.end_m - one.left.start_m, PLATE_LENGTH_M)
    depths = _depths_between(section, one)
    return plate_m / PLATE_LENGTH_M * 100 + float((depths > _GUARD_M).sum() - 2 * (depths <= _GUARD_M).sum())


def _plate(section: Section, piece: Piece, edge_m: float) -> Curve | None:
    """The plate's curve, within 20 mm of its edge."""
    low = max(piece.start_m, edge_m - PLATE_LENGTH_M) + (_GUARD_M if edge_m == piece.start_m else 0.0)
    high = min(piece.end_m, edge_m + PLATE_LENGTH_M) - (_GUARD_M if edge_m == piece.end_m else 0.0)
    part = section.only((section.x_m >= low) & (section.x_m <= high))
    curve = fit_curve(part, line_curve(piece.slope, piece.intercept_m), highest_degree=3)
    if curve is None or curve.count < _FEWEST_ON_PLATE or curve.inlier_share < _LEAST_INLIER_SHARE:
        return None
    return curve


def _u_groove(section: Section, opening: _Opening, plates: tuple[Curve, Curve], margin: float) -> Found:
    right_m, left_m = opening.right.end_m, opening.left.start_m
    frame = plates_frame(plates, right_m, left_m)
    inside = (section.x_m > right_m - _GUARD_M) & (section.x_m < left_m + _GUARD_M)
    part = frame.of(section.only(inside))
    below = part.z_m > _GUARD_M  # the plates' ends are known already
    s = (np.array([[right_m, plates[0].z_at(right_m)], [left_m, plates[1].z_at(left_m)]]) - frame.origin) @ frame.axes.T
    fitted = fit_drawing(
        part.only(below), float(s[0, 0]), float(s[1, 0]), sides=(True, True), higher_m=float(s[0, 1] - s[1, 1])
    )
    if isinstance(fitted, str):
        return Found(reason=f"no U groove: {fitted}")
    right = _edge(section, frame, plates[0], fitted, -1, right_m)
    left = _edge(section, frame, plates[1], fitted, 1, left_m)
    if right is None or left is None:
        return Found(reason="no U groove: its edges are not where its plates end")
    middle = frame.corner(fitted.middle_m, fitted.depth_m, float(np.sqrt(np.trace(fitted.covariance[:2, :2]))))
    corners = (left, middle, right)
    worst = max(corner.sigma_m for corner in corners)
    if worst > MOST_SIGMA_M:
        return Found(reason=f"U groove too uncertain: a corner has a standard deviation of {worst * 1e3:.2f} mm")
    measures = {
        "radius_m": fitted.radius_m,
        "groove_angle_rad": float(np.arctan(fitted.walls[0]) + np.arctan(fitted.walls[1])),
        "gap_m": 2 * fitted.half_m,
        "depth_m": fitted.depth_m,
        "width_m": float(np.hypot(left.x_m - right.x_m, left.z_m - right.z_m)),
        "mismatch_m": float(
            (right.z_m - left.z_m) * np.cos(frame.angle_rad) + (left.x_m - right.x_m) * np.sin(frame.angle_rad)
        ),
    }
    support = min(plates[0].count, plates[1].count, fitted.count)
    return Found(
        corners=corners, measures=measures, trust=Trust(explained=fitted.explained, margin=margin, support=support)
    )


def _edge(
    section: Section, frame: PlatesFrame, plate: Curve, drawing: Drawing, side: int, end_m: float
) -> Corner | None:
    """Where the wall of one side (1: larger s) crosses its plate; None if that is not where the plate ends.

    If too little of the wall is seen, the plate's end alone.
    """
    end = curve_end(section, plate, end_m + side * _BESIDE_M, end_m - side * _BESIDE_M)
    s_m, d_m = drawing.wall_at(side, 0.0), 0.0
    for _ in range(4):  # the plate is nearly level in this frame
        d_m = _plate_depth(frame, plate, s_m)
        s_m = drawing.wall_at(side, d_m)
    jacobian = drawing.wall_gradient(side, d_m)
    wall = drawing.walls[0 if side < 0 else 1]
    x_m = float(frame.origin[0] + s_m * frame.axes[0, 0])
    variance = float(jacobian @ drawing.covariance @ jacobian) + (1 + wall**2) * plate.variance_at(x_m)
    crossed = frame.corner(float(s_m), float(d_m), float(np.sqrt(variance)))
    sure = crossed.sigma_m <= _SURE_M
    if end is None or end.nats < _LEAST_NATS:
        return crossed if sure and abs(crossed.x_m - end_m) <= _EDGE_SLACK_M else None
    if not sure:
        return _in_the_dark(section, end.corner, -side)
    apart_m = side * (end.corner.x_m - crossed.x_m)  # positive where the plate stops short of the wall
    if abs(apart_m) <= max(_EDGES_APART_M, 4 * end.corner.sigma_m):
        return crossed
    return crossed if 0 < apart_m <= _MOST_UNSEEN_M and _is_dark(section, crossed.x_m, end.corner.x_m) else None


def _is_dark(section: Section, first_m: float, last_m: float) -> bool:
    """Whether next to nothing is seen between two x: a plate whose last stretch is hidden, not one that bends off."""
    spacing_m = float(np.median(np.diff(section.x_m)))
    low, high = sorted((first_m, last_m))
    seen = np.sum((section.x_m > low + spacing_m) & (section.x_m < high - spacing_m))
    return bool(seen <= max(_FEW_SEEN, _FEW_SEEN_SHARE * (high - low) / spacing_m))


def _in_the_dark(section: Section, end: Corner, towards: int) -> Corner:
    """A plate's end with no wall beside it: it may be hidden too, and the edge lie up to the next column that is seen.

    With the probability p that it is, anywhere within w, the mean square of what is missed is p w^2 / 3.
    """
    beyond_m = towards * (section.x_m - end.x_m)
    dark_m = float(beyond_m[beyond_m > 0].min(initial=np.inf))
    return replace(end, sigma_m=float(np.hypot(end.sigma_m, dark_m * np.sqrt(_END_HIDDEN / 3))))


def _plate_depth(frame: PlatesFrame, plate: Curve, s_m: float) -> float:
    """d of the plate at s."""
    d_m = 0.0
    for _ in range(3):
        x_m, z_m = frame.origin + np.array([s_m, d_m]) @ frame.axes
        d_m += (plate.z_at(float(x_m)) - z_m) * np.cos(frame.angle_rad)
    return float(d_m)


def _j_groove(section: Section, opening: _Opening, plates: tuple[Curve, Curve], margin: float) -> Found:
    """The way round that puts the deepest points beside the square face; both ways where that is not clear."""
    inside = (section.x_m > opening.right.end_m) & (section.x_m < opening.left.start_m)
    deep = inside & (section.z_m >= np.percentile(section.z_m[inside], 60))
    width_m = opening.left.start_m - opening.right.end_m
    aside = (float(np.median(section.x_m[deep])) - opening.middle_m) / width_m
    ways = [False, True] if abs(aside) < _LOPSIDED_SHARE else [aside > 0]
    found = [_j_one_way(section, opening, plates, margin, flipped) for flipped in ways]
    return max(found, key=lambda one: one.trust.explained if one.trust else 0.0)


def _j_one_way(section: Section, opening: _Opening, plates: tuple[Curve, Curve], margin: float, flipped: bool) -> Found:
    if not flipped:
        return _j_with_square_right(section, opening, plates, margin)
    turned = _Opening(right=flipped_piece(opening.left), left=flipped_piece(opening.right))
    turned_plates = (flipped_curve(plates[1]), flipped_curve(plates[0]))
    found = _j_with_square_right(mirrored(section), turned, turned_plates, margin)
    return replace(
        found,
        corners=tuple(replace(corner, x_m=-corner.x_m) for corner in found.corners[::-1]),
        measures={name: -value if name == "mismatch_m" else value for name, value in found.measures.items()},
    )


def _j_with_square_right(section: Section, opening: _Opening, plates: tuple[Curve, Curve], margin: float) -> Found:
    """A J groove whose square face is on the side of small x."""
    right_m, left_m = opening.right.end_m, opening.left.start_m
    end = curve_end(section, plates[0], right_m - _BESIDE_M, right_m + _BESIDE_M, lost_share=PLATE_LOST_SHARE)
    if end is None:
        return Found(reason="no J groove: its square edge has no end")
    frame = PlatesFrame(origin=np.array([end.corner.x_m, end.corner.z_m]), angle_rad=plates[0].angle_at(end.corner.x_m))
    inside = (section.x_m > right_m - 10 * _GUARD_M - _BESIDE_M) & (section.x_m < left_m + _GUARD_M)
    part = frame.of(section.only(inside))
    edge_s = float(((np.array([left_m, plates[1].z_at(left_m)]) - frame.origin) @ frame.axes.T)[0])
    below = (part.z_m > _GUARD_M) & (part.x_m > 1e-4)  # the face is the line s = 0
    fitted = fit_drawing(part.only(below), 0.0, edge_s, sides=(False, True))
    if isinstance(fitted, str):
        return Found(reason=f"no J groove: {fitted}")
    left = _edge(section, frame, plates[1], fitted, 1, left_m)
    if left is None:
        return Found(reason="no J groove: its edge is not where its plate ends")
    gap_m = max(fitted.middle_m, 0.0)  # the circle begins here, the face is at s = 0
    angle_sigma = float(np.sqrt(plates[0].covariance[1, 1])) / plates[0].length_m
    # The circle's place does not depend on the edge that the frame starts from; the root is midway between both.
    face_variance = end.corner.sigma_m**2 + (fitted.depth_m * angle_sigma) ** 2
    variance = (fitted.covariance[0, 0] + face_variance) / 4 + fitted.covariance[1, 1]
    higher_m = float(-_plate_depth(frame, plates[1], edge_s))  # the plate with the J, and so its root edge
    root = frame.corner(gap_m / 2, fitted.depth_m + higher_m / 2, float(np.sqrt(variance)))
    corners = (left, root, end.corner)
    worst = max(corner.sigma_m for corner in corners)
    if worst > MOST_SIGMA_M:
        return Found(reason=f"J groove too uncertain: a corner has a standard deviation of {worst * 1e3:.2f} mm")
    measures = {
        "radius_m": fitted.radius_m,
        "bevel_angle_rad": float(np.arctan(fitted.walls[1])),
        "gap_m": gap_m,
        "depth_m": fitted.depth_m,
        "mismatch_m": higher_m,
    }
    support = min(plates[0].count, plates[1].count, fitted.count)
    return Found(
        corners=corners, measures=measures, trust=Trust(explained=fitted.explained, margin=margin, support=support)
    )

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
    PLATE_LENGTH_M,
    as_deep,
    best_of,
    is_near,
    is_plate_pair,
    mirrored,
    near_words,
    uncertain_words,
)
from weldcell.tracking.curve_end import PLATE_LOST_SHARE, curve_end
from weldcell.tracking.curves import Curve, fit_curve, flipped_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.groove_drawing import Drawing, fit_drawing
from weldcell.tracking.groove_edge import BESIDE_M, groove_edge, plate_depth
from weldcell.tracking.pieces import Piece, flipped_piece, straight_pieces
from weldcell.tracking.plates_frame import PlatesFrame, plates_frame
from weldcell.tracking.quantiles import median, quantile
from weldcell.tracking.section import Corner, Section

U_NAMES = ("left", "centre", "right")
J_NAMES = ("left", "root", "right")
_STEEPEST, _NEIGHBOURS = 2.0, 12  # only the plates are looked for
_FEWEST_POINTS = 60
_FEWEST_ON_PLATE = 25
_LEAST_INLIER_SHARE = 0.4
_LEAST_PLATE_M = 3e-3
_WIDTH_M = (2e-3, 6e-2)
_LEAST_DEPTH_M, _MOST_MISMATCH_M = 1.5e-3, 5e-3
_GUARD_M = 4e-4
_LOPSIDED_SHARE, _NOT_DEEP = 0.1, 0.6
_FEWEST_BETWEEN = 15
_MOST_RISEN_M = 1.5e-3


@dataclass(frozen=True, kw_only=True)
class _Opening:
    """Two plates with something deeper between them."""

    right: Piece
    left: Piece
    weight: float
    """Points of the plates, and those between that lie below them."""

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
    plates = [piece for piece in pieces if piece.end_m - piece.start_m >= _LEAST_PLATE_M]
    found = [_opening(section, right, left) for right, left in combinations(plates, 2)]
    openings = [one for one in found if one is not None and is_near(one.middle_m, previous_x_m)]
    chosen = best_of([one.weight for one in openings], [one.middle_m for one in openings])
    if chosen is None:
        return Found(reason=f"no {name}{near_words(previous_x_m)}: of {len(pieces)} straight pieces no two enclose one")
    best, margin = openings[chosen[0]], chosen[1]
    right = _plate(section, best.right, best.right.end_m)
    left = _plate(section, best.left, best.left.start_m)
    if right is None or left is None:
        return Found(reason=f"no {name}: too few points on one of its plates")
    return groove(section, best, (right, left), margin)


def _opening(section: Section, right: Piece, left: Piece) -> _Opening | None:
    """What two plates enclose, if it is a groove."""
    if not is_plate_pair(right, left) or not _WIDTH_M[0] <= left.start_m - right.end_m <= _WIDTH_M[1]:
        return None
    middle_m = (right.end_m + left.start_m) / 2
    if abs(right.z_at(middle_m) - left.z_at(middle_m)) > _MOST_MISMATCH_M:
        return None
    depths_m = _depths_between(section, right, left)
    if len(depths_m) < _FEWEST_BETWEEN or median(depths_m) < _LEAST_DEPTH_M:
        return None
    plate_m = min(right.end_m - right.start_m, left.end_m - left.start_m, PLATE_LENGTH_M)
    deep = np.count_nonzero(depths_m > _GUARD_M)
    weight = plate_m / PLATE_LENGTH_M * 100 + deep - 2 * (len(depths_m) - deep)
    return _Opening(right=right, left=left, weight=weight)


def _depths_between(section: Section, right: Piece, left: Piece) -> Float[np.ndarray, "k"]:
    """How far the points between two plates lie below them."""
    inside = np.flatnonzero((section.x_m > right.end_m) & (section.x_m < left.start_m))
    ends_m = [right.end_m, left.start_m]
    plates_m = np.interp(section.x_m[inside], ends_m, [right.z_at(right.end_m), left.z_at(left.start_m)])
    return section.z_m[inside] - plates_m


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
    fitted = _u_drawing(section, frame, plates, right_m, left_m)
    if isinstance(fitted, str):
        return Found(reason=f"no U groove: {fitted}")
    right = groove_edge(section, frame, plates[0], fitted, -1, right_m)
    left = groove_edge(section, frame, plates[1], fitted, 1, left_m)
    if right is None or left is None:
        return Found(reason="no U groove: its edges are not where its plates end")
    middle = frame.corner(fitted.middle_m, fitted.depth_m, float(np.sqrt(np.trace(fitted.covariance[:2, :2]))))
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
    return _as_certain("U groove", (left, middle, right), measures, plates, fitted, margin)


def _u_drawing(
    section: Section, frame: PlatesFrame, plates: tuple[Curve, Curve], right_m: float, left_m: float
) -> Drawing | str:
    inside = (section.x_m > right_m - _GUARD_M) & (section.x_m < left_m + _GUARD_M)
    part = frame.of(section.only(inside))
    below = part.z_m > _GUARD_M  # the plates' ends are known already
    right_s, right_d = frame.from_section(right_m, plates[0].z_at(right_m))
    left_s, left_d = frame.from_section(left_m, plates[1].z_at(left_m))
    return fit_drawing(part.only(below), right_s, left_s, sides=(True, True), higher_m=right_d - left_d)


def _as_certain(
    name: str,
    corners: tuple[Corner, ...],
    measures: dict[str, float],
    plates: tuple[Curve, Curve],
    fitted: Drawing,
    margin: float,
) -> Found:
    """The groove, unless one of its corners is too uncertain."""
    doubt = uncertain_words(name, *corners)
    if doubt:
        return Found(reason=doubt)
    support = min(plates[0].count, plates[1].count, fitted.count)
    return Found(
        corners=corners, measures=measures, trust=Trust(explained=fitted.explained, margin=margin, support=support)
    )


def _j_groove(section: Section, opening: _Opening, plates: tuple[Curve, Curve], margin: float) -> Found:
    """The way round that puts the deepest points beside the square face; both ways where that is not clear."""
    inside = np.flatnonzero((section.x_m > opening.right.end_m) & (section.x_m < opening.left.start_m))
    z_m = section.z_m[inside]
    deep = inside[z_m >= quantile(z_m, _NOT_DEEP)]
    width_m = opening.left.start_m - opening.right.end_m
    aside = (median(section.x_m[deep]) - opening.middle_m) / width_m
    ways = [False, True] if abs(aside) < _LOPSIDED_SHARE else [aside > 0]
    found = [_j_one_way(section, opening, plates, margin, flipped) for flipped in ways]
    return max(found, key=lambda one: one.trust.explained if one.trust else 0.0)


def _j_one_way(section: Section, opening: _Opening, plates: tuple[Curve, Curve], margin: float, flipped: bool) -> Found:
    if not flipped:
        return _j_with_square_right(section, opening, plates, margin)
    turned = replace(opening, right=flipped_piece(opening.left), left=flipped_piece(opening.right))
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
    end = curve_end(section, plates[0], right_m - BESIDE_M, right_m + BESIDE_M, lost_share=PLATE_LOST_SHARE)
    if end is None:
        return Found(reason="no J groove: its square edge has no end")
    square = end.corner
    frame = PlatesFrame(origin=np.array([square.x_m, square.z_m]), angle_rad=plates[0].angle_at(square.x_m))
    inside = (section.x_m > right_m - 10 * _GUARD_M - BESIDE_M) & (section.x_m < left_m + _GUARD_M)
    part = frame.of(section.only(inside))
    edge_s, _ = frame.from_section(left_m, plates[1].z_at(left_m))
    below = (part.z_m > _GUARD_M) & (part.x_m > 1e-4)  # the face is the line s = 0
    fitted = fit_drawing(part.only(below), 0.0, edge_s, sides=(False, True))
    if isinstance(fitted, str):
        return Found(reason=f"no J groove: {fitted}")
    left = groove_edge(section, frame, plates[1], fitted, 1, left_m)
    if left is None:
        return Found(reason="no J groove: its edge is not where its plate ends")
    higher_m = -plate_depth(frame, plates[1], edge_s)  # the plate with the J, and so its root edge
    gap_m = max(fitted.middle_m, 0.0)  # the circle begins here, the face is at s = 0
    root = frame.corner(gap_m / 2, fitted.depth_m + higher_m / 2, _j_root_sigma_m(fitted, plates[0], square))
    measures = {
        "radius_m": fitted.radius_m,
        "bevel_angle_rad": float(np.arctan(fitted.walls[1])),
        "gap_m": gap_m,
        "depth_m": fitted.depth_m,
        "mismatch_m": higher_m,
    }
    return _as_certain("J groove", (left, root, square), measures, plates, fitted, margin)


def _j_root_sigma_m(fitted: Drawing, plate: Curve, square: Corner) -> float:
    """Of the point midway between the circle's end, which does not depend on the square edge, and the face below it."""
    angle_sigma = float(np.sqrt(plate.covariance[1, 1])) / plate.length_m
    face_variance = square.sigma_m**2 + (fitted.depth_m * angle_sigma) ** 2
    return float(np.sqrt((fitted.covariance[0, 0] + face_variance) / 4 + fitted.covariance[1, 1]))

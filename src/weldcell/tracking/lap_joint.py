"""The lap joint: the upper plate's edge, and the root where its square face meets the lower plate.

Seen across the joint the face is a third line between both plates' lines, and edge and root are where it crosses them:
that is as sharp as any groove's corner. Seen from above it hides itself. Then the edge is where the upper plate's light
stops, no better known than the columns' spacing allows, and the root lies below it at right angles to the plate.
"""

import math
from itertools import combinations

import numpy as np
from jaxtyping import Bool

from weldcell.tracking.candidates import (
    EXPLAINED_M,
    PLATE_LENGTH_M,
    best_of,
    is_near,
    is_plate_pair,
    near_words,
    share_on_model,
    uncertain_words,
)
from weldcell.tracking.curve_end import curve_end
from weldcell.tracking.curves import Curve, curves_cross, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.quantiles import median
from weldcell.tracking.section import Corner, Section

LAP_NAMES = ("edge", "root")
_STEEPEST = 2.0  # only the plates are looked for
_NEIGHBOURS = 12
_FEWEST_POINTS = 60
_FEWEST_ON_PLATE = 25
_FEWEST_ON_FACE = 8
_LEAST_INLIER_SHARE = 0.4
_LEAST_FACE_SHARE = 0.6
_LEAST_EXPLAINED = 0.5
_LEAST_PLATE_M = 3e-3
_BESIDE_M = 6e-3  # of the plate beside its edge, to tell what strays are usual on it
_BEYOND_M = 1e-3
_LEAST_NATS = 10.0  # one in some 1400 columns may begin a gap, which costs 7 of these
_STEP_M = (4e-4, 1.5e-2)  # across the plates
_MOST_HIDDEN_M = 8e-3  # between them, besides the face itself
_GUARD_M = 4e-4  # about corners the stripe of both sides mixes: its window is five columns there
_FACE_COLUMNS = 12  # a face as wide as this holds enough points to be found
_FOOT_COLUMNS, _FEWEST_AT_FOOT = 6, 2  # beside the root, and points of the plate among them
_SLACK_M, _FAN_SLOPE = 5e-4, 0.2
_SQUARE_RAD = math.radians(20)  # how far a face may be off the right angle to its plate: a tack weld's is at 45 deg


def find_lap(section: Section, previous_x_m: float | None = None) -> Found:
    """The upper plate's edge and the root, by the face between them where it is seen."""
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a lap joint (at least {_FEWEST_POINTS})")
    pieces = straight_pieces(section, steepest=_STEEPEST, neighbours=_NEIGHBOURS)
    pairs = [pair for pair in combinations(pieces, 2) if _is_step(*pair) and is_near(_step_at_m(pair), previous_x_m)]
    best = best_of([_weight(pair) for pair in pairs], [_step_at_m(pair) for pair in pairs])
    if best is None:
        return Found(
            reason=f"no lap joint{near_words(previous_x_m)}: no two plates of {len(pieces)} pieces form a step"
        )
    return _lap(section, pairs[best[0]], best[1])


def _is_step(right: Piece, left: Piece) -> bool:
    if min(right.length_m, left.length_m) < _LEAST_PLATE_M or not is_plate_pair(right, left):
        return False
    middle, tilt = (right.end_m + left.start_m) / 2, (right.angle_rad + left.angle_rad) / 2
    step_m = abs(right.z_at(middle) - left.z_at(middle)) * math.cos(tilt)
    apart_m = left.start_m - right.end_m
    return bool(_STEP_M[0] <= step_m <= _STEP_M[1] and apart_m <= _MOST_HIDDEN_M + step_m * abs(math.sin(tilt)))


def _step_at_m(pair: tuple[Piece, Piece]) -> float:
    return (pair[0].end_m + pair[1].start_m) / 2


def _weight(pair: tuple[Piece, Piece]) -> float:
    hidden_m = max(pair[1].start_m - pair[0].end_m, 0.0)
    return min(pair[0].length_m, pair[1].length_m, PLATE_LENGTH_M) - hidden_m / 4


def _lap(section: Section, pair: tuple[Piece, Piece], margin: float) -> Found:
    right, left = pair
    at = _step_at_m(pair)
    upper_is_right = right.z_at(at) < left.z_at(at)
    upper_piece, lower_piece = (right, left) if upper_is_right else (left, right)
    outward = 1.0 if upper_is_right else -1.0  # from the upper plate to the lower one
    edge_m = right.end_m if upper_is_right else left.start_m
    lower_m = left.start_m if upper_is_right else right.end_m
    upper = _plate(section, upper_piece, edge_m - outward * _GUARD_M, edge_m - outward * PLATE_LENGTH_M)
    lower = _plate(section, lower_piece, lower_m + outward * _GUARD_M, lower_m + outward * PLATE_LENGTH_M)
    if upper is None or lower is None:
        return Found(reason="no lap joint: too few points on one of its plates")
    face = _face(section, upper, lower, edge_m, lower_m)
    corners = _corners_on_face(upper, lower, face, edge_m, lower_m) if face is not None else None
    if corners is None:
        end = curve_end(section, upper, edge_m - outward * _BESIDE_M, lower_m + outward * _BEYOND_M, beyond=lower)
        if end is None or end.nats < _LEAST_NATS:
            return Found(reason="no lap joint: the upper plate has no clear edge")
        corners = end.corner, _foot(end.corner, upper, lower)
        if _is_hidden(section, lower, corners, lower_m, outward):
            return Found(reason="no lap joint: what lies between its plates' ends should be seen, and is not")
    return _found(section, (upper, lower), corners, outward, margin)


def _plate(section: Section, piece: Piece, near_m: float, far_m: float) -> Curve | None:
    """The plate between two x, no farther than its piece reaches."""
    low, high = max(min(near_m, far_m), piece.start_m), min(max(near_m, far_m), piece.end_m)
    curve = fit_curve(
        section.only(section.between(low, high)), line_curve(piece.slope, piece.intercept_m), highest_degree=3
    )
    if curve is None or curve.count < _FEWEST_ON_PLATE or curve.inlier_share < _LEAST_INLIER_SHARE:
        return None
    return curve


def _face(section: Section, upper: Curve, lower: Curve, edge_m: float, lower_m: float) -> Curve | None:
    """The upper plate's face, if enough points between both plates lie on a line about square to the plate."""
    between = section.only(_between(section, upper, lower, edge_m, lower_m))
    if len(between.x_m) < _FEWEST_ON_FACE:
        return None
    order = np.argsort(between.z_m)
    half = len(order) // 2
    (x_high, z_high), (x_low, z_low) = (
        (median(between.x_m[part]), median(between.z_m[part])) for part in (order[:half], order[half:])
    )
    if abs(x_low - x_high) < 1e-9:
        return None
    slope = (z_low - z_high) / (x_low - x_high)
    face = fit_curve(between, line_curve(slope, z_high - slope * x_high))
    if face is None or face.count < _FEWEST_ON_FACE or face.inlier_share < _LEAST_FACE_SHARE:
        return None
    turned = abs(face.angle_at((edge_m + lower_m) / 2) - upper.angle_at(edge_m))
    return face if abs(turned - math.pi / 2) <= _SQUARE_RAD else None


def _between(section: Section, upper: Curve, lower: Curve, edge_m: float, lower_m: float) -> Bool[np.ndarray, "n"]:
    """Points between two plates, clear of both and not far from where they seem to end."""
    low, high = sorted((edge_m, lower_m))
    inside = (section.x_m > low - _GUARD_M) & (section.x_m < high + _GUARD_M)
    below = (section.z_m - upper.z_of(section.x_m)) * math.cos(upper.angle_at(edge_m))
    above = (lower.z_of(section.x_m) - section.z_m) * math.cos(lower.angle_at(lower_m))
    return inside & (below > max(_GUARD_M, EXPLAINED_M)) & (above > max(_GUARD_M, EXPLAINED_M))


def _corners_on_face(
    upper: Curve, lower: Curve, face: Curve, edge_m: float, lower_m: float
) -> tuple[Corner, Corner] | None:
    """Edge and root where the face crosses the plates; None if that is not where the plates seem to end."""
    edge, root = curves_cross(upper, face, edge_m), curves_cross(face, lower, lower_m)
    if edge is None or root is None or max(abs(edge.x_m - edge_m), abs(root.x_m - lower_m)) > _MOST_HIDDEN_M:
        return None
    return edge, root


def _foot(edge: Corner, upper: Curve, lower: Curve) -> Corner:
    """Where the line at right angles to the upper plate through its edge meets the lower plate."""
    slope = upper.slope_at(edge.x_m)
    down_m = 0.0
    for _ in range(4):
        x_m = edge.x_m - slope * down_m
        down_m = (lower.z_at(x_m) - edge.z_m + lower.slope_at(x_m) * slope * down_m) / (1 + lower.slope_at(x_m) * slope)
    x_m = edge.x_m - slope * down_m
    angle_sigma = math.sqrt(upper.covariance[1, 1]) / upper.length_m  # the face turns with the plate
    variance = edge.sigma_m**2 + lower.variance_at(x_m) + (down_m * angle_sigma) ** 2
    return Corner(x_m=x_m, z_m=lower.z_at(x_m), sigma_m=math.sqrt(variance))


def _is_hidden(section: Section, lower: Curve, corners: tuple[Corner, Corner], lower_m: float, outward: float) -> bool:
    """Whether light or view is lost between the plates: the upper one's light need not stop at its edge then.

    A face that the light, which goes along z, falls on is seen, unless it is dim; then the lower plate begins where the
    upper one's height and end put its foot. Otherwise the lower plate is seen from the face on, or from below the edge
    where that leans over it; the fan's rays only shift this a little.
    """
    edge, root = corners
    if outward * (root.x_m - edge.x_m) > _FACE_COLUMNS * section.spacing_m:
        columns = outward * (section.x_m - root.x_m) / section.spacing_m
        beside = section.only(np.abs(columns) <= _FOOT_COLUMNS)
        return bool(np.count_nonzero(np.abs(beside.z_m - lower.z_of(beside.x_m)) <= EXPLAINED_M) < _FEWEST_AT_FOOT)
    lit_m = max(outward * root.x_m, outward * edge.x_m)
    return outward * lower_m - lit_m > _SLACK_M + _FAN_SLOPE * (root.z_m - edge.z_m)


def _found(
    section: Section, plates: tuple[Curve, Curve], corners: tuple[Corner, Corner], outward: float, margin: float
) -> Found:
    """The joint of these upper and lower plates and corners, unless too little speaks for it."""
    (upper, lower), (edge, root) = plates, corners
    doubt = uncertain_words("lap joint", edge, root)
    if doubt:
        return Found(reason=doubt)
    sides = ((upper, edge.x_m - outward * _BESIDE_M, edge.x_m), (lower, root.x_m, root.x_m + outward * _BESIDE_M))
    explained = min(share_on_model(section, [(plate, min(span), max(span))]) for plate, *span in sides)
    if explained < _LEAST_EXPLAINED:
        return Found(reason="no lap joint: most points beside the edge lie off the plates")
    measures = {
        "step_m": math.hypot(root.x_m - edge.x_m, root.z_m - edge.z_m),
        "angle_rad": outward * (lower.angle_at(root.x_m) - upper.angle_at(edge.x_m)),
    }
    trust = Trust(explained=explained, margin=margin, support=min(upper.count, lower.count))
    return Found(corners=(edge, root), measures=measures, trust=trust)

"""The fillet joint's root: where two plates meet in a valley."""

import math
from itertools import combinations

from weldcell.tracking.candidates import PLATE_LENGTH_M, best_of, is_near, near_words, share_on_model, uncertain_words
from weldcell.tracking.curves import Curve, curves_cross, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.quantiles import median, quantile
from weldcell.tracking.section import Corner, Section

FILLET_NAMES = ("root",)
_TRIES = ((6.0, 12), (6.0, 6), (25.0, 6))  # steepest dz/dx, and neighbours that tell a stray
_LEAST_PLATE_M = 3e-3
_TURN_RAD = (math.radians(30), math.radians(150))
_SLACK_M = 1.5e-3
_MOST_HIDDEN_M = 8e-3  # of the valley itself: a tack weld or a glint
_GUARD_M = 4e-4
_FEWEST_POINTS = 12
_LEAST_EXPLAINED = 0.5
_BEST_SHARE, _MOST_DOUBT, _SURE_M = 0.2, 4.0, 8e-5  # pieces are as certain as the best points nearly, or enough


def find_fillet(section: Section, previous_x_m: float | None = None) -> Found:
    """The root of two plates that form a valley of 30 to 150 degrees short of flat."""
    pieces: list[Piece] = []
    most_m = max(_MOST_DOUBT * quantile(section.sigma_m, _BEST_SHARE), _SURE_M) if len(section.x_m) else 0.0
    for steepest, neighbours in _TRIES:
        pieces = straight_pieces(section, steepest=steepest, neighbours=neighbours) if len(section.x_m) else []
        pieces = [piece for piece in pieces if _sigma_m(section, piece) <= most_m]
        pairs = [
            pair for pair in combinations(pieces, 2) if _is_valley(*pair) and is_near(_valley_m(*pair), previous_x_m)
        ]
        best = best_of([_weight(*pair) for pair in pairs], [_valley_m(*pair) for pair in pairs])
        if best is not None:
            return _refined(section, pairs[best[0]], best[1])
    return Found(reason=f"no fillet{near_words(previous_x_m)}: of {len(pieces)} straight pieces no two form a valley")


def _sigma_m(section: Section, piece: Piece) -> float:
    """How uncertain the points of a piece are: in calm pictures all about as much as the stripe's best part.

    Where an arc outshines the stripe, the edges of lit surfaces pass for one: far less certain than a stripe is.
    """
    return median(section.sigma_m[section.between(piece.start_m, piece.end_m)])


def _is_valley(right: Piece, left: Piece) -> bool:
    if min(right.length_m, left.length_m) < _LEAST_PLATE_M:
        return False
    if not _TURN_RAD[0] <= right.angle_rad - left.angle_rad <= _TURN_RAD[1]:
        return False
    root_m = _valley_m(right, left)
    if not right.end_m - _SLACK_M <= root_m <= left.start_m + _SLACK_M:
        return False
    return left.start_m - right.end_m <= _MOST_HIDDEN_M


def _valley_m(right: Piece, left: Piece) -> float:
    return (left.intercept_m - right.intercept_m) / (right.slope - left.slope)


def _weight(right: Piece, left: Piece) -> float:
    """The shorter plate's length counts: a valley between crumbs is none."""
    return min(right.length_m, left.length_m, PLATE_LENGTH_M)


def _refined(section: Section, pair: tuple[Piece, Piece], margin: float) -> Found:
    root_m = _valley_m(*pair)
    low, high = max(pair[0].start_m, root_m - PLATE_LENGTH_M), min(pair[1].end_m, root_m + PLATE_LENGTH_M)
    right, left = (line_curve(piece.slope, piece.intercept_m) for piece in pair)
    root: Corner | None = None
    for degree in (1, 3):
        right_fit = _fitted(section, right, low, root_m - _GUARD_M, degree)
        left_fit = _fitted(section, left, root_m + _GUARD_M, high, degree)
        if right_fit is None or left_fit is None:
            return Found(reason="no fillet: too few points on one of its plates")
        right, left = right_fit, left_fit
        root = curves_cross(right, left, root_m)
        if root is None or not low < root.x_m < high:
            return Found(reason="no fillet: the plates do not cross")
        root_m = root.x_m
    assert root is not None
    explained = share_on_model(section, [(right, low, root_m), (left, root_m, high)])
    if explained < _LEAST_EXPLAINED:
        return Found(reason="no fillet: most points about its root lie off its plates")
    doubt = uncertain_words("fillet", root)
    if doubt:
        return Found(reason=doubt)
    return Found(
        corners=(root,),
        measures={"angle_rad": math.pi - (right.angle_at(root_m) - left.angle_at(root_m))},
        trust=Trust(explained=explained, margin=margin, support=min(right.count, left.count)),
    )


def _fitted(section: Section, start: Curve, low: float, high: float, degree: int) -> Curve | None:
    curve = fit_curve(section.only(section.between(low, high, ends=False)), start, highest_degree=degree)
    return curve if curve is not None and curve.count >= _FEWEST_POINTS else None

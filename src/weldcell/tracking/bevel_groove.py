"""The single bevel's features: a bevelled plate, its bevel, and the square edge of the other plate.

The square face stands along the light, so it is seldom seen. It goes at right angles to its plate from that plate's
edge. The root is midway between the bevel's lower end and the face: where the bevel meets the face if no gap is left,
or if the face leans over and hides the bevel's end.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from weldcell.tracking.bevel_foot import Foot, bevel_foot
from weldcell.tracking.candidates import (
    EXPLAINED_M,
    PLATE_LENGTH_M,
    best_of,
    is_near,
    is_plate_pair,
    mirrored,
    mismatch_m,
    near_words,
    on_model,
    share_of,
    uncertain_words,
)
from weldcell.tracking.curve_end import PLATE_LOST_SHARE, curve_end
from weldcell.tracking.curves import Curve, curves_cross, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, bridged, flipped_piece, straight_pieces
from weldcell.tracking.section import Corner, Section

BEVEL_NAMES = ("left", "root", "right")
_TRIES = ((6.0, 12), (6.0, 6), (25.0, 6))  # steepest dz/dx, and neighbours that tell a stray
_FEWEST_POINTS = 40
_FEWEST_ON_PLATE = 20
_FEWEST_ON_BEVEL = 10
_LEAST_INLIER_SHARE = 0.4
_LEAST_EXPLAINED = 0.5
_LEAST_TURN_RAD = math.radians(15)
_LEAST_DEPTH_M = 1e-3
_LEAST_PLATE_M = 3e-3
_SLACK_M = 1.5e-3
_MOST_UNSEEN_M = 8e-3  # of plate and bevel on each side of their edge
_WIDEST_GAP_M = 6e-3  # between the bevel's seen end and the square edge
_GUARD_M = 4e-4
_GUARD_SHARE = 0.15
_BESIDE_M = 6e-3
_COUNTED_M = 1.5e-2  # of plate and bevel, to tell what strays are usual on them
_BEYOND_M = 2e-3


@dataclass(frozen=True, kw_only=True)
class _Bevel:
    """Bevelled plate, bevel and square plate by rising x, in the section or in its mirror image."""

    plate: Piece
    bevel: Piece
    square: Piece
    flipped: bool

    @property
    def edge_m(self) -> float:
        """x of the bevelled edge."""
        return (self.bevel.intercept_m - self.plate.intercept_m) / (self.plate.slope - self.bevel.slope)

    @property
    def anchor_m(self) -> float:
        """x of the square edge in the section as it was."""
        return -self.square.start_m if self.flipped else self.square.start_m


@dataclass(frozen=True, kw_only=True)
class _Lines:
    """What was fitted to the three pieces, and the bevelled edge."""

    plate: Curve
    bevel: Curve
    square: Curve
    edge: Corner
    """Where plate and bevel cross."""


def find_bevel(
    section: Section, previous_x_m: float | None = None, *, previous_kept_depth_m: float | None = None
) -> Found:
    """The single bevel's left edge, root and right edge, whichever plate has the bevel.

    `previous_kept_depth_m` is the last frame's measure: how deep the bevel ended where its end was seen.
    """
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a single bevel (at least {_FEWEST_POINTS})")
    pieces: list[Piece] = []
    for steepest, neighbours in _TRIES:
        pieces = straight_pieces(section, steepest=steepest, neighbours=neighbours)
        pieces = sorted(pieces + bridged(pieces, EXPLAINED_M, _MOST_UNSEEN_M), key=lambda piece: piece.start_m)
        both = {False: pieces, True: [flipped_piece(piece) for piece in reversed(pieces)]}
        candidates = [
            found
            for flipped, ordered in both.items()
            for found in _candidates(ordered, flipped)
            if is_near(found.anchor_m, previous_x_m)
        ]
        sections = (section, mirrored(section))
        scores = [_explained_points(sections[one.flipped], one) for one in candidates]
        best = best_of(scores, [one.anchor_m for one in candidates])
        if best is not None:
            chosen = candidates[best[0]]
            return _refined(sections[chosen.flipped], chosen, best[1], previous_kept_depth_m)
    return Found(
        reason=f"no single bevel{near_words(previous_x_m)}: of {len(pieces)} straight pieces no three form one"
    )


def _candidates(pieces: list[Piece], flipped: bool) -> Iterator[_Bevel]:
    """All threes of pieces that may form a bevel."""
    long = [piece for piece in pieces if piece.end_m - piece.start_m >= _LEAST_PLATE_M]
    for plate in long:
        for bevel in pieces:
            if plate.start_m < bevel.start_m and bevel.angle_rad - plate.angle_rad >= _LEAST_TURN_RAD:
                for square in long:
                    if _may_be_square(square, plate, bevel):
                        found = _Bevel(plate=plate, bevel=bevel, square=square, flipped=flipped)
                        if _meet(found):
                            yield found


def _may_be_square(square: Piece, plate: Piece, bevel: Piece) -> bool:
    """Whether a piece may be the square plate, which lies above the bevel's end and goes on there or after a gap."""
    if not (bevel.start_m < square.start_m and is_plate_pair(plate, square)):
        return False
    if not -_SLACK_M <= square.start_m - bevel.end_m <= _WIDEST_GAP_M:
        return False
    return bevel.z_at(bevel.end_m) - square.z_at(square.start_m) >= _LEAST_DEPTH_M


def _meet(one: _Bevel) -> bool:
    """Whether plate and bevel meet in between."""
    if not one.plate.end_m - _SLACK_M <= one.edge_m <= one.bevel.start_m + _SLACK_M:
        return False
    return max(one.edge_m - one.plate.end_m, one.bevel.start_m - one.edge_m) <= _MOST_UNSEEN_M


def _explained_points(section: Section, one: _Bevel) -> float:
    """Points on the bevel and on as much of the plates as the fit will use, less what lies off them between."""
    x_m, z_m = section.x_m, section.z_m
    total = 0
    for piece, low, high in (
        (one.plate, max(one.plate.start_m, one.edge_m - PLATE_LENGTH_M), one.edge_m),
        (one.bevel, one.edge_m, one.bevel.end_m),
        (one.square, one.square.start_m, min(one.square.end_m, one.square.start_m + PLATE_LENGTH_M)),
    ):
        inside = section.between(low, high)
        off_m = np.abs(z_m[inside] - piece.intercept_m - piece.slope * x_m[inside])
        total += int(np.count_nonzero(off_m < EXPLAINED_M))
    return float(total)


def _refined(section: Section, one: _Bevel, margin: float, previous_kept_depth_m: float | None) -> Found:
    lines = _fitted_lines(section, one)
    if isinstance(lines, str):
        return Found(reason=lines)
    ends = _ends(section, one, lines)
    if isinstance(ends, str):
        return Found(reason=ends)
    square_end, bevel_end = ends
    foot = bevel_foot(section, lines.square, lines.bevel, square_end, bevel_end, previous_kept_depth_m)
    higher_m = mismatch_m(lines.plate, lines.edge, lines.square, foot.edge)
    corners = (lines.edge, _between_members(foot.root, lines.square, higher_m), foot.edge)
    explained = _explained(section, lines, square_end, bevel_end)
    if explained < _LEAST_EXPLAINED:
        return Found(reason="no single bevel: most points between its edges lie off the bevel")
    doubt = uncertain_words("single bevel", *corners)
    if doubt:
        return Found(reason=doubt)
    unflipped = tuple(replace(corner, x_m=-corner.x_m) for corner in corners)
    return Found(
        corners=unflipped if one.flipped else corners[::-1],
        measures=_measures(one, lines, foot, -higher_m if one.flipped else higher_m),
        trust=Trust(
            explained=explained, margin=margin, support=min(lines.plate.count, lines.bevel.count, lines.square.count)
        ),
    )


def _fitted_lines(section: Section, one: _Bevel) -> _Lines | str:
    """All lines straight first, then the plates bent if they are; or why they form no bevel."""
    plate, bevel, square = (line_curve(piece.slope, piece.intercept_m) for piece in (one.plate, one.bevel, one.square))
    straight = _fitted_about(section, one, (plate, bevel, square), one.edge_m, 1)
    if isinstance(straight, str):
        return straight
    return _fitted_about(section, one, (straight.plate, straight.bevel, straight.square), straight.edge.x_m, 3)


def _fitted_about(
    section: Section, one: _Bevel, starts: tuple[Curve, Curve, Curve], edge_m: float, plate_degree: int
) -> _Lines | str:
    """Lines fitted on both sides of a bevelled edge that is known roughly; or why they form no bevel."""
    foot_m, square_m = one.bevel.end_m, one.square.start_m
    first_m = max(one.plate.start_m, edge_m - PLATE_LENGTH_M)
    last_m = min(one.square.end_m, square_m + PLATE_LENGTH_M)
    guard_m = min(_GUARD_M, _GUARD_SHARE * abs(foot_m - edge_m))
    fits = (
        _fitted(section, starts[0], first_m, edge_m - guard_m, plate_degree),
        _fitted(section, starts[1], edge_m + guard_m, foot_m - guard_m, 1),
        _fitted(section, starts[2], square_m, last_m, plate_degree),
    )
    complaint = _complaint(fits)
    if complaint:
        return complaint
    plate, bevel, square = (fit for fit in fits if fit is not None)
    edge = curves_cross(plate, bevel, edge_m)
    if edge is None or not plate.angle_at(edge.x_m) + _LEAST_TURN_RAD <= bevel.angle_at(edge.x_m):
        return "no single bevel: the lines fitted to the pieces do not form one"
    return _Lines(plate=plate, bevel=bevel, square=square, edge=edge)


def _ends(section: Section, one: _Bevel, lines: _Lines) -> tuple[Corner, Corner] | str:
    """Where the square plate and the bevel end towards each other, or which of them has no end."""
    edge_m, foot_m, square_m = lines.edge.x_m, one.bevel.end_m, one.square.start_m
    square_end = curve_end(
        section,
        lines.square,
        min(square_m + _COUNTED_M, one.square.end_m),
        square_m - _BEYOND_M,
        beyond=lines.bevel,
        lost_share=PLATE_LOST_SHARE,
    )
    if square_end is None:
        return "no single bevel: its square edge has no end"
    bevel_end = curve_end(section, lines.bevel, max(edge_m, foot_m - _COUNTED_M), square_end.corner.x_m)
    if bevel_end is None or bevel_end.corner.x_m <= edge_m:
        return "no single bevel: its bevel has no end"
    return square_end.corner, bevel_end.corner


def _explained(section: Section, lines: _Lines, square_end: Corner, bevel_end: Corner) -> float:
    """Share of the points on the lines: of all about the joint, or of those over the bevel where that is less."""
    edge_m = lines.edge.x_m
    model = [
        (lines.plate, edge_m - _BESIDE_M, edge_m),
        (lines.bevel, edge_m, bevel_end.x_m),
        (lines.square, square_end.x_m, square_end.x_m + _BESIDE_M),
    ]
    on = on_model(section, model)
    spans = ((model[0][1], model[2][2]), (edge_m, square_end.x_m))
    return min(share_of(on[section.between(*span)]) for span in spans)


def _measures(one: _Bevel, lines: _Lines, foot: Foot, higher_m: float) -> dict[str, float]:
    turn_rad = lines.bevel.angle_at(lines.edge.x_m) - lines.square.angle_at(one.square.start_m)
    measures = {
        "gap_m": foot.gap_m,
        "bevel_angle_rad": math.pi / 2 - turn_rad,
        "mismatch_m": higher_m,
        "depth_m": foot.depth_m,
    }
    return measures if foot.kept_depth_m is None else measures | {"kept_depth_m": foot.kept_depth_m}


def _between_members(root: Corner, square: Curve, higher_m: float) -> Corner:
    """Midway between both root edges: equally deep in its member, the square one stands as much higher as its plate."""
    tilt_rad = square.angle_at(root.x_m)
    x_m, z_m = root.x_m + higher_m / 2 * math.sin(tilt_rad), root.z_m - higher_m / 2 * math.cos(tilt_rad)
    return replace(root, x_m=x_m, z_m=z_m)


def _fitted(section: Section, start: Curve, low: float, high: float, degree: int) -> Curve | None:
    return fit_curve(section.only(section.between(low, high, ends=False)), start, highest_degree=degree)


def _complaint(fits: tuple[Curve | None, ...]) -> str:
    names = ("bevelled plate", "bevel", "square plate")
    for name, fit, fewest in zip(names, fits, (_FEWEST_ON_PLATE, _FEWEST_ON_BEVEL, _FEWEST_ON_PLATE), strict=True):
        if fit is None or fit.count < fewest:
            return f"no single bevel: too few points on its {name}"
        if fit.inlier_share < _LEAST_INLIER_SHARE:
            return f"no single bevel: only {fit.inlier_share:.0%} of the points of its {name} lie on one line"
    return ""

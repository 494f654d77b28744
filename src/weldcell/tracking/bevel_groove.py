"""The single bevel's features: a bevelled plate, its bevel, and the square edge of the other plate.

The square face stands along the light, so it is seldom seen. It goes at right angles to its plate from that plate's
edge. The root is midway between the bevel's lower end and the face: where the bevel meets the face if no gap is left,
or if the face leans over and hides the bevel's end.
"""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from weldcell.tracking.candidates import (
    EXPLAINED_M,
    MOST_SIGMA_M,
    PLATE_LENGTH_M,
    best_of,
    is_near,
    is_plate_pair,
    mirrored,
    mismatch_m,
    near_words,
    on_model,
)
from weldcell.tracking.curves import Curve, End, curve_end, curves_cross, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.section import Corner, Section

BEVEL_NAMES = ("left", "root", "right")
_TRIES = ((6.0, 12), (6.0, 6), (25.0, 6))  # steepest dz/dx, and neighbours that tell a stray
_FEWEST_POINTS = 40
_FEWEST_ON_PLATE = 20
_FEWEST_ON_BEVEL = 10
_LEAST_INLIER_SHARE = 0.4
_LEAST_EXPLAINED = 0.5
_LEAST_TURN_RAD = np.deg2rad(15)
_LEAST_DEPTH_M = 1e-3
_SLACK_M = 1.5e-3
_WIDEST_GAP_M = 6e-3  # between the bevel's seen end and the square edge
_GUARD_M = 4e-4
_GUARD_SHARE = 0.15
_BESIDE_M = 6e-3
_BEYOND_M = 2e-3
_SHADOW_SPACINGS = 3.0  # a bevel that is seen up to the square edge's shadow has no gap to be seen
_ROUNDS = 2


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


def find_bevel(section: Section, previous_x_m: float | None = None) -> Found:
    """The single bevel's left edge, root and right edge, whichever plate has the bevel."""
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a single bevel (at least {_FEWEST_POINTS})")
    pieces: list[Piece] = []
    for steepest, neighbours in _TRIES:
        pieces = straight_pieces(section, steepest=steepest, neighbours=neighbours)
        both = {False: pieces, True: [_flipped(piece) for piece in reversed(pieces)]}
        candidates = [
            found
            for flipped, ordered in both.items()
            for three in permutations(ordered, 3)
            if three[0].start_m < three[1].start_m < three[2].start_m
            and _forms_bevel(found := _Bevel(plate=three[0], bevel=three[1], square=three[2], flipped=flipped))
            and is_near(found.anchor_m, previous_x_m)
        ]
        sections = (section, mirrored(section))
        scores = [_explained_points(sections[one.flipped], one) for one in candidates]
        best = best_of(scores, [one.anchor_m for one in candidates])
        if best is not None:
            chosen = candidates[best[0]]
            return _refined(sections[chosen.flipped], chosen, best[1])
    return Found(
        reason=f"no single bevel{near_words(previous_x_m)}: of {len(pieces)} straight pieces no three form one"
    )


def _flipped(piece: Piece) -> Piece:
    return replace(piece, start_m=-piece.end_m, end_m=-piece.start_m, slope=-piece.slope)


def _forms_bevel(one: _Bevel) -> bool:
    if one.bevel.angle_rad - one.plate.angle_rad < _LEAST_TURN_RAD or not is_plate_pair(one.plate, one.square):
        return False
    if not one.plate.end_m - _SLACK_M <= one.edge_m <= one.bevel.start_m + _SLACK_M:
        return False
    hidden_m = one.square.start_m - one.bevel.end_m
    if not -_SLACK_M <= hidden_m <= _WIDEST_GAP_M:
        return False
    depth_m = one.bevel.z_at(one.bevel.end_m) - one.square.z_at(one.square.start_m)
    return depth_m >= _LEAST_DEPTH_M


def _explained_points(section: Section, one: _Bevel) -> float:
    """Points on the bevel and on as much of the plates as the fit will use, less what lies off them between."""
    x_m, z_m = section.x_m, section.z_m
    total = 0
    for piece, low, high in (
        (one.plate, max(one.plate.start_m, one.edge_m - PLATE_LENGTH_M), one.edge_m),
        (one.bevel, one.edge_m, one.bevel.end_m),
        (one.square, one.square.start_m, min(one.square.end_m, one.square.start_m + PLATE_LENGTH_M)),
    ):
        inside = (x_m >= low) & (x_m <= high)
        total += int((np.abs(z_m[inside] - piece.intercept_m - piece.slope * x_m[inside]) < EXPLAINED_M).sum())
    return float(total)


def _refined(section: Section, one: _Bevel, margin: float) -> Found:
    edge_m, foot_m, square_m = one.edge_m, one.bevel.end_m, one.square.start_m
    plate, bevel, square = (line_curve(piece.slope, piece.intercept_m) for piece in (one.plate, one.bevel, one.square))
    edge: Corner | None = None
    for turn in range(_ROUNDS):
        degree = 3 if turn == _ROUNDS - 1 else 1
        guard_m = min(_GUARD_M, _GUARD_SHARE * abs(foot_m - edge_m))
        fits = (
            _fitted(section, plate, max(one.plate.start_m, edge_m - PLATE_LENGTH_M), edge_m - guard_m, degree),
            _fitted(section, bevel, edge_m + guard_m, foot_m - guard_m, 1),
            _fitted(section, square, square_m, min(one.square.end_m, square_m + PLATE_LENGTH_M), degree),
        )
        complaint = _complaint(fits)
        if complaint:
            return Found(reason=complaint)
        plate, bevel, square = (fit for fit in fits if fit is not None)
        edge = curves_cross(plate, bevel, edge_m)
        if edge is None or not plate.angle_at(edge.x_m) + _LEAST_TURN_RAD <= bevel.angle_at(edge.x_m):
            return Found(reason="no single bevel: the lines fitted to the pieces do not form one")
        edge_m = edge.x_m
    assert edge is not None
    square_end = curve_end(
        section, square, min(square_m + _BESIDE_M, one.square.end_m), square_m - _BEYOND_M, beyond=bevel
    )
    if square_end is None:
        return Found(reason="no single bevel: its square edge has no end")
    bevel_end = curve_end(section, bevel, max(edge_m, foot_m - _BESIDE_M), square_end.corner.x_m)
    if bevel_end is None or bevel_end.corner.x_m <= edge_m:
        return Found(reason="no single bevel: its bevel has no end")
    root, gap_m = _root(section, square, bevel, square_end, bevel_end)
    corners = (edge, root, square_end.corner)
    model = [
        (plate, edge_m - _BESIDE_M, edge_m),
        (bevel, edge_m, bevel_end.corner.x_m),
        (square, square_end.corner.x_m, square_end.corner.x_m + _BESIDE_M),
    ]
    inside = (section.x_m >= model[0][1]) & (section.x_m <= model[2][2])
    on_bevel = (section.x_m >= edge_m) & (section.x_m <= square_end.corner.x_m)
    on = on_model(section, model)
    explained = min(float(on[inside].mean()), float(on[on_bevel].mean()) if on_bevel.any() else 0.0)
    if explained < _LEAST_EXPLAINED:
        return Found(reason="no single bevel: most points between its edges lie off the bevel")
    worst = max(corner.sigma_m for corner in corners)
    if worst > MOST_SIGMA_M:
        return Found(reason=f"single bevel too uncertain: a corner has a standard deviation of {worst * 1e3:.2f} mm")
    measures = {
        "gap_m": gap_m,
        "bevel_angle_rad": np.pi / 2 - (bevel.angle_at(edge_m) - square.angle_at(square_m)),
        "mismatch_m": mismatch_m(plate, edge, square, corners[2]),
        "depth_m": float(np.hypot(root.x_m - corners[2].x_m, root.z_m - corners[2].z_m)),
    }
    trust = Trust(explained=explained, margin=margin, support=min(plate.count, bevel.count, square.count))
    if one.flipped:
        measures["mismatch_m"] *= -1
        unflipped = tuple(replace(corner, x_m=-corner.x_m) for corner in corners)
        return Found(corners=unflipped, measures=measures, trust=trust)
    return Found(corners=corners[::-1], measures=measures, trust=trust)


def _fitted(section: Section, start: Curve, low: float, high: float, degree: int) -> Curve | None:
    return fit_curve(section.only((section.x_m > low) & (section.x_m < high)), start, highest_degree=degree)


def _complaint(fits: tuple[Curve | None, ...]) -> str:
    names = ("bevelled plate", "bevel", "square plate")
    for name, fit, fewest in zip(names, fits, (_FEWEST_ON_PLATE, _FEWEST_ON_BEVEL, _FEWEST_ON_PLATE), strict=True):
        if fit is None or fit.count < fewest:
            return f"no single bevel: too few points on its {name}"
        if fit.inlier_share < _LEAST_INLIER_SHARE:
            return f"no single bevel: only {fit.inlier_share:.0%} of the points of its {name} lie on one line"
    return ""


def _root(section: Section, square: Curve, bevel: Curve, square_end: End, bevel_end: End) -> tuple[Corner, float]:
    """Midway between the bevel's end and the face, and the gap between them."""
    edge, end = square_end.corner, bevel_end.corner
    meeting = _on_face(square, bevel, edge)
    lean = square.slope_at(edge.x_m)
    if _ends_in_shadow(section, edge, end) or meeting.x_m <= end.x_m:
        return meeting, 0.0
    direction = np.array([1.0, lean]) / np.hypot(1.0, lean)  # along the square plate
    gap_m = float(direction @ [edge.x_m - end.x_m, edge.z_m - end.z_m])
    if gap_m <= 0:
        return meeting, 0.0
    # The gap's ends are independent; the middle moves by half of each.
    sigma_m = 0.5 * float(np.hypot(end.sigma_m, edge.sigma_m))
    x_m, z_m = np.array([end.x_m, end.z_m]) + gap_m / 2 * direction
    return Corner(x_m=float(x_m), z_m=float(z_m), sigma_m=sigma_m), gap_m


def _ends_in_shadow(section: Section, edge: Corner, end: Corner) -> bool:
    """Whether the square edge hides what lies beyond the bevel's end.

    It keeps the light, which goes along z, from what has a larger x, and takes the columns of what lies along the
    camera's rays below it.
    """
    spacing_m = float(np.median(np.diff(section.x_m)))
    at = min(int(np.searchsorted(section.x_m, edge.x_m)), len(section.x_m) - 1)
    ray_m = edge.x_m + float(section.noise_slope[at]) * (end.z_m - edge.z_m)
    return min(edge.x_m, ray_m) - end.x_m <= _SHADOW_SPACINGS * spacing_m


def _on_face(square: Curve, bevel: Curve, edge: Corner) -> Corner:
    """Where the bevel meets the square face, which goes down at right angles to its plate."""
    lean = square.slope_at(edge.x_m)
    slope = bevel.slope_at(edge.x_m)
    down_m = (bevel.z_at(edge.x_m) - edge.z_m) / (1 + slope * lean)
    x_m = edge.x_m - lean * down_m
    shift = (1 + slope**2) / (1 + slope * lean) ** 2  # along the bevel, for each of the edge along the plate
    turn_m = down_m * np.sqrt(square.covariance[1, 1]) / square.length_m
    variance = shift * (edge.sigma_m**2 + turn_m**2) + bevel.variance_at(x_m)
    return Corner(x_m=float(x_m), z_m=bevel.z_at(x_m), sigma_m=float(np.sqrt(variance)))

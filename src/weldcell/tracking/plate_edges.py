"""Square butt joints: plates whose light stops at their edges.

An edge is where the light of a plate stops, not where two lines cross, so its place is known to half a column or so
(`curve_end`). A gap may be dark or show what lies below it; both are columns without the plate.
"""

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from weldcell.tracking.candidates import (
    EXPLAINED_M,
    best_of,
    is_near,
    is_plate_pair,
    mismatch_m,
    near_words,
    on_model,
    share_on_model,
    uncertain_words,
    unlikelihood,
)
from weldcell.tracking.curve_end import PLATE_LOST_SHARE, End, curve_end
from weldcell.tracking.curves import Curve, fit_curve, line_curve
from weldcell.tracking.found import Found, Trust
from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.quantiles import median
from weldcell.tracking.section import Corner, Section

BUTT_NAMES = ("left", "right")
_STEEPEST = 2.0  # only the plates are looked for
_NEIGHBOURS = 12
_FEWEST_POINTS = 60
_FEWEST_ON_PLATE = 25
_LEAST_INLIER_SHARE = 0.4
_LEAST_EXPLAINED = 0.5
_LEAST_PLATE_M = 3e-3
_HOLE_SPACINGS = 2.5
_MOST_HOLES = 4
_MOST_GAP_M = 0.012
_MOST_MISMATCH_M = 5e-3
_VISIBLE_STEP_SIGMAS = 4.0
_LEAST_STEP_M = 1e-4
_BESIDE_M = 1e-2  # of the plate beside an edge, to tell what strays are usual on it
_BEYOND_M = 1e-3
_LEAST_NATS = 14.0  # one in some 1400 columns may begin a gap, which costs 7; as much again keeps runs of strays out
_KNOWN_NATS = 6.0  # of these, where the last frame says which fifty columns it is in
_SAME_GAP_NATS, _SAME_GAP_M = 5.0, 2.5e-4  # and of the others, where it was as wide: dark runs are of any length
_RISE_M = 3e-4  # what lies higher above the plates inside a gap covers it
_COVERED_SHARE = 0.5
_PLATE_DEGREE = 3
_LEAD_NATS = 3.0  # over what is elsewhere: twenty to one
_FIRST_NATS, _NEXT_NATS = 7.0, 1.2  # the most that the first missing column and each after it say for a gap
_FITTED_M = 0.012  # of each plate of a butt joint: its ends matter, and it may be bent


@dataclass(frozen=True, kw_only=True)
class _Gap:
    """A stretch that may be a butt joint's gap, and the plates beside it."""

    plates: tuple[Curve, Curve]
    ends: tuple[End, End]

    @property
    def nats(self) -> float:
        """Evidence of the gap, which both ends must give: they count the same columns."""
        return min(self.ends[0].nats, self.ends[1].nats)

    @property
    def middle_m(self) -> float:
        return (self.ends[0].corner.x_m + self.ends[1].corner.x_m) / 2


def find_butt(section: Section, previous_x_m: float | None = None, *, previous_gap_m: float | None = None) -> Found:
    """The two edges of a square butt joint: of a gap, of a step, or of both.

    A gap as wide as the last frame's needs less evidence.
    """
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a butt joint (at least {_FEWEST_POINTS})")
    pieces = [
        piece
        for piece in straight_pieces(section, steepest=_STEEPEST, neighbours=_NEIGHBOURS)
        if piece.length_m >= _LEAST_PLATE_M
    ]
    least = _LEAST_NATS - (0.0 if previous_x_m is None else _KNOWN_NATS)
    hopeful = least - (_SAME_GAP_NATS if previous_gap_m else 0.0)
    gaps: list[_Gap] = []
    scores: list[float] = []
    for start, end, right, left in _stretches(section, pieces, previous_x_m, hopeful):
        gap = _gap(section, start, end, (right, left))
        if gap is not None and is_near(gap.middle_m, previous_x_m):
            gaps.append(gap)
            unlikely = unlikelihood(gap.middle_m, previous_x_m)
            scores.append(gap.nats - least - unlikely + _alike_nats(gap, previous_gap_m))
    best = best_of(scores, [gap.middle_m for gap in gaps])
    if best is None:
        return Found(reason=f"no butt joint{near_words(previous_x_m)}: no gap or step between two plates")
    found, margin = gaps[best[0]], best[1]
    if margin * scores[best[0]] < min(_LEAD_NATS, scores[best[0]]):
        return Found(reason=f"no butt joint{near_words(previous_x_m)}: two places are about as likely")
    return _butt(section, found, margin)


def _alike_nats(gap: _Gap, previous_gap_m: float | None) -> float:
    """What the last frame's gap, if it is known, says for this one."""
    if not previous_gap_m:
        return 0.0
    width_m = _along(gap.plates, gap.ends[0].corner, gap.ends[1].corner)
    return _SAME_GAP_NATS if abs(width_m - previous_gap_m) <= _SAME_GAP_M else 0.0


def _stretches(
    section: Section, pieces: list[Piece], previous_x_m: float | None, least_nats: float
) -> list[tuple[float, float, Curve, Curve]]:
    """Where a gap may lie (from x to x), with the lines of the plates on its right (smaller x) and left.

    Near the last frame's, if there is one; holes too narrow for this much evidence are left out.
    """
    lines = [line_curve(piece.slope, piece.intercept_m) for piece in pieces]
    found = []
    for i, j in combinations(range(len(pieces)), 2):
        right, left = pieces[i], pieces[j]
        middle = (right.end_m + left.start_m) / 2
        if left.start_m - right.end_m > _MOST_GAP_M or not is_near(middle, previous_x_m):
            continue
        right_z, left_z = right.z_at(middle), left.z_at(middle)
        between = all(piece.z_at(middle) > max(right_z, left_z) for piece in pieces[i + 1 : j])
        if between and is_plate_pair(right, left) and abs(right_z - left_z) <= _MOST_MISMATCH_M:
            found.append((right.end_m, left.start_m, lines[i], lines[j]))
    for piece, line in zip(pieces, lines, strict=True):
        for start, end, nats in _holes(section, piece):
            middle = (start + end) / 2
            if is_near(middle, previous_x_m) and nats > least_nats + unlikelihood(middle, previous_x_m):
                found.append((start, end, line, line))
    return found


def _holes(section: Section, piece: Piece) -> list[tuple[float, float, float]]:
    """The widest stretches of a piece without points on it, and how much evidence of a gap each may give at most.

    A narrow gap on one level does not part a piece in two.
    """
    of_piece = section.between(piece.start_m, piece.end_m)
    x_m, z_m = section.x_m[of_piece], section.z_m[of_piece]
    x_m = x_m[np.abs(z_m - piece.intercept_m - piece.slope * x_m) <= EXPLAINED_M]
    if len(x_m) < 2:
        return []
    steps = x_m[1:] - x_m[:-1]
    spacing_m = median(steps)
    wide = np.flatnonzero((steps > _HOLE_SPACINGS * spacing_m) & (steps <= _MOST_GAP_M))
    wide = wide[np.argsort(steps[wide])[::-1][:_MOST_HOLES]]
    most_nats = _FIRST_NATS + _NEXT_NATS * (steps[wide] / spacing_m - 1)
    return list(zip(x_m[wide].tolist(), x_m[wide + 1].tolist(), most_nats.tolist(), strict=True))


def _gap(section: Section, start: float, end: float, lines: tuple[Curve, Curve], *, final: bool = False) -> _Gap | None:
    """The gap about a stretch, with plates fitted beside it; None where there is none.

    Of plates on one level the widest hole near the stretch is the gap, and they are fitted once more up to it.
    """
    plates = _plates(section, start, end, lines)
    if plates is None:
        return None
    beyond = _BEYOND_M if _is_step(section, plates, (start + end) / 2) else 0.0
    if not beyond:
        hole = _widest_hole(section, plates, start - _BEYOND_M, end + _BEYOND_M)
        if not final and hole != (start, end):
            return _gap(section, *hole, lines, final=True)
        start, end = hole
    right_end = curve_end(section, plates[0], start - _BESIDE_M, end + beyond, lost_share=PLATE_LOST_SHARE)
    left_end = curve_end(section, plates[1], end + _BESIDE_M, start - beyond, lost_share=PLATE_LOST_SHARE)
    if right_end is None or left_end is None:
        return None
    return _Gap(plates=plates, ends=(right_end, left_end))


def _plates(section: Section, start: float, end: float, lines: tuple[Curve, Curve]) -> tuple[Curve, Curve] | None:
    """The plates up to a gap from their rough lines; None if they hold too little."""
    right_part, left_part = section.between(start - _FITTED_M, start), section.between(end, end + _FITTED_M)
    right = fit_curve(section.only(right_part), lines[0], highest_degree=_PLATE_DEGREE)
    left = fit_curve(section.only(left_part), lines[1], highest_degree=_PLATE_DEGREE)
    if right is None or left is None or min(right.count, left.count) < _FEWEST_ON_PLATE:
        return None
    return (right, left) if min(right.inlier_share, left.inlier_share) >= _LEAST_INLIER_SHARE else None


def _is_step(section: Section, plates: tuple[Curve, Curve], middle_m: float) -> bool:
    """Whether one plate stands visibly higher than the other."""
    right, left = plates
    noise_m = section.usual_sigma_m * max(right.sigmas, left.sigmas, 1.0)
    return abs(right.z_at(middle_m) - left.z_at(middle_m)) > max(_VISIBLE_STEP_SIGMAS * noise_m, _LEAST_STEP_M)


def _widest_hole(section: Section, plates: tuple[Curve, Curve], start: float, end: float) -> tuple[float, float]:
    """Between two x, the widest stretch without points of either plate: on one level, each goes on in the other."""
    reach = end - start
    on = on_model(section, [(plate, start - reach, end + reach) for plate in plates])
    inside = section.between(start, end)
    x_m = np.sort(section.x_m[inside][on[inside]])
    if len(x_m) < 2:
        return start, end
    widest = int((x_m[1:] - x_m[:-1]).argmax())
    return float(x_m[widest]), float(x_m[widest + 1])


def _butt(section: Section, gap: _Gap, margin: float) -> Found:
    right, left = gap.ends[0].corner, gap.ends[1].corner
    inside = section.between(right.x_m, left.x_m, ends=False)
    level = np.interp(section.x_m[inside], [right.x_m, left.x_m], [right.z_m, left.z_m])
    columns = (left.x_m - right.x_m) / section.spacing_m
    if np.count_nonzero(section.z_m[inside] < level - _RISE_M) > max(_COVERED_SHARE * columns, 2):
        return Found(reason="no butt joint: something stands in the gap, such as a tack weld")
    if left.x_m - right.x_m > _MOST_GAP_M:
        return Found(reason=f"no butt joint: a gap of {(left.x_m - right.x_m) * 1e3:.1f} mm is too wide")
    doubt = uncertain_words("butt joint", right, left)
    if doubt:
        return Found(reason=doubt)
    low, high = right.x_m - _BESIDE_M, left.x_m + _BESIDE_M
    explained = share_on_model(section, [(gap.plates[0], low, right.x_m), (gap.plates[1], left.x_m, high)])
    if explained < _LEAST_EXPLAINED:
        return Found(reason="no butt joint: most points beside the gap lie off the plates")
    measures = {
        "gap_m": max(_along(gap.plates, right, left), 0.0),
        "mismatch_m": mismatch_m(gap.plates[0], right, gap.plates[1], left),
        "angle_rad": gap.plates[1].angle_at(left.x_m) - gap.plates[0].angle_at(right.x_m),
    }
    support = min(plate.count for plate in gap.plates)
    return Found(
        corners=(left, right), measures=measures, trust=Trust(explained=explained, margin=margin, support=support)
    )


def _along(plates: tuple[Curve, Curve], right: Corner, left: Corner) -> float:
    """Distance of the edges along the plates' mean direction."""
    tilt = (plates[0].angle_at(right.x_m) + plates[1].angle_at(left.x_m)) / 2
    return (left.x_m - right.x_m) * math.cos(tilt) + (left.z_m - right.z_m) * math.sin(tilt)

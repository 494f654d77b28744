"""The V-groove's features: left plate, left wall, right wall and right plate, and the corners between them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from weldcell.tracking.pieces import Piece, straight_pieces
from weldcell.tracking.section import Corner, Line, Section, crossing, fit_line

V_NAMES = ("left", "root", "right")
_FEWEST_POINTS = 30
_STEEPEST = (6.0, 25.0)  # dz/dx: 80 degrees, and 88 for what has few strays
_MOST_PIECES = 16
_MOST_CANDIDATES = 12
_EXPLAINED_M = 3e-4
_LEAST_EDGE_TURN_RAD = np.deg2rad(10)
_LEAST_ROOT_TURN_RAD = np.deg2rad(20)
_MOST_PLATE_ANGLE_RAD = np.deg2rad(25)  # between the two plates
_LEAST_DEPTH_M = 1e-3
_CORNER_SLACK_M = 1.5e-3  # a corner lies this close to the space between its two pieces
_PLATE_LENGTH_M = 0.02  # plate beyond this adds little precision, and it may be bent
_GUARD_M = 4e-4  # about corners the stripe of both sides mixes: its window is five columns there
_GUARD_SHARE = 0.15
_FIT_ROUNDS = 3
_FEWEST_ON_LINE = 6
_LEAST_INLIER_SHARE = 0.4
_LEAST_GROOVE_SHARE = 0.5
_APART_SPACINGS = 5
_LEAST_GROUP_SHARE = 0.1
_MOST_SIGMA_M = 5e-4
_GATE_M = 0.015  # the search window of commercial trackers


@dataclass(frozen=True, kw_only=True)
class Found:
    """Corners in the laser frame, by rising x, or the reason why there are none."""

    corners: tuple[Corner, ...] = ()
    reason: str = ""


def find_v(section: Section, previous_x_m: float | None = None, *, gapped: bool = False) -> Found:
    """The V-groove's left edge, root and right edge.

    The root is where the walls cross, seen or not; with a root gap (`gapped`) the middle between their lower ends.
    With `previous_x_m` (x of the last root) only grooves with their root within 15 mm of it count.
    """
    if len(section.x_m) < _FEWEST_POINTS:
        return Found(reason=f"{len(section.x_m)} points are too few for a V-groove (at least {_FEWEST_POINTS})")
    pieces: list[Piece] = []
    for steepest in _STEEPEST:
        pieces = straight_pieces(section, steepest=steepest)
        best = _best_four(section, pieces, previous_x_m)
        if best is not None:
            return _refined(section, best, gapped)
    near = "" if previous_x_m is None else f" within {_GATE_M * 1e3:.0f} mm of the last one"
    return Found(reason=f"no V-groove{near}: of {len(pieces)} straight pieces no four form one")


def _best_four(section: Section, pieces: list[Piece], previous_x_m: float | None) -> tuple[Piece, ...] | None:
    """The four pieces that form a V on whose lines the most points lie."""
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
        if right[0] is root[1] and _forms_v((*left, *right), previous_x_m)
    ]
    likely = sorted(fours, key=lambda four: -sum(piece.count for piece in four))[:_MOST_CANDIDATES]
    return max(likely, key=lambda four: _explained_points(section, four), default=None)


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


def _forms_v(four: tuple[Piece, ...], previous_x_m: float | None) -> bool:
    left, root, right = (_crossing_x(*pair) for pair in zip(four[:-1], four[1:], strict=True))
    if not left < root < right or abs(_turn(four[0], four[3])) > _MOST_PLATE_ANGLE_RAD:
        return False
    edges_z = np.interp(root, [left, right], [four[0].z_at(left), four[3].z_at(right)])
    near = previous_x_m is None or abs(root - previous_x_m) <= _GATE_M
    return near and bool(four[1].z_at(root) - edges_z >= _LEAST_DEPTH_M)


def _explained_points(section: Section, four: tuple[Piece, ...]) -> int:
    """Points that lie on the walls, or on as much of the plates as the fit will use."""
    left, root, right = (_crossing_x(*pair) for pair in zip(four[:-1], four[1:], strict=True))
    nodes_x = [max(four[0].start_m, left - _PLATE_LENGTH_M), left, root, right]
    nodes_x.append(min(four[3].end_m, right + _PLATE_LENGTH_M))
    nodes_z = [piece.z_at(x) for piece, x in zip((four[0], *four), nodes_x, strict=True)]
    distance = np.abs(section.z_m - np.interp(section.x_m, nodes_x, nodes_z, left=np.inf, right=np.inf))
    return int((distance < _EXPLAINED_M).sum())


def _turns_like_v(angles: Sequence[float]) -> bool:
    """Down at the left edge, up at the root, level again at the right edge."""
    left_turn, root_turn, right_turn = np.diff(angles)
    return bool(
        left_turn >= _LEAST_EDGE_TURN_RAD
        and root_turn <= -_LEAST_ROOT_TURN_RAD
        and right_turn >= _LEAST_EDGE_TURN_RAD
        and abs(angles[3] - angles[0]) <= _MOST_PLATE_ANGLE_RAD
    )


def _refined(section: Section, four: tuple[Piece, ...], gapped: bool) -> Found:
    """The corners of lines fitted to all the section's own points between the corners."""
    corner_x = np.array([_crossing_x(*pair) for pair in zip(four[:-1], four[1:], strict=True)])
    lines: list[Line | None] = [_as_line(piece) for piece in four]
    for _ in range(_FIT_ROUNDS):
        lines = [
            fit_line(section.only((section.x_m > start) & (section.x_m < end)), start=line, rounds=4)
            for line, (start, end) in zip(lines, _spans(corner_x, four), strict=True)
        ]
        complaint = _complaint(lines)
        if complaint:
            return Found(reason=complaint)
        fitted = [line for line in lines if line is not None]
        corners = [crossing(*pair) for pair in zip(fitted[:-1], fitted[1:], strict=True)]
        found = tuple(corner for corner in corners if corner is not None)
        moved_x = np.array([corner.x_m for corner in found])
        if len(found) < 3 or not np.all(np.diff(moved_x) > 0) or not _turns_like_v([ln.angle_rad for ln in fitted]):
            return Found(reason="no V-groove: the lines fitted to the pieces do not form one")
        corner_x = moved_x
    if not _explains_groove(section, four, found):
        return Found(reason="no V-groove: most points between its edges lie off its walls")
    if gapped:
        found = (found[0], _open_root(section, fitted[1], fitted[2], found), found[2])
    worst = max(corner.sigma_m for corner in found)
    if worst > _MOST_SIGMA_M:
        return Found(reason=f"V-groove too uncertain: a corner has a standard deviation of {worst * 1e3:.2f} mm")
    return Found(corners=found)


def _open_root(section: Section, left_wall: Line, right_wall: Line, corners: Sequence[Corner]) -> Corner:
    """The middle between the walls' lower ends; where they cross if too little of them is seen."""
    left, crossed, right = corners
    on_left = _without_strays(_on_wall(section, left_wall, left.x_m, crossed.x_m))
    on_right = _without_strays(_on_wall(section, right_wall, crossed.x_m, right.x_m))
    if not (len(on_left) and len(on_right)):
        return crossed
    spacing_m = np.array([_spacing(on_left), _spacing(on_right)])
    ends_x = np.array([on_left[-1], on_right[0]]) + 0.5 * spacing_m * [1, -1]
    ends_z = np.array([left_wall.z_at(ends_x[0]), right_wall.z_at(ends_x[1])])
    # Each end lies anywhere within a spacing (variance 1/12), drawn out along its wall.
    slopes = np.array([left_wall.slope, right_wall.slope])
    sigma_m = float(np.sqrt(np.sum((1 + slopes**2) * spacing_m**2 / 12)) / 2)
    return Corner(x_m=float(ends_x.mean()), z_m=float(ends_z.mean()), sigma_m=float(np.hypot(sigma_m, crossed.sigma_m)))


def _on_wall(section: Section, wall: Line, first_m: float, last_m: float) -> np.ndarray:
    """x of the points that lie on a wall, rising."""
    x_m = section.x_m[(section.x_m > first_m) & (section.x_m < last_m)]
    z_m = section.z_m[(section.x_m > first_m) & (section.x_m < last_m)]
    return x_m[np.abs(z_m - wall.height_m - wall.slope * (x_m - wall.origin_m)) < _EXPLAINED_M]


def _without_strays(x_m: np.ndarray) -> np.ndarray:
    """The points but for small groups that stand apart, like those of what lies below the gap."""
    if len(x_m) < _FEWEST_ON_LINE:
        return x_m[:0]
    groups = np.split(x_m, np.flatnonzero(np.diff(x_m) > _APART_SPACINGS * _spacing(x_m)) + 1)
    kept = [group for group in groups if len(group) >= max(_FEWEST_ON_LINE, _LEAST_GROUP_SHARE * len(x_m))]
    return np.concatenate(kept) if kept else x_m[:0]


def _spacing(x_m: np.ndarray) -> float:
    return float(np.median(np.diff(x_m)))


def _explains_groove(section: Section, four: tuple[Piece, ...], corners: Sequence[Corner]) -> bool:
    """Whether most points near the groove, within its own width on both sides, lie on the four lines."""
    left, root, right = corners
    width = right.x_m - left.x_m
    ends = (max(four[0].start_m, left.x_m - width), min(four[3].end_m, right.x_m + width))
    slopes = (four[0].slope, four[3].slope)
    nodes_x = [ends[0], left.x_m, root.x_m, right.x_m, ends[1]]
    nodes_z = [left.z_m + slopes[0] * (ends[0] - left.x_m), left.z_m, root.z_m, right.z_m]
    nodes_z.append(right.z_m + slopes[1] * (ends[1] - right.x_m))
    model_z = np.interp(section.x_m, nodes_x, nodes_z)
    on_lines = np.abs(section.z_m - model_z) < _EXPLAINED_M
    return all(
        on_lines[(section.x_m > start) & (section.x_m < end)].mean() > _LEAST_GROOVE_SHARE
        for start, end in ((ends[0], ends[1]), (left.x_m, right.x_m))
    )


def _spans(corner_x: np.ndarray, four: tuple[Piece, ...]) -> list[tuple[float, float]]:
    """The x from which to which each line takes its points, clear of the corners."""
    left, root, right = corner_x
    left_guard, right_guard = (min(_GUARD_M, _GUARD_SHARE * width) for width in (root - left, right - root))
    return [
        (max(four[0].start_m, left - _PLATE_LENGTH_M), left - left_guard),
        (left + left_guard, root - left_guard),
        (root + right_guard, right - right_guard),
        (right + right_guard, min(four[3].end_m, right + _PLATE_LENGTH_M)),
    ]


def _as_line(piece: Piece) -> Line:
    return Line(
        origin_m=0.0,
        height_m=piece.intercept_m,
        slope=piece.slope,
        covariance=np.zeros((2, 2)),
        count=piece.count,
        inlier_share=1.0,
    )


def _complaint(lines: Sequence[Line | None]) -> str:
    """Why these lines cannot be trusted; empty if they can."""
    for name, line in zip(("left plate", "left wall", "right wall", "right plate"), lines, strict=True):
        if line is None or line.count < _FEWEST_ON_LINE:
            return f"no V-groove: too few points on its {name}"
        if line.inlier_share < _LEAST_INLIER_SHARE:
            return f"no V-groove: only {line.inlier_share:.0%} of the points of its {name} lie on one line"
    return ""

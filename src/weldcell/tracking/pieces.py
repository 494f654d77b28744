"""The straight pieces of a section: where a profile bends or jumps."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import median_filter

from weldcell.tracking.section import Section

_AGREEING_SHARE = 0.4
_MEDIAN_POINTS = 9
_BEND_SIGMAS = 5.0
_LEAST_BEND_M = 1e-4
_FEWEST_POINTS = 5
_SHORTEST_M = 4e-4
_SAME_LINE_RAD = math.radians(3)


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A straight piece of a section, roughly: line z = intercept_m + slope x from start_m to end_m (x)."""

    start_m: float
    end_m: float
    slope: float
    intercept_m: float
    count: int

    def z_at(self, x_m: float) -> float:
        """z of the piece's line (m)."""
        return self.intercept_m + self.slope * x_m

    @property
    def length_m(self) -> float:
        """Along the line."""
        return (self.end_m - self.start_m) * math.hypot(1, self.slope)

    @cached_property
    def angle_rad(self) -> float:
        """Inclination against x, positive where the piece gets deeper with x."""
        return math.atan(self.slope)


def straight_pieces(section: Section, *, steepest: float, neighbours: int = 6) -> list[Piece]:
    """The straight pieces from left to right, without strays and crumbs; pieces of one line are joined.

    `steepest` is the largest dz/dx that neighbours of one surface may have: the smaller, the more strays are seen.
    `neighbours` on each side tell a stray: the more, the longer runs of strays are seen, but narrow walls are lost.

    Splits the median-filtered section at its largest deviation from the chord (Ramer 1972, Douglas and Peucker
    1973) until no deviation is above the noise.
    """
    section = section.only(agrees_with_neighbours(section, steepest, neighbours))
    if len(section.x_m) < _FEWEST_POINTS:
        return []
    z_m = median_filter(section.z_m, size=_MEDIAN_POINTS, mode="nearest")
    tolerance_m = max(_LEAST_BEND_M, _BEND_SIGMAS * section.usual_sigma_m)
    return _joined(_pieces(section.x_m, z_m, _split(section.x_m, z_m, tolerance_m)), 3 * tolerance_m)


def flipped_piece(piece: Piece) -> Piece:
    """The piece in the section with left and right swapped."""
    return replace(piece, start_m=-piece.end_m, end_m=-piece.start_m, slope=-piece.slope)


def bridged(pieces: list[Piece], tolerance_m: float, widest_m: float) -> list[Piece]:
    """The unions of pieces on one line, up to `widest_m` apart in x, whatever is seen or missing between them."""
    unions: list[Piece] = []
    for at, first in enumerate(pieces):
        union = first
        for after in pieces[at + 1 :]:
            if 0 <= after.start_m - union.end_m <= widest_m and _on_one_line(union, after, tolerance_m):
                union = _union(union, after)
        if union is not first:
            unions.append(union)
    return unions


def agrees_with_neighbours(section: Section, steepest: float, neighbours: int) -> Bool[np.ndarray, "n"]:
    """Points that lie on one surface with enough of their neighbours."""
    x, z, count = section.x_m, section.z_m, len(section.x_m)
    reach, noise_m = min(neighbours, count - 1), 6 * section.usual_sigma_m if count else 0.0
    # |dz| <= steepest dx + noise: both steepest x + z and steepest x - z fall by no more than the noise
    sums, differences = steepest * x + z, steepest * x - z
    least_sums, least_differences = sums - noise_m, differences - noise_m
    agreeing = np.zeros(count, np.uint8)
    for step in range(1, reach + 1):
        close = (sums[step:] >= least_sums[:-step]) & (differences[step:] >= least_differences[:-step])
        agreeing[step:] += close
        agreeing[:-step] += close
    before = np.minimum(np.arange(count), reach)
    return agreeing >= _AGREEING_SHARE * np.maximum(before + before[::-1], 1)


def _split(x: Float[np.ndarray, "n"], z: Float[np.ndarray, "n"], tolerance_m: float) -> Int[np.ndarray, "k"]:
    """Indices at which the polyline is cut, both ends included."""
    cuts, waiting = {0, len(x) - 1}, [(0, len(x) - 1)]
    while waiting:
        start, end = waiting.pop()
        if end - start + 1 < _FEWEST_POINTS:
            continue  # a crumb, cut or not
        first_x, first_z = float(x[start]), float(z[start])
        run, rise = float(x[end]) - first_x, float(z[end]) - first_z
        off = run * z[start + 1 : end] - rise * x[start + 1 : end]  # the chord's length times the deviation, but for:
        on_chord = run * first_z - rise * first_x
        highest, lowest = int(off.argmax()), int(off.argmin())
        above, below = float(off[highest]) - on_chord, on_chord - float(off[lowest])
        if max(above, below) > tolerance_m * max(math.hypot(run, rise), 1e-12):
            middle = start + 1 + (highest if above >= below else lowest)
            cuts.add(middle)
            waiting += [(start, middle), (middle, end)]
    return np.array(sorted(cuts))


def _pieces(x: Float[np.ndarray, "n"], z: Float[np.ndarray, "n"], cuts: Int[np.ndarray, "k"]) -> list[Piece]:
    """The regression lines from each cut to the next, without crumbs."""
    first, last = cuts[:-1], cuts[1:]
    count = last - first + 1
    values = np.array([x, z, x * x, x * z])
    sums = np.add.reduceat(values[:, :-1], first, axis=1) + values[:, last]  # both ends belong to a piece
    centre_x, centre_z, mean_xx, mean_xz = sums / count
    slope = (mean_xz - centre_x * centre_z) / np.maximum(mean_xx - centre_x**2, 1e-30)
    start_m, end_m = x[first], x[last]
    substantial = (count >= _FEWEST_POINTS) & ((end_m - start_m) * np.hypot(1, slope) >= _SHORTEST_M)
    lines = np.column_stack([start_m, end_m, slope, centre_z - slope * centre_x])[substantial].tolist()
    return [
        Piece(start_m=start, end_m=end, slope=rise, intercept_m=intercept, count=points)
        for (start, end, rise, intercept), points in zip(lines, count[substantial].tolist(), strict=True)
    ]


def _joined(pieces: list[Piece], tolerance_m: float) -> list[Piece]:
    """Neighbouring pieces that lie on one line become one piece."""
    joined: list[Piece] = []
    for piece in pieces:
        if joined and _on_one_line(joined[-1], piece, tolerance_m):
            piece = _union(joined.pop(), piece)
        joined.append(piece)
    return joined


def _on_one_line(left: Piece, right: Piece, tolerance_m: float) -> bool:
    middle = (left.end_m + right.start_m) / 2
    apart_m = abs(left.z_at(middle) - right.z_at(middle)) * math.cos(left.angle_rad)
    return bool(abs(left.angle_rad - right.angle_rad) < _SAME_LINE_RAD and apart_m < tolerance_m)


def _union(left: Piece, right: Piece) -> Piece:
    """The chord of both pieces, from the start of the one to the end of the other."""
    slope = (right.z_at(right.end_m) - left.z_at(left.start_m)) / (right.end_m - left.start_m)
    return Piece(
        start_m=left.start_m,
        end_m=right.end_m,
        slope=slope,
        intercept_m=left.z_at(left.start_m) - slope * left.start_m,
        count=left.count + right.count,
    )

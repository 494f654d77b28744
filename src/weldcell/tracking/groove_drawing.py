"""The drawing of a round groove, fitted to the points between its plates."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg.lapack import dposv

from weldcell.tracking.candidates import EXPLAINED_M
from weldcell.tracking.quantiles import upper_median
from weldcell.tracking.root_gap import seen_through_gap
from weldcell.tracking.section import Section

_TUKEY = 4.685
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_LEAST_SCALE = 0.3
_FEWEST_POINTS = 25
_START_RADIUS_SHARE = 0.35  # of the groove's width
_START_WALL = 0.2  # tan of 11 degrees
_GAP_SIGMAS = 3.0
_STEEP = 2.0  # slope from which the light's blur runs along the column, with a scatter of its own
_FEWEST_ALIKE = 12
_START_SCALES_M = (1e-3, 1e-3, 1e-3, 5e-4, 5e-4, 2.5e-4)  # one round each
_ROUNDS_TO_OPEN = 3  # the last of them: a gap opens in a drawing that is nearly right
_ROUNDS = 14
_SETTLED_SIGMAS = 0.01  # length of the last step: what would follow is about as long
_LEAST_WIDTH_M = 1e-7  # noise-free points are not infinitely heavy
_MOST_CONDITION = 1e13
_SCALES = np.array([1e-3, 1e-3, 1e-3, 0.1, 0.1, 1e-3])  # of the numbers, so that they compare
_DIAGONAL = np.eye(6)
_LONGEST_STEP = 3.0  # of these scales
_WALL_SIGMA = 0.5  # of a wall's tangent that no point tells: hidden walls leave the rest determined
_UNSEEN = np.diag([0, 0, 0, 1, 1, 0]) * np.square(_SCALES / _WALL_SIGMA)
_LEAST = np.array([-np.inf, -np.inf, 5e-4, 0.02, 0.02, 0.0])
_MOST = np.array([np.inf, np.inf, 3e-2, 1.2, 1.2, np.inf])
_LEAST_LEAN = 0.05  # of the noise's direction out of the drawing
_LEAST_EXPLAINED = 0.5
_NEAR_SIGMAS = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """A round groove in the frame of its plates' mean level."""

    numbers: Float[np.ndarray, "6"]
    """Middle, depth and radius (m), tangents of the right and the left wall, half the bottom (m)."""
    covariance: Float[np.ndarray, "6 6"]
    count: int
    """Points that take part in it."""
    explained: float
    """Share of the groove's points on it."""
    higher_m: float = 0.0
    """How much higher the left member (larger s) stands, with all that is drawn of it."""

    @property
    def middle_m(self) -> float:
        """s of the bottom's middle."""
        return float(self.numbers[0])

    @property
    def depth_m(self) -> float:
        return float(self.numbers[1])

    @property
    def radius_m(self) -> float:
        return float(self.numbers[2])

    @property
    def walls(self) -> tuple[float, float]:
        """Tangents of the walls' inclinations against the depth, of the sides of smaller and larger s."""
        return float(self.numbers[3]), float(self.numbers[4])

    @property
    def half_m(self) -> float:
        """Half the distance between the circles' beginnings: half the root gap."""
        return float(self.numbers[5])

    def wall_at(self, side: int, d_m: float) -> float:
        """s of a side's wall, prolonged if need be, at depth d."""
        tangent = self.walls[0 if side < 0 else 1]
        rise_m = self.depth_m - d_m - side * self.higher_m / 2
        return self.middle_m + side * (
            self.half_m + self.radius_m * (math.hypot(1, tangent) - tangent) + rise_m * tangent
        )

    def wall_gradient(self, side: int, d_m: float) -> Float[np.ndarray, "6"]:
        """Derivatives of `wall_at` after the numbers."""
        tangent = self.walls[0 if side < 0 else 1]
        rise_m = self.depth_m - d_m - side * self.higher_m / 2
        hypotenuse = math.hypot(1, tangent)
        by_tangent = self.radius_m * (tangent / hypotenuse - 1) + rise_m
        by_walls = [by_tangent, 0.0] if side < 0 else [0.0, by_tangent]
        return np.array([side, tangent, hypotenuse - tangent, *by_walls, 1.0]) * side


def fit_drawing(
    section: Section, right_m: float, left_m: float, *, sides: tuple[bool, bool], higher_m: float = 0.0
) -> Drawing | str:
    """The drawing through points (s, d) between plates that end at s = right_m < left_m, or why there is none.

    A side without circle and wall (`sides` False, that of smaller s) ends in a square face: the middle is the place
    where the other side's circle begins, and half is 0. So it is where no half is significant: as it cannot be
    negative, noise would only ever widen the groove. The left member (larger s) stands `higher_m` above the right one,
    and d = 0 is midway between both.
    """
    lower_m = np.where(section.x_m < (right_m + left_m) / 2, -higher_m / 2, higher_m / 2)
    section = replace(section, z_m=section.z_m + lower_m)
    through = seen_through_gap(section)
    if through.any():
        section = section.only(~through)
    fitted = _fitted(section, right_m, left_m, sides)
    return fitted if isinstance(fitted, str) else replace(fitted, higher_m=higher_m)


def _fitted(section: Section, right_m: float, left_m: float, sides: tuple[bool, bool]) -> Drawing | str:
    """The drawing of points (s, d) whose members stand equally high."""
    if len(section.x_m) < _FEWEST_POINTS:
        return "too few points between its plates"
    free = np.array([True, True, True, sides[0], sides[1], False])
    rough = _roughly(section, _start(section, right_m, left_m, sides), free, sides, _START_SCALES_M)
    if all(sides) and _gap_shows(section, rough):
        opened = _roughly(section, rough, np.ones(6, bool), sides, _START_SCALES_M[-_ROUNDS_TO_OPEN:])
        gapped = _settled(section, opened, np.ones(6, bool), sides)
        if not isinstance(gapped, str) and gapped.half_m > _GAP_SIGMAS * math.sqrt(gapped.covariance[5, 5]):
            return gapped
    return _settled(section, rough, free, sides)


def _start(section: Section, right_m: float, left_m: float, sides: tuple[bool, bool]) -> Float[np.ndarray, "6"]:
    deep = len(section.z_m) * 3 // 4
    depth = float(np.partition(section.z_m, deep)[deep])
    width = left_m - right_m
    middle = (left_m + right_m) / 2 if all(sides) else right_m + 0.05 * width
    radius = _START_RADIUS_SHARE * width * (1.0 if all(sides) else 1.6)
    return np.array([middle, depth, min(radius, 0.9 * depth), _START_WALL, _START_WALL, 0.0])


def _drawn(
    numbers: Float[np.ndarray, "6"], section: Section, sides: tuple[bool, bool]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"], Float[np.ndarray, "6 n"]]:
    """How much deeper each point lies than the drawing, its sigma, and the drawing's derivatives after the numbers.

    With b the distance from where the circle begins, r the radius and m the wall's tangent, the wall is the circle's
    tangent where a = r / sqrt(1 + m^2) and a / h = 1 / m. So with a = min(b, r / sqrt(1 + m^2)) and
    h = sqrt(r^2 - a^2),

        d = depth - r + h - (b - a) a / h,

    whose derivatives after r, b and (on the wall) m are r / h - 1, -a / h and (b - a) / m^2. Beyond a square face the
    bottom goes on. The derivatives after the middle, half and radius tell the drawing's direction everywhere: they are
    -dd/ds, its magnitude, and sqrt(1 + (dd/ds)^2) - 1.
    """
    middle, depth, radius, right_wall, left_wall, half = numbers.tolist()
    beside = section.x_m - middle
    left = beside > 0
    b = np.maximum((np.abs(beside) if sides[0] else beside) - half, 0.0)
    a = np.minimum(b, np.where(left, radius / math.hypot(1, left_wall), radius / math.hypot(1, right_wall)))
    h = np.sqrt(radius**2 - a * a)
    fall, beyond = a / h, b - a
    by_numbers = np.empty((6, len(h)))
    by_numbers[0] = np.copysign(fall, beside)
    by_numbers[1] = 1.0
    by_numbers[2] = radius / h - 1
    by_numbers[3] = beyond * (~left / right_wall**2)
    by_numbers[4] = beyond * (left / left_wall**2)
    by_numbers[5] = fall
    deeper = section.z_m - (depth - radius + h - fall * beyond)
    sigma = section.sigma_m * np.maximum(np.abs(1 + by_numbers[0] * section.noise_slope), _LEAST_LEAN)
    return deeper, np.maximum(sigma, _LEAST_WIDTH_M), by_numbers


def _roughly(
    section: Section,
    numbers: Float[np.ndarray, "6"],
    free: Bool[np.ndarray, "6"],
    sides: tuple[bool, bool],
    scales_m: tuple[float, ...],
) -> Float[np.ndarray, "6"]:
    """Levenberg-Marquardt with Tukey's weights, one round with each of these scales."""
    damping = 1e-2
    for scale_m in scales_m:
        deeper, sigma, by_numbers = _drawn(numbers, section, sides)
        width = np.maximum(sigma, scale_m / 3 * (1 + by_numbers[2]))
        numbers, _ = _step(numbers, by_numbers, deeper, _weights(deeper, width), free, damping)
        damping *= 0.2
    return numbers


def _settled(
    section: Section, numbers: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"], sides: tuple[bool, bool]
) -> Drawing | str:
    """The drawing that a rough one settles at, with Tukey's weights at the residuals' own scale."""
    scale = np.ones(len(section.x_m))
    for _ in range(_ROUNDS):
        deeper, sigma, by_numbers = _drawn(numbers, section, sides)
        relative = np.abs(deeper) / sigma
        scale = _scales(relative, relative <= 3 * scale + 3, by_numbers[5] > _STEEP)
        numbers, moved = _step(numbers, by_numbers, deeper, _weights(deeper, sigma * scale), free)
        if moved < _SETTLED_SIGMAS:
            break
    return _result(section, numbers, free, sides)


def _weights(deeper: Float[np.ndarray, "n"], width: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Tukey's weight of each residual, over its variance."""
    return np.asarray(np.square(np.maximum(1 - np.square(deeper / (_TUKEY * width)), 0) / width))


def _step(
    numbers: Float[np.ndarray, "6"],
    by_numbers: Float[np.ndarray, "6 n"],
    deeper: Float[np.ndarray, "n"],
    weight: Float[np.ndarray, "n"],
    free: Bool[np.ndarray, "6"],
    damping: float = 0.0,
) -> tuple[Float[np.ndarray, "6"], float]:
    """The numbers a step on, and its length in their sigmas; those that are not free stay."""
    normal, target = _normal_equations(by_numbers, deeper, weight, free)
    step = dposv(_lifted(normal, damping), target)[1]
    moved = numbers + _SCALES * np.minimum(np.maximum(step, -_LONGEST_STEP), _LONGEST_STEP)
    moved = np.minimum(np.maximum(moved, _LEAST), _MOST)
    done = (moved - numbers) / _SCALES
    return moved, math.sqrt(max(float(done @ normal @ done), 0.0))


def _normal_equations(
    by_numbers: Float[np.ndarray, "6 n"],
    deeper: Float[np.ndarray, "n"],
    weight: Float[np.ndarray, "n"],
    free: Bool[np.ndarray, "6"],
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    """Both sides of the equations of a step, in units of `_SCALES`; rows of numbers that are not free are zero."""
    jacobian = by_numbers * (free * _SCALES)[:, None]
    weighted = jacobian * weight
    return weighted @ jacobian.T, weighted @ deeper


def _lifted(normal: Float[np.ndarray, "6 6"], damping: float = 0.0) -> Float[np.ndarray, "6 6"]:
    """Normal equations that are definite: what no point tells stays where it is."""
    return normal * (1 + damping * _DIAGONAL) + (1e-12 * float(normal.trace()) + 1e-30) * _DIAGONAL


def _gap_shows(section: Section, numbers: Float[np.ndarray, "6"]) -> bool:
    """Whether one step of Gauss and Newton from a drawing without gap opens one significantly."""
    deeper, sigma, by_numbers = _drawn(numbers, section, (True, True))
    relative = np.abs(deeper) / sigma
    scale = _scales(relative, np.isfinite(relative), by_numbers[5] > _STEEP)  # a gap left out fits nowhere
    normal, target = _normal_equations(by_numbers, deeper, _weights(deeper, sigma * scale), np.ones(6, bool))
    by_half = dposv(_lifted(normal), _DIAGONAL[5])[1]
    return bool(by_half @ target > _GAP_SIGMAS * math.sqrt(by_half[5]))


def _result(
    section: Section, numbers: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"], sides: tuple[bool, bool]
) -> Drawing | str:
    deeper, sigma, by_numbers = _drawn(numbers, section, sides)
    # Across the drawing: on a steep wall a column's step is long.
    on = np.abs(deeper) <= (1 + by_numbers[2]) * np.maximum(EXPLAINED_M, 4 * section.sigma_m)
    explained = np.count_nonzero(on) / len(on)
    if explained < _LEAST_EXPLAINED:
        return "most points between its plates do not lie on a round groove"
    relative = np.abs(deeper) / sigma
    scale = _scales(relative, relative <= _NEAR_SIGMAS, by_numbers[5] > _STEEP)
    robust = np.square(np.maximum(1 - np.square(relative / (_TUKEY * scale)), 0))
    told = np.flatnonzero(free[: 6 if numbers[5] > 0 else 5])
    normal, _ = _normal_equations(by_numbers, deeper, robust / np.square(sigma * np.maximum(scale, 1.0)), free)
    values, vectors = np.linalg.eigh((normal + _UNSEEN)[told[:, None], told])
    if not 0 < values[-1] < _MOST_CONDITION * values[0]:
        return "its points do not determine it"
    covariance = np.zeros((6, 6))
    covariance[told[:, None], told] = (vectors / values) @ vectors.T / _EFFICIENCY
    covariance *= np.outer(_SCALES, _SCALES)
    return Drawing(numbers=numbers, covariance=covariance, count=int(np.count_nonzero(robust)), explained=explained)


def _scales(
    relative: Float[np.ndarray, "n"], near: Bool[np.ndarray, "n"], steep: Bool[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """For each point the scale of the residuals of its like, steep or not, in predicted sigmas."""
    alike = relative[near & steep], relative[near & ~steep]
    of_all = 1.0 if min(map(len, alike)) >= _FEWEST_ALIKE else _scale(relative[near])
    steeps, others = (_scale(those) if len(those) >= _FEWEST_ALIKE else of_all for those in alike)
    return np.where(steep, steeps, others)


def _scale(relative: Float[np.ndarray, "n"]) -> float:
    """The scale of residuals, which may be reordered."""
    return max(_MAD_TO_SIGMA * upper_median(relative), _LEAST_SCALE) if len(relative) else 1.0

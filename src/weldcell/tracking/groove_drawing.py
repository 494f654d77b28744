"""The drawing of a round groove, fitted to the points between its plates."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from weldcell.tracking.candidates import EXPLAINED_M
from weldcell.tracking.section import Section

_TUKEY = 4.685
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_LEAST_SCALE = 0.3
_FEWEST_POINTS = 25
_START_RADIUS_SHARE = 0.35  # of the groove's width
_START_WALL = 0.2  # tan of 11 degrees
_START_SCALES_M = (1e-3, 1e-3, 1e-3, 5e-4, 5e-4, 2.5e-4)  # one round each
_ROUNDS = 20
_SETTLED = 1e-9
_LEAST_WIDTH_M = 1e-7  # noise-free points are not infinitely heavy
_MOST_CONDITION = 1e13
_WALL_SIGMA = 0.5  # of a wall's tangent that no point tells: hidden walls leave the rest determined
_STEP_M = 1e-7
_SCALES = np.array([1e-3, 1e-3, 1e-3, 0.1, 0.1, 1e-3])  # of the numbers, so that they compare
_WALL_RANGE = (0.02, 1.2)
_RADIUS_RANGE_M = (5e-4, 3e-2)
_LEAST_EXPLAINED = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawing:
    """A round groove in its plates' frame."""

    numbers: Float[np.ndarray, "6"]
    """Middle, depth and radius (m), tangents of the right and the left wall, half the bottom (m)."""
    covariance: Float[np.ndarray, "6 6"]
    count: int
    """Points that take part in it."""
    explained: float
    """Share of the groove's points on it."""

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
        return _wall_at(self.numbers, side, d_m)

    def wall_gradient(self, side: int, d_m: float) -> Float[np.ndarray, "6"]:
        """Derivatives of `wall_at` after the numbers."""
        steps = _STEP_M * np.eye(6)
        return np.array(
            [
                (_wall_at(self.numbers + h, side, d_m) - _wall_at(self.numbers - h, side, d_m)) / (2 * _STEP_M)
                for h in steps
            ]
        )


def fit_drawing(section: Section, right_m: float, left_m: float, *, sides: tuple[bool, bool]) -> Drawing | str:
    """The drawing through points (s, d) between plates that end at s = right_m < left_m, or why there is none.

    A side without circle and wall (`sides` False, that of smaller s) ends in a square face: the middle is the place
    where the other side's circle begins, and half is 0.
    """
    if len(section.x_m) < _FEWEST_POINTS:
        return "too few points between its plates"
    free = np.array([True, True, True, sides[0], sides[1], all(sides)])
    numbers = _descend(section, _start(section, right_m, left_m, sides), free, sides)
    return _result(section, numbers, free, sides)


def _start(section: Section, right_m: float, left_m: float, sides: tuple[bool, bool]) -> Float[np.ndarray, "6"]:
    depth = float(np.percentile(section.z_m, 75))
    width = left_m - right_m
    middle = (left_m + right_m) / 2 if all(sides) else right_m + 0.05 * width
    radius = _START_RADIUS_SHARE * width * (1.0 if all(sides) else 1.6)
    return np.array([middle, depth, min(radius, 0.9 * depth), _START_WALL, _START_WALL, 0.02 * width * all(sides)])


def _wall_at(numbers: Float[np.ndarray, "6"], side: int, d_m: float) -> float:
    middle, depth, radius, right_wall, left_wall, half = numbers
    tangent = left_wall if side > 0 else right_wall
    angle = np.arctan(tangent)
    start_s, start_d = half + radius * np.cos(angle), depth - radius + radius * np.sin(angle)
    return float(middle + side * (start_s + (start_d - d_m) * tangent))


def _drawn(
    numbers: Float[np.ndarray, "6"], s_m: Float[np.ndarray, "n"], sides: tuple[bool, bool]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"], Float[np.ndarray, "6 n"]]:
    """d of the drawing at each s, its slope, and its derivatives after the numbers.

    With b the distance from where the circle begins, r the radius, m the wall's tangent and c = 1 / sqrt(1 + m^2):
    d = depth - r + sqrt(r^2 - b^2) on the circle, and on the wall, from b = r c on,
    d = depth - r + r m c - (b - r c) / m = depth - r + r / (m c) - b / m. Beyond a square face the bottom goes on.
    """
    middle, depth, radius, right_wall, left_wall, half = numbers
    side = np.where(s_m < middle, -1.0, 1.0)
    tangent = np.where(side < 0, right_wall, left_wall)
    b = side * (s_m - middle) - half
    if not sides[0]:
        b = np.where(side < 0, 0.0, b)
    b = np.maximum(b, 0.0)
    hypotenuse = np.sqrt(1 + tangent**2)  # 1 / c
    wall = b > radius / hypotenuse
    height = np.sqrt(np.maximum(radius**2 - np.where(wall, 0.0, b) ** 2, 1e-16))
    d = depth - radius + np.where(wall, (radius * hypotenuse - b) / tangent, height)
    by_b = np.where(b > 0, np.where(wall, -1 / tangent, -b / height), 0.0)
    by_wall = np.where(wall, (b - radius / hypotenuse) / tangent**2, 0.0)
    by_radius = np.where(wall, hypotenuse / tangent, radius / height) - 1
    slope = by_b * side
    by_numbers = np.stack([-slope, np.ones_like(d), by_radius, by_wall * (side < 0), by_wall * (side > 0), -by_b])
    return d, slope, by_numbers


def _descend(
    section: Section, numbers: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"], sides: tuple[bool, bool]
) -> Float[np.ndarray, "6"]:
    """Levenberg-Marquardt with Tukey's weights, whose scale comes down from a millimetre to the residuals' own."""
    scale, damping = 1.0, 1e-2
    for turn in range(_ROUNDS):
        d, slope, by_numbers = _drawn(numbers, section.x_m, sides)
        sigma = section.sigma_m * np.maximum(np.abs(1 - slope * section.noise_slope), 0.05)
        residual = section.z_m - d
        if turn < len(_START_SCALES_M):
            width = np.maximum(sigma, _START_SCALES_M[turn] * np.hypot(1, slope) / 3)
        else:
            relative = np.abs(residual) / sigma
            near = relative[relative <= 3 * scale + 3]
            scale = max(_MAD_TO_SIGMA * float(np.median(near)) if len(near) else 1.0, _LEAST_SCALE)
            width = np.maximum(sigma * scale, _LEAST_WIDTH_M)
        weight = np.square(np.maximum(1 - np.square(residual / (_TUKEY * width)), 0) / width)
        jacobian = by_numbers[free] * _SCALES[free][:, None]
        weighted = jacobian * weight
        normal = weighted @ jacobian.T
        diagonal = np.diag(normal)
        normal[np.diag_indices_from(normal)] += damping * diagonal + 1e-12 * diagonal.sum() + 1e-30
        step = np.linalg.solve(normal, weighted @ residual) * _SCALES[free]
        moved = numbers.copy()
        moved[free] += np.clip(step, -3 * _SCALES[free], 3 * _SCALES[free])
        moved[3:5] = np.clip(moved[3:5], *_WALL_RANGE)
        moved[2] = np.clip(moved[2], *_RADIUS_RANGE_M)
        moved[5] = max(moved[5], 0.0)
        settled = np.abs(moved - numbers).max() < _SETTLED and turn > len(_START_SCALES_M)
        numbers = moved
        damping *= 0.2
        if settled:
            break
    return numbers


def _result(
    section: Section, numbers: Float[np.ndarray, "6"], free: Bool[np.ndarray, "6"], sides: tuple[bool, bool]
) -> Drawing | str:
    d, slope, by_numbers = _drawn(numbers, section.x_m, sides)
    residual = np.abs(section.z_m - d)
    # Across the drawing: on a steep wall a column's step is long.
    explained = float(np.mean(residual <= np.hypot(1, slope) * np.maximum(EXPLAINED_M, 4 * section.sigma_m)))
    if explained < _LEAST_EXPLAINED:
        return "most points between its plates do not lie on a round groove"
    sigma = section.sigma_m * np.maximum(np.abs(1 - slope * section.noise_slope), 0.05)
    relative = residual / np.maximum(sigma, _LEAST_WIDTH_M)
    near = relative[relative <= 10]
    scale = max(_MAD_TO_SIGMA * float(np.median(near)) if len(near) else 1.0, _LEAST_SCALE)
    robust = np.square(np.maximum(1 - np.square(relative / (_TUKEY * scale)), 0))
    free = free & np.array([True] * 5 + [numbers[5] > 0])
    jacobian = by_numbers[free] * _SCALES[free][:, None]
    normal = (jacobian * (robust / np.square(np.maximum(sigma, _LEAST_WIDTH_M)))) @ jacobian.T
    unseen = np.array([0, 0, 0, 1, 1, 0])[free] / _WALL_SIGMA**2 * np.square(_SCALES[free])
    normal[np.diag_indices_from(normal)] += unseen
    if not np.linalg.cond(normal) < _MOST_CONDITION:
        return "its points do not determine it"
    covariance = np.zeros((6, 6))
    inverse = np.linalg.inv(normal) * np.outer(_SCALES[free], _SCALES[free]) * max(scale, 1.0) ** 2 / _EFFICIENCY
    covariance[np.ix_(free, free)] = inverse
    return Drawing(numbers=numbers, covariance=covariance, count=int((robust > 0).sum()), explained=explained)

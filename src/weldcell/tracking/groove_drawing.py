"""The drawing of a round groove, fitted to the points between its plates."""

from dataclasses import dataclass, replace

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
_START_HALF_SHARE = 0.02
_GAP_SIGMAS = 3.0
_STEEP = 2.0  # slope from which the light's blur runs along the column, with a scatter of its own
_FEWEST_ALIKE = 12
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
        return _wall_at(self.numbers, side, d_m + side * self.higher_m / 2)

    def wall_gradient(self, side: int, d_m: float) -> Float[np.ndarray, "6"]:
        """Derivatives of `wall_at` after the numbers."""
        steps, at_m = _STEP_M * np.eye(6), d_m + side * self.higher_m / 2
        return np.array(
            [
                (_wall_at(self.numbers + h, side, at_m) - _wall_at(self.numbers - h, side, at_m)) / (2 * _STEP_M)
                for h in steps
            ]
        )


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
    fitted = _fitted(section, right_m, left_m, sides)
    return fitted if isinstance(fitted, str) else replace(fitted, higher_m=higher_m)


def _fitted(section: Section, right_m: float, left_m: float, sides: tuple[bool, bool]) -> Drawing | str:
    """The drawing of points (s, d) whose members stand equally high."""
    if len(section.x_m) < _FEWEST_POINTS:
        return "too few points between its plates"
    free = np.array([True, True, True, sides[0], sides[1], False])
    without = _descend(section, _start(section, right_m, left_m, sides), free, sides)
    if not all(sides) or not _gap_shows(section, without):
        return _result(section, without, free, sides)
    opened = without.copy()
    opened[5] = _START_HALF_SHARE * (left_m - right_m)
    free[5] = True
    gapped = _result(section, _descend(section, opened, free, sides, near=True), free, sides)
    if not isinstance(gapped, str) and gapped.half_m > _GAP_SIGMAS * np.sqrt(gapped.covariance[5, 5]):
        return gapped
    free[5] = False
    return _result(section, without, free, sides)


def _start(section: Section, right_m: float, left_m: float, sides: tuple[bool, bool]) -> Float[np.ndarray, "6"]:
    depth = float(np.percentile(section.z_m, 75))
    width = left_m - right_m
    middle = (left_m + right_m) / 2 if all(sides) else right_m + 0.05 * width
    radius = _START_RADIUS_SHARE * width * (1.0 if all(sides) else 1.6)
    return np.array([middle, depth, min(radius, 0.9 * depth), _START_WALL, _START_WALL, 0.0])


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
    section: Section,
    numbers: Float[np.ndarray, "6"],
    free: Bool[np.ndarray, "6"],
    sides: tuple[bool, bool],
    *,
    near: bool = False,
) -> Float[np.ndarray, "6"]:
    """Levenberg-Marquardt with Tukey's weights, whose scale comes down from a millimetre to the residuals' own.

    A start that is `near` needs the later ones of these scales only.
    """
    scale, damping = np.ones(len(section.x_m)), 1e-2
    for turn in range(len(_START_SCALES_M) // 2 if near else 0, _ROUNDS):
        d, slope, by_numbers = _drawn(numbers, section.x_m, sides)
        sigma = section.sigma_m * np.maximum(np.abs(1 - slope * section.noise_slope), 0.05)
        residual = section.z_m - d
        if turn < len(_START_SCALES_M):
            width = np.maximum(sigma, _START_SCALES_M[turn] * np.hypot(1, slope) / 3)
        else:
            relative = np.abs(residual) / sigma
            scale = _scales(relative, relative <= 3 * scale + 3, np.abs(slope) > _STEEP)
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


def _gap_shows(section: Section, numbers: Float[np.ndarray, "6"]) -> bool:
    """Whether one step of Gauss and Newton from a drawing without gap opens one significantly."""
    d, slope, by_numbers = _drawn(numbers, section.x_m, (True, True))
    residual = section.z_m - d
    sigma = np.maximum(section.sigma_m * np.maximum(np.abs(1 - slope * section.noise_slope), 0.05), _LEAST_WIDTH_M)
    relative = np.abs(residual) / sigma
    width = sigma * _scales(relative, np.isfinite(relative), np.abs(slope) > _STEEP)  # a gap left out fits nowhere
    weight = np.square(np.maximum(1 - np.square(residual / (_TUKEY * width)), 0) / width)
    jacobian = by_numbers * _SCALES[:, None]
    inverse = np.linalg.pinv((jacobian * weight) @ jacobian.T)
    half = inverse[5] @ ((jacobian * weight) @ residual)
    return bool(half > _GAP_SIGMAS * np.sqrt(max(inverse[5, 5], 0.0)))


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
    scale = _scales(relative, relative <= _NEAR_SIGMAS, np.abs(slope) > _STEEP)
    robust = np.square(np.maximum(1 - np.square(relative / (_TUKEY * scale)), 0))
    free = free & np.array([True] * 5 + [numbers[5] > 0])
    jacobian = by_numbers[free] * _SCALES[free][:, None]
    width = np.maximum(sigma * np.maximum(scale, 1.0), _LEAST_WIDTH_M)
    normal = (jacobian * (robust / np.square(width))) @ jacobian.T
    unseen = np.array([0, 0, 0, 1, 1, 0])[free] / _WALL_SIGMA**2 * np.square(_SCALES[free])
    normal[np.diag_indices_from(normal)] += unseen
    if not np.linalg.cond(normal) < _MOST_CONDITION:
        return "its points do not determine it"
    covariance = np.zeros((6, 6))
    inverse = np.linalg.inv(normal) * np.outer(_SCALES[free], _SCALES[free]) / _EFFICIENCY
    covariance[np.ix_(free, free)] = inverse
    return Drawing(numbers=numbers, covariance=covariance, count=int((robust > 0).sum()), explained=explained)


def _scales(
    relative: Float[np.ndarray, "n"], near: Bool[np.ndarray, "n"], steep: Bool[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """For each point the scale of the residuals of its like, steep or not, in predicted sigmas."""
    scale = np.full(len(relative), _scale(relative[near]))
    for alike in (steep, ~steep):
        if np.count_nonzero(near & alike) >= _FEWEST_ALIKE:
            scale[alike] = _scale(relative[near & alike])
    return scale


def _scale(relative: Float[np.ndarray, "n"]) -> float:
    if not len(relative):
        return 1.0
    middle = len(relative) // 2
    return max(_MAD_TO_SIGMA * float(np.partition(relative, middle)[middle]), _LEAST_SCALE)

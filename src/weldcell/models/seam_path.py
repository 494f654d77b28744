"""Paths of seams: where a joint's section stands at each place, and how it is turned.

A path is led by x, from -length/2 to length/2 and some way beyond. At each place the section stands across the path:
its first axis points to the left of travel, its second one upright. Paths in a plane are curves y(x), upright is z. A
path on a surface z(x, y) lies over a plane one, upright is the surface's normal; the tangent is perpendicular to that
anyway, so that the frame turns with the surface and with nothing else.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float
from scipy.integrate import cumulative_simpson
from scipy.optimize import brentq

from weldcell.cell.errors import BadGeometry

_LARGEST_SIZE_M = 10.0
_STEEPEST_RAD = np.deg2rad(60)  # of an arc at its ends: not much further, x no longer leads the path


@dataclass(frozen=True, kw_only=True, eq=False)
class PathFrames:
    """Where the section stands at n places of a path, in the part frame."""

    points: Float[np.ndarray, "n 3"]
    """The path's points, m."""
    tangents: Float[np.ndarray, "n 3"]
    """Unit directions of travel."""
    lefts: Float[np.ndarray, "n 3"]
    """Unit directions to the left of travel."""
    ups: Float[np.ndarray, "n 3"]
    """Unit upright directions: tangent x left."""

    def place(self, section: Float[np.ndarray, "*n k 2"]) -> Float[np.ndarray, "n k 3"]:
        """Points of a section (to the left, upright; m) at each place; sections may differ from place to place."""
        across, up = section[..., :1], section[..., 1:]
        return self.points[:, None] + across * self.lefts[:, None] + up * self.ups[:, None]

    def direct(self, direction: Float[np.ndarray, "2"]) -> Float[np.ndarray, "n 3"]:
        """A direction of the section (to the left, upright) at each place."""
        return direction[0] * self.lefts + direction[1] * self.ups


class SeamPath(Protocol):
    """Anything that a section can be led along."""

    @property
    def length_m(self) -> float:
        """The part's length along x."""
        ...

    def frames(self, x: Float[np.ndarray, "n"]) -> PathFrames:
        """Where the section stands at these x (m)."""
        ...


@dataclass(frozen=True, kw_only=True)
class PlanePath(ABC):
    """A curve y(x) in the plane z = 0, its section upright along z."""

    length_m: float
    """The part's length along x."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not np.isfinite(value) or abs(value) > _LARGEST_SIZE_M:
                raise BadGeometry(f"path: {name} is {value}, expected a finite number up to {_LARGEST_SIZE_M}")
        if self.length_m <= 0:
            raise BadGeometry(f"path: length_m is {self.length_m}, expected it positive")

    @abstractmethod
    def height(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """y(x), m."""

    @abstractmethod
    def slope(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """y'(x)."""

    @property
    @abstractmethod
    def largest_curvature(self) -> float:
        """Of the bends to either side, 1/m."""

    @property
    def farthest_x(self) -> float:
        """How far beyond its ends the path is known, as |x|."""
        return np.inf

    def offset(self, x: Float[np.ndarray, "n"], to_left_m: float) -> Float[np.ndarray, "n 2"]:
        """Points `to_left_m` beside the path, measured along its normal at `x`."""
        slope = self.slope(x)
        normal = np.stack([-slope, np.ones_like(slope)], axis=-1) / np.sqrt(1 + slope**2)[:, None]
        return np.stack([x, self.height(x)], axis=-1) + to_left_m * normal

    def frames(self, x: Float[np.ndarray, "n"]) -> PathFrames:
        """Where the section stands at these x (m)."""
        slope, zero = self.slope(x), np.zeros_like(x)
        tangents = np.column_stack([np.ones_like(x), slope, zero]) / np.sqrt(1 + slope**2)[:, None]
        lefts = np.column_stack([-tangents[:, 1], tangents[:, 0], zero])
        points = np.column_stack([x, self.height(x), zero])
        return PathFrames(points=points, tangents=tangents, lefts=lefts, ups=np.tile([0.0, 0.0, 1.0], (len(x), 1)))


@dataclass(frozen=True, kw_only=True)
class StraightPath(PlanePath):
    """The x axis."""

    def height(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Nothing."""
        return np.zeros_like(x)

    def slope(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Nothing."""
        return np.zeros_like(x)

    @property
    def largest_curvature(self) -> float:
        """Nothing."""
        return 0.0


@dataclass(frozen=True, kw_only=True)
class ArcPath(PlanePath):
    """An arc of a circle whose middle heads along x, as far to the left of the x axis as to its right."""

    radius_m: float
    """Radius; positive bends to the left, negative to the right."""

    def __post_init__(self) -> None:
        super().__post_init__()
        least = self.length_m / 2 / np.sin(_STEEPEST_RAD)
        if abs(self.radius_m) < least:
            raise BadGeometry(
                f"arc: radius_m is {self.radius_m:.4g}, expected {least:.4g} or more to cross a part of "
                f"{self.length_m:.4g} m"
            )

    def height(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """The circle through the two points at half the sagitta on either side, m."""
        radius = abs(self.radius_m)
        sagitta = radius - np.sqrt(radius**2 - (self.length_m / 2) ** 2)
        return np.sign(self.radius_m) * (radius - np.sqrt(radius**2 - x**2) - sagitta / 2)

    def slope(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Tangent of the angle by which the arc has turned."""
        return np.sign(self.radius_m) * x / np.sqrt(self.radius_m**2 - x**2)

    @property
    def largest_curvature(self) -> float:
        """The circle's."""
        return 1 / abs(self.radius_m)

    @property
    def farthest_x(self) -> float:
        """Short of where the circle turns back."""
        return 0.995 * abs(self.radius_m)


@dataclass(frozen=True, kw_only=True)
class SPath(PlanePath):
    """The path y(x) = amplitude sin(2 pi x / length): one period."""

    amplitude_m: float
    """How far it swings to either side."""

    def height(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """The sine."""
        return self.amplitude_m * np.sin(2 * np.pi * x / self.length_m)

    def slope(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Its derivative."""
        k = 2 * np.pi / self.length_m
        return self.amplitude_m * k * np.cos(k * x)

    @property
    def largest_curvature(self) -> float:
        """At the crests: |y''| = A k^2 where y' = 0."""
        return abs(self.amplitude_m) * (2 * np.pi / self.length_m) ** 2


def arc_length(path: SeamPath, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Length of the path from the first of these x to each, m (Simpson's rule over dx / tangent_x)."""
    return cumulative_simpson(1 / path.frames(x).tangents[:, 0], x=x, initial=0)


def stretch_within(
    lines_at: Callable[[Float[np.ndarray, "n"]], Float[np.ndarray, "n k 3"]], half_length_m: float, reach_m: float
) -> tuple[float, float]:
    """The stretch of the path (its x) on which all of the k lines lie within |x| <= `half_length_m`.

    No line is more than `reach_m` from its place on the path, and all run forwards.
    """

    def crossing(line: int, x: float) -> float:
        def beyond(place: float) -> float:
            return float(lines_at(np.array([place]))[0, line, 0]) - x

        return brentq(beyond, x - 2 * reach_m - 1e-6, x + 2 * reach_m + 1e-6, xtol=1e-13)

    lines = range(lines_at(np.zeros(1)).shape[1])
    start = max(-half_length_m, *(crossing(line, -half_length_m) for line in lines))
    return start, min(half_length_m, *(crossing(line, half_length_m) for line in lines))

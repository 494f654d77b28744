"""The path that a torch was taught, with left and up at each place: the coordinates in which a seam is followed.

A point near the path has an arc length s and two deviations, lateral to the left and vertical upwards, in the plane
square to the path at s. Beyond its ends the path goes on straight, its left and up unchanged.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from weldcell.cell.errors import BadGeometry

_SPACING_M = 1e-3  # of the table: a cubic between its nodes errs by (curvature x spacing)^4 / 384
_NEWTON_STEPS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPlaces:
    """What a path is like at m places, in the base."""

    points: Float[np.ndarray, "m 3"]
    lefts: Float[np.ndarray, "m 3"]
    """Unit directions to the left of travel."""
    ups: Float[np.ndarray, "m 3"]
    """Unit directions upwards: tangent x left."""
    steps: Float[np.ndarray, "m 3"]
    """Derivatives of the points by arc length: the tangents."""
    bends: Float[np.ndarray, "m 3"]
    """Second derivatives of the points, 1/m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TaughtPath:
    """A smooth path through taught points (cubic splines), straight beyond its ends."""

    arc_length_m: Float[np.ndarray, "n"]
    """Increasing distance along the path; at least two values."""
    points_base: Float[np.ndarray, "n 3"]
    """Points of the path (m)."""
    lefts_base: Float[np.ndarray, "n 3"]
    """Directions to the left of travel; what they have along the path is taken off."""
    ups_base: Float[np.ndarray, "n 3"]
    """Directions upwards; only their side counts, up is tangent x left."""
    _table: Float[np.ndarray, "4 k 9"] = field(init=False, repr=False)
    """Cubic coefficients of points, lefts and ups on even pieces, the highest power first."""

    def __post_init__(self) -> None:
        count = len(self.arc_length_m)
        if count < 2 or not np.all(np.diff(self.arc_length_m) > 0):
            raise BadGeometry("taught path: arc_length_m must be increasing and have two values or more")
        for name in ("points_base", "lefts_base", "ups_base"):
            rows = getattr(self, name)
            if rows.shape != (count, 3) or not np.all(np.isfinite(rows)):
                raise BadGeometry(f"taught path: {name} must be {count} rows of 3 finite numbers, found {rows.shape}")
        object.__setattr__(self, "_table", self._tabulated())

    @property
    def start_m(self) -> float:
        """Arc length of the first taught point."""
        return float(self.arc_length_m[0])

    @property
    def end_m(self) -> float:
        """Arc length of the last taught point."""
        return float(self.arc_length_m[-1])

    def places(self, arc_length_m: Float[np.ndarray, "m"]) -> PathPlaces:
        """Points, directions and derivatives at these arc lengths."""
        inside = np.minimum(np.maximum(arc_length_m, self.start_m), self.end_m)
        size = (self.end_m - self.start_m) / self._table.shape[1]
        piece = np.minimum(((inside - self.start_m) / size).astype(int), self._table.shape[1] - 1)
        x = (inside - self.start_m - piece * size)[:, None]
        c3, c2, c1, c0 = self._table[:, piece]
        values = ((c3 * x + c2) * x + c1) * x + c0
        cubic, square = 3 * x * c3[:, :3], c2[:, :3]
        steps = (cubic + 2 * square) * x + c1[:, :3]
        beyond = (arc_length_m - inside)[:, None]
        bends = 2 * (cubic + square) * (beyond == 0)
        points = values[:, :3] + beyond * steps
        return PathPlaces(points=points, lefts=values[:, 3:6], ups=values[:, 6:], steps=steps, bends=bends)

    def tangent_at(self, arc_length_m: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """Unit directions of travel."""
        steps = self.places(arc_length_m).steps
        return steps / np.linalg.norm(steps, axis=1, keepdims=True)

    def place(
        self,
        arc_length_m: Float[np.ndarray, "m"],
        lateral_m: Float[np.ndarray, "m"],
        vertical_m: Float[np.ndarray, "m"],
    ) -> Float[np.ndarray, "m 3"]:
        """Points at these arc lengths and deviations, in the base."""
        at = self.places(arc_length_m)
        return at.points + lateral_m[:, None] * at.lefts + vertical_m[:, None] * at.ups

    def project(
        self, points_base: Float[np.ndarray, "m 3"]
    ) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
        """Arc length, lateral and vertical deviation of points, from their nearest places on the path."""
        offsets = points_base[:, None] - self._table[3, None, :, :3]
        size = (self.end_m - self.start_m) / self._table.shape[1]
        nearest = self.start_m + size * np.argmin(np.einsum("mkc,mkc->mk", offsets, offsets), axis=1)
        arc_length_m, at = self.foot(points_base, nearest)
        deviations = points_base - at.points
        return (
            arc_length_m,
            np.einsum("mc,mc->m", deviations, at.lefts),
            np.einsum("mc,mc->m", deviations, at.ups),
        )

    def foot(
        self, points_base: Float[np.ndarray, "m 3"], near_m: Float[np.ndarray, "m"], steps: int = _NEWTON_STEPS
    ) -> tuple[Float[np.ndarray, "m"], PathPlaces]:
        """Arc lengths where points lie square to the path, by Newton's method from near ones, and the path there."""
        arc_length_m = near_m
        for _ in range(steps):
            at = self.places(arc_length_m)
            offsets = points_base - at.points
            along = np.einsum("mc,mc->m", offsets, at.steps)
            slope = np.einsum("mc,mc->m", at.steps, at.steps) - np.einsum("mc,mc->m", offsets, at.bends)
            arc_length_m = arc_length_m + along / np.maximum(slope, 0.1)  # at the centre of a bend any place is as near
        return arc_length_m, self.places(arc_length_m)

    def _tabulated(self) -> Float[np.ndarray, "4 k 9"]:
        """Splines through taught points and directions, laid on an even table with directions square and unit."""
        arc_length_m = self.arc_length_m
        pieces = max(1, int(np.ceil((arc_length_m[-1] - arc_length_m[0]) / _SPACING_M)))
        at = np.linspace(arc_length_m[0], arc_length_m[-1], pieces + 1)
        line = CubicSpline(arc_length_m, self.points_base)
        tangents = line.derivative()(at)
        lengths = np.linalg.norm(tangents, axis=1, keepdims=True)
        if not np.all(lengths > 1e-3):
            raise BadGeometry("taught path: points_base stand still, expected them to go on with arc_length_m")
        tangents = tangents / lengths
        lefts = CubicSpline(arc_length_m, self.lefts_base)(at)
        lefts = lefts - np.einsum("mc,mc->m", lefts, tangents)[:, None] * tangents
        widths = np.linalg.norm(lefts, axis=1, keepdims=True)
        if not np.all(widths > 1e-3):
            raise BadGeometry("taught path: lefts_base run along the path, expected them across it")
        lefts = lefts / widths
        ups = np.cross(tangents, lefts)
        if np.any(np.einsum("mc,mc->m", ups, CubicSpline(arc_length_m, self.ups_base)(at)) <= 0):
            raise BadGeometry("taught path: ups_base point down, expected them along tangent x left")
        splines = CubicSpline(at, np.column_stack([line(at), lefts, ups]))
        return np.asarray(splines.c)

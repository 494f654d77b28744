"""A seam as a line in space for each of its features, indexed by arc length."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from weldcell.cell.errors import BadGeometry


@dataclass(frozen=True, kw_only=True, eq=False)
class Seam:
    """Lines of a seam's features (e.g. left, root, right), all sampled at the same arc lengths."""

    arc_length_m: Float[np.ndarray, "n"]
    """Increasing distance along the seam."""
    points: Mapping[str, Float[np.ndarray, "n 3"]]
    """For each feature the points in one frame (the holder's name says which), m."""
    approach: Float[np.ndarray, "n 3"] | None = None
    """Unit directions out of the joint, against which a torch points, in the same frame; None where nobody knows."""

    def __post_init__(self) -> None:
        if len(self.arc_length_m) < 2 or not np.all(np.diff(self.arc_length_m) > 0):
            raise BadGeometry("seam: arc_length_m must be increasing and have two values or more")
        for name, points in self.points.items():
            if points.shape != (len(self.arc_length_m), 3):
                raise BadGeometry(f"seam: {name} has shape {points.shape}, expected ({len(self.arc_length_m)}, 3)")
        if self.approach is not None and self.approach.shape != (len(self.arc_length_m), 3):
            raise BadGeometry(f"seam: approach has shape {self.approach.shape}, expected ({len(self.arc_length_m)}, 3)")

    def at(self, name: str, arc_length_m: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """Points of one feature at these arc lengths (cubic interpolation; ends are extrapolated)."""
        return self._splines[name](arc_length_m)

    def approach_at(self, arc_length_m: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """Unit directions out of the joint at these arc lengths; refused where none are known."""
        if self.approach is None:
            raise BadGeometry("seam: its approach is not known")
        approach = CubicSpline(self.arc_length_m, self.approach)(arc_length_m)
        return approach / np.linalg.norm(approach, axis=1, keepdims=True)

    @cached_property
    def _splines(self) -> dict[str, CubicSpline]:
        return {name: CubicSpline(self.arc_length_m, points) for name, points in self.points.items()}


def length_along(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Distance along a polyline from its first point to each (m)."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def distance_to_polyline(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n"]:
    """Distance of each point to the nearest place of a polyline (all m, one frame)."""
    return np.linalg.norm(points - nearest_on_polyline(points, line), axis=-1)


def nearest_on_polyline(points: Float[np.ndarray, "n 3"], line: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n 3"]:
    """The nearest place of a polyline to each point (all m, one frame)."""
    starts, steps = line[:-1], np.diff(line, axis=0)
    offsets = points[:, None] - starts
    along = np.einsum("nmk,mk->nm", offsets, steps) / np.einsum("mk,mk->m", steps, steps)
    feet = starts + np.clip(along, 0, 1)[..., None] * steps
    nearest = np.argmin(np.sum((points[:, None] - feet) ** 2, axis=-1), axis=1)
    return feet[np.arange(len(points)), nearest]

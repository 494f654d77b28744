"""A boss (square frustum on a plate) measured from its planes: slanted edges and dihedral angles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.tracking.planes import Plane

_MOST_PARALLEL_RAD = np.deg2rad(3)
_SLANT_RAD = (np.deg2rad(15), np.deg2rad(88))
_LEAST_HEIGHT_M = 1e-3
_MOST_AZIMUTH_GAP_RAD = np.deg2rad(150)  # between neighbouring slanted faces of one boss


@dataclass(frozen=True, kw_only=True)
class BossMeasure:
    """Dimensions of a boss; NaN where not valid."""

    edge_lengths_m: Float[np.ndarray, "4"]
    """Of the slanted edges, between the base plane and the top plane; edge i lies between faces i and i + 1."""
    dihedral_angles_rad: Float[np.ndarray, "4"]
    """Between the top plane (or the base, which is parallel) and each slanted face."""
    base_corners: Float[np.ndarray, "4 3"]
    """Lower ends of the slanted edges, m, in the frame of the planes."""
    top_corners: Float[np.ndarray, "4 3"]
    """Upper ends of the slanted edges."""
    valid: bool
    reason: str = ""
    """Why the boss was not measured, if it was not."""


def measure_boss(planes: Sequence[Plane]) -> BossMeasure:
    """Edges and angles of the boss that these planes bound; the planes' normals must point outwards.

    The top is the highest of the level planes and the base the next one below (a table that stands out beneath is
    neither); the four largest slanted planes, in order of their azimuth about the base's normal, are the sides.
    """
    pair = _base_and_top(planes)
    if pair is None:
        return _invalid(f"no base and top: of {len(planes)} planes no two are parallel, one above the other")
    base, top = pair
    sides = _sides(planes, base)
    if len(sides) < 4:
        return _invalid(f"{len(sides)} slanted faces of {len(planes)} planes, a boss has four")
    azimuths = _azimuths(sides, base)
    gaps = np.diff(np.append(azimuths, azimuths[0] + 2 * np.pi))
    if gaps.max() > _MOST_AZIMUTH_GAP_RAD:
        return _invalid(f"the slanted faces leave {np.rad2deg(gaps.max()):.0f} deg open: they do not surround the boss")
    around = [(sides[i], sides[(i + 1) % 4]) for i in range(4)]
    try:
        base_corners = np.array([_common_point(first, second, base) for first, second in around])
        top_corners = np.array([_common_point(first, second, top) for first, second in around])
    except np.linalg.LinAlgError:
        return _invalid("two neighbouring slanted faces are parallel")
    return BossMeasure(
        edge_lengths_m=np.linalg.norm(top_corners - base_corners, axis=1),
        dihedral_angles_rad=np.array([_angle(side, top) for side in sides]),
        base_corners=base_corners,
        top_corners=top_corners,
        valid=True,
    )


def _base_and_top(planes: Sequence[Plane]) -> tuple[Plane, Plane] | None:
    """The highest of the level planes and the next below it, lower one first."""
    for reference in sorted(planes, key=lambda plane: -_area(plane)):
        level = [plane for plane in planes if _angle(plane, reference) < _MOST_PARALLEL_RAD]
        heights = np.array([float(reference.normal @ plane.centre) for plane in level])
        below = heights < heights.max() - _LEAST_HEIGHT_M
        if below.any():
            base = int(np.argmax(np.where(below, heights, -np.inf)))
            return level[base], level[int(np.argmax(heights))]
    return None


def _area(plane: Plane) -> int:
    return int(plane.inliers.sum())


def _sides(planes: Sequence[Plane], base: Plane) -> list[Plane]:
    """The four slanted faces with the most points, in order of azimuth."""
    low, high = _SLANT_RAD
    slanted = [plane for plane in planes if low < _angle(plane, base) < high]
    largest = sorted(slanted, key=lambda plane: -_area(plane))[:4]
    return [largest[i] for i in np.argsort(_raw_azimuths(largest, base))] if largest else []


def _raw_azimuths(sides: Sequence[Plane], base: Plane) -> Float[np.ndarray, "k"]:
    """Direction of each side's normal about the base's normal (rad), from a fixed direction in the base."""
    axis = np.eye(3)[int(np.argmin(np.abs(base.normal)))]
    first = axis - base.normal * (axis @ base.normal)
    first /= np.linalg.norm(first)
    second = np.cross(base.normal, first)
    normals = np.array([side.normal for side in sides])
    return np.arctan2(normals @ second, normals @ first)


def _azimuths(sides: Sequence[Plane], base: Plane) -> Float[np.ndarray, "k"]:
    return np.sort(_raw_azimuths(sides, base))


def _angle(first: Plane, second: Plane) -> float:
    """Angle between the outward normals (rad), exact also for nearly parallel planes."""
    return float(np.arctan2(np.linalg.norm(np.cross(first.normal, second.normal)), first.normal @ second.normal))


def _common_point(*planes: Plane) -> Float[np.ndarray, "3"]:
    return np.linalg.solve(np.array([plane.normal for plane in planes]), np.array([plane.offset_m for plane in planes]))


def _invalid(reason: str) -> BossMeasure:
    return BossMeasure(
        edge_lengths_m=np.full(4, np.nan),
        dihedral_angles_rad=np.full(4, np.nan),
        base_corners=np.full((4, 3), np.nan),
        top_corners=np.full((4, 3), np.nan),
        valid=False,
        reason=reason,
    )

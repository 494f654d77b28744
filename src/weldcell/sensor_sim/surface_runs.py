"""Which neighbouring points of a light section lie on one continuous surface."""

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.sensor_sim.light_section import LightSection

_SMOOTH_M = 20e-6  # neighbours closer than this to each other's tangents are one surface (0.2 px)
_CORNER_MARGIN = 1.0  # spacings of rays by which the crossing of two tangents may miss the gap between their rays


def surface_runs(section: LightSection, rays: Int[np.ndarray, "n"]) -> list[slice]:
    """Stretches of two or more of these rays (in order) that are neighbours and land on one continuous surface."""
    linked = np.diff(rays, append=-1) == 1
    first = np.flatnonzero(linked)
    linked[first] = _continuous(section, rays[first])
    edges = np.diff(np.concatenate([[0], linked.astype(np.int8)]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [slice(start, end + 1) for start, end in zip(starts, ends, strict=True)]


def _continuous(section: LightSection, first: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Whether the lit points of rays i and i + 1 belong to one surface, smooth or with a corner between.

    Within the light sheet, both tangents then either nearly hold both points, or cross between the two rays. At a step
    they cross elsewhere or not at all, however steep the surfaces are.
    """
    second = first + 1
    light, sheet_normal = section.directions_camera[first], section.sheet_normals_camera[first]
    axes = np.stack([np.cross(sheet_normal, light), light], axis=1)  # seen from the first point: across, along the ray
    step, light_second = (
        _within(axes, v) for v in (section.points_camera[second] - section.points_camera[first],
                                   section.directions_camera[second])
    )  # fmt: skip
    with np.errstate(divide="ignore", invalid="ignore"):
        normal, normal_second = (_unit(_within(axes, section.normals_camera[rays])) for rays in (first, second))
        tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
        off_first, off_second = np.sum(step * normal, axis=1), np.sum(step * normal_second, axis=1)
        crossing = (off_second / np.sum(tangent * normal_second, axis=1))[:, None] * tangent
        from_first, from_second = crossing[:, 0], _across(crossing - step, _unit(light_second))
        spacing = from_first - from_second  # of the two rays there; it changes sign beyond the light's source
        place = from_first / spacing
    corner = (place > -_CORNER_MARGIN) & (place < 1 + _CORNER_MARGIN) & (spacing * step[:, 0] > 0)
    return corner | ((np.abs(off_first) < _SMOOTH_M) & (np.abs(off_second) < _SMOOTH_M))


def _within(axes: Float[np.ndarray, "n 2 3"], vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    return np.einsum("nij,nj->ni", axes, vectors)


def _unit(vectors: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _across(points: Float[np.ndarray, "n 2"], light: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    """Distance of points from rays of this direction through the origin, positive as the first axis."""
    return points[:, 0] * light[:, 1] - points[:, 1] * light[:, 0]

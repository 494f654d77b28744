"""The boss: a square frustum on a base slab."""

import math

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadGeometry
from weldcell.models.workpiece import Workpiece

_SIGNS = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], float)  # counter-clockwise seen from above


def boss(
    slant_edge_m: float, slope_rad: float, top_m: float, base_margin_m: float = 0.02, base_height_m: float = 0.015
) -> Workpiece:
    """The frustum whose slanted edges have length `slant_edge_m` and whose faces rise at `slope_rad`.

    Corners `top` and `foot` run counter-clockwise from (+x, +y), seen from above; slanted edge k joins top[k] and
    foot[k]. Planes: `top`, `base` (the slab's upper side) and the slants `+x`, `+y`, `-x`, `-y`.
    """
    lengths = (slant_edge_m, top_m, base_margin_m, base_height_m)
    if not all(math.isfinite(value) and value > 0 for value in lengths):
        raise BadGeometry(f"boss: expected positive lengths, found {lengths} m")
    if not 0 < slope_rad < math.pi / 2:
        raise BadGeometry(f"boss: expected a slope between 0 and 90 deg, found {math.degrees(slope_rad):.4g} deg")
    height_m = frustum_height(slant_edge_m, slope_rad)
    half_top = top_m / 2
    half_foot = half_top + height_m / math.tan(slope_rad)
    half_slab = half_foot + base_margin_m
    top_z = base_height_m + height_m
    rings = np.stack(
        [
            _square(half_slab, 0.0),
            _square(half_slab, base_height_m),
            _square(half_foot, base_height_m),
            _square(half_top, top_z),
        ]
    )
    return Workpiece(
        name="boss",
        vertices_part=rings.reshape(-1, 3),
        faces=_faces(len(rings)),
        corners_part={"top": rings[3], "foot": rings[2]},
        planes_part=_planes(slope_rad, half_foot, base_height_m, top_z),
    )


def frustum_height(slant_edge_m: float, slope_rad: float) -> float:
    """Height of a square frustum: edge = h sqrt(1 + 2 cot(slope)^2), by Pythagoras along a corner's edge."""
    return slant_edge_m / math.sqrt(1 + 2 / math.tan(slope_rad) ** 2)


def _square(half_m: float, z_m: float) -> Float[np.ndarray, "4 3"]:
    return np.column_stack([half_m * _SIGNS, np.full(4, z_m)])


def _faces(rings: int) -> np.ndarray:
    """Quads between neighbouring rings of four, as triangles, with the first and last ring closed."""
    faces = [(0, 2, 1), (0, 3, 2)]
    for low in range(0, 4 * (rings - 1), 4):
        for k in range(4):
            a, b = low + k, low + (k + 1) % 4
            faces += [(a, b, b + 4), (a, b + 4, a + 4)]
    last = 4 * (rings - 1)
    return np.array([*faces, (last, last + 1, last + 2), (last, last + 2, last + 3)])


def _planes(slope_rad: float, half_foot: float, base_z: float, top_z: float) -> dict[str, Float[np.ndarray, "4"]]:
    planes = {"top": np.array([0, 0, 1, top_z]), "base": np.array([0, 0, 1, base_z])}
    for name, (x, y) in {"+x": (1, 0), "+y": (0, 1), "-x": (-1, 0), "-y": (0, -1)}.items():
        normal = np.array([x * math.sin(slope_rad), y * math.sin(slope_rad), math.cos(slope_rad)])
        planes[name] = np.array([*normal, normal @ [x * half_foot, y * half_foot, base_z]])
    return planes

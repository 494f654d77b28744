"""Parts cut across the plane path of their joint, which is written anew from the curves' definitions."""

import numpy as np
import trimesh

from weldcell.models.seam_path import SPath, StraightPath


def place_and_axes(path, x):
    """Point, travel and left of a path."""
    if isinstance(path, StraightPath):
        y, slope = 0.0, 0.0
    elif isinstance(path, SPath):
        k = 2 * np.pi / path.length_m
        y, slope = path.amplitude_m * np.sin(k * x), path.amplitude_m * k * np.cos(k * x)
    else:
        r = path.radius_m
        angle, end = np.arcsin(x / r), np.arcsin(path.length_m / 2 / r)
        y, slope = r * (1 - np.cos(angle)) - r * (1 - np.cos(end)) / 2, np.tan(angle)
    tangent = np.array([1, slope, 0]) / np.hypot(1, slope)
    return np.array([x, y, 0]), tangent, np.array([-tangent[1], tangent[0], 0])


def segments_mm(part, path, x):
    """Segments (left, up) of the mesh cut across the path at x."""
    point, tangent, left = place_and_axes(path, x)
    lines = trimesh.intersections.mesh_plane(part.mesh_part(), tangent, point)
    return 1e3 * np.stack([(lines - point) @ left, lines[..., 2]], axis=-1)


def slice_mm(part, path, x):
    """Ends of those segments, within 29 mm of the path."""
    ends = segments_mm(part, path, x).reshape(-1, 2)
    return ends[np.abs(ends[:, 0]) < 29]

"""The truth about a seam in one picture: where the light plane cuts its exact lines, lit and seen or not."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.rays import RayCaster

_OWN_EDGE_M = 50e-6
"""What ends this close to a feature is the edge or the valley that the feature lies on.

The mesh's chords stray by 0.5 um from the exact line, which a grazing ray at 1 deg stretches to 30 um.
"""


class Visibility(IntEnum):
    """How much of a point there is in the picture."""

    NOT_LIT = 0
    HIDDEN = 1
    SEEN = 2


@dataclass(frozen=True, kw_only=True)
class FeatureTruth:
    """Where the light plane cuts the lines of a seam."""

    names: tuple[str, ...]
    points_camera: Float[np.ndarray, "k 3"]
    """One row a name, m; NaN where the plane does not cut that line."""
    pixels: Float[np.ndarray, "k 2"]
    """Where the camera sees it, or would."""
    visibility: Int[np.ndarray, "k"]
    """`Visibility`."""


def feature_truth(
    lines_camera: Mapping[str, Float[np.ndarray, "_ 3"]],
    camera: CameraModel,
    fan: LaserFan,
    caster: RayCaster,
    data: mujoco.MjData,
    T_base_camera: RigidTransform,
) -> FeatureTruth:
    """Where the light plane cuts the seam's lines (m, camera frame), and whether the light and the camera reach that.

    Of several crossings that which is nearest to where the plane meets the camera's axis counts. The root of a groove
    with a gap is a point between its edges: it counts as lit and seen if nothing stands before it.
    """
    near = fan.plane.intersect(np.array([[0.0, 0.0, 1.0]]))[0]
    points = np.array([line_crossing(line, fan.plane, near) for line in lines_camera.values()])
    pixels = camera.project(points)
    visibility = np.zeros(len(points), int)
    in_picture = np.flatnonzero(camera.in_picture(np.nan_to_num(pixels, nan=-1e9)))
    candidates = in_picture[_in_fan(points[in_picture], fan)]
    lit = candidates[_reached(caster, data, T_base_camera, fan.source_camera, points[candidates])]
    visibility[lit] = Visibility.HIDDEN
    visibility[lit[_reached(caster, data, T_base_camera, np.zeros(3), points[lit])]] = Visibility.SEEN
    return FeatureTruth(names=tuple(lines_camera), points_camera=points, pixels=pixels, visibility=visibility)


def line_crossing(
    line: Float[np.ndarray, "n 3"], plane: LaserPlane, near: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Where a polyline goes through the plane, nearest to `near` (all m, camera frame); NaN if it does not."""
    distance_m = plane.distance_m(line)
    before = np.flatnonzero((distance_m[:-1] < 0) != (distance_m[1:] < 0))
    if len(before) == 0:
        return np.full(3, np.nan)
    share = distance_m[before] / (distance_m[before] - distance_m[before + 1])
    crossings = line[before] + share[:, None] * (line[before + 1] - line[before])
    return crossings[np.argmin(np.linalg.norm(crossings - near, axis=1))]


def _in_fan(points_camera: Float[np.ndarray, "n 3"], fan: LaserFan) -> Bool[np.ndarray, "n"]:
    """Whether points of the light plane lie within the fan's angle."""
    across, along = fan.plane.T_camera_laser.rotation.as_matrix().T[[0, 2]]
    ends = fan.directions_camera[[0, -1]]
    low, high = np.sort((ends @ across) / (ends @ along))
    offset = points_camera - fan.source_camera
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (offset @ across) / (offset @ along)
    return (offset @ along > 0) & (slope >= low) & (slope <= high)


def _reached(
    caster: RayCaster,
    data: mujoco.MjData,
    T_base_camera: RigidTransform,
    origin_camera: Float[np.ndarray, "3"],
    points_camera: Float[np.ndarray, "n 3"],
) -> Bool[np.ndarray, "n"]:
    """Whether rays from the origin reach the points before anything that is not the points' own edge."""
    offset = points_camera - origin_camera
    range_m = np.linalg.norm(offset, axis=1)
    directions_base = T_base_camera.rotation.apply(offset / range_m[:, None]) if len(offset) else np.empty((0, 3))
    hits = caster.cast(data, T_base_camera.apply(origin_camera), directions_base)
    return ~hits.hit | (hits.distance_m > range_m - _OWN_EDGE_M)

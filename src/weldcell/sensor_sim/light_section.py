"""What the laser lights and what of it the camera sees: two sets of rays through the scene."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.rays import RayCaster

_OCCLUSION_TOLERANCE_M = 1e-6
"""How far before a lit point the camera's ray may end and still count as having reached it.

Hits are exact to about 1e-9 m across the surface, which at a grazing 0.05 deg becomes 1e-6 m along the ray. Whatever
hides a point by less than a micrometre hides nothing that a picture could show.
"""
_MARGIN_PX = 16.0  # followed beyond the picture's border, so that the stripe does not fade there


@dataclass(frozen=True, kw_only=True)
class LightSection:
    """Where each ray of light lands, in order across the light; camera frame, metres.

    The rays are those of the laser's fan, or what surfaces make of them (then the sheet's normal is each ray's own).
    """

    directions_camera: Float[np.ndarray, "n 3"]
    """Unit direction in which the light arrives."""
    sheet_normals_camera: Float[np.ndarray, "n 3"]
    """Unit normal of the light sheet."""
    sheet_sigma_m: Float[np.ndarray, "n"]
    """Standard deviation of the sheet's section where it lands; NaN where it lights nothing."""
    points_camera: Float[np.ndarray, "n 3"]
    """What the ray lights; NaN where it lights nothing."""
    normals_camera: Float[np.ndarray, "n 3"]
    """Outward unit normal of the surface there."""
    incidence_cos: Float[np.ndarray, "n"]
    """Cosine between the normal and the way back to the laser."""
    range_m: Float[np.ndarray, "n"]
    """Way of the light from the laser's source."""
    pixels: Float[np.ndarray, "n 2"]
    """Where the camera would see the point, distortion included."""
    geom_id: Int[np.ndarray, "n"]
    """The geom that is lit; -1 for none."""
    face_id: Int[np.ndarray, "n"]
    """The triangle of its mesh; -1 on solids and where the rays do not tell."""
    lit: Bool[np.ndarray, "n"]
    """Whether the ray lights a surface from outside."""
    visible: Bool[np.ndarray, "n"]
    """Whether nothing hides the lit point from the camera; looked up only in and close around the picture."""
    seen: Bool[np.ndarray, "n"]
    """Whether it is visible and within the picture."""


def light_section(
    caster: RayCaster, data: mujoco.MjData, T_base_camera: RigidTransform, camera: CameraModel, fan: LaserFan
) -> LightSection:
    """What the fan lights and the camera sees, with the camera actually at `T_base_camera`."""
    R_base_camera, centre_base = (T_base_camera.rotation.as_matrix(), T_base_camera.translation)
    source_base = R_base_camera @ fan.source_camera + centre_base
    hits = caster.cast(data, source_base, fan.directions_camera @ R_base_camera.T)
    normals_camera = hits.normals @ R_base_camera
    incidence_cos = -np.einsum("ni,ni->n", normals_camera, fan.directions_camera)
    lit = hits.hit & (incidence_cos > 0)  # a surface met from inside: the source is in metal
    points_camera = fan.source_camera + hits.distance_m[:, None] * fan.directions_camera
    points_camera = np.where(lit[:, None], points_camera, np.nan)
    pixels = camera.project(points_camera)
    visible = lit & near_picture(camera, pixels) & (np.einsum("ni,ni->n", normals_camera, points_camera) < 0)
    visible[visible] = reached(caster, data, R_base_camera, centre_base, points_camera[visible])
    return LightSection(
        directions_camera=fan.directions_camera,
        sheet_normals_camera=np.broadcast_to(fan.plane.normal_camera, points_camera.shape),
        sheet_sigma_m=fan.sheet.sigma_m(hits.distance_m),
        points_camera=points_camera,
        normals_camera=normals_camera,
        incidence_cos=incidence_cos,
        range_m=hits.distance_m,
        pixels=pixels,
        geom_id=np.where(lit, hits.geom_id, -1),
        face_id=np.where(lit, hits.face_id, -1),
        lit=lit,
        visible=visible,
        seen=visible & camera.in_picture(pixels),
    )


def reached(
    caster: RayCaster,
    data: mujoco.MjData,
    R_base_camera: Float[np.ndarray, "3 3"],
    centre_base: Float[np.ndarray, "3"],
    points_camera: Float[np.ndarray, "n 3"],
) -> Bool[np.ndarray, "n"]:
    """Whether rays from the camera's centre reach the points before anything else.

    A ray that meets nothing at all (it may just pass a point on an edge) was not stopped either.
    """
    depth_m = np.linalg.norm(points_camera, axis=1)
    rays_base = (points_camera / depth_m[:, None]) @ R_base_camera.T
    return ~caster.blocked(data, centre_base, rays_base, depth_m - _OCCLUSION_TOLERANCE_M)


def near_picture(camera: CameraModel, pixels: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
    """Whether pixels lie in the picture or so close around it that a stripe must be followed there."""
    u, v = pixels[:, 0], pixels[:, 1]
    inside_u = (u > -_MARGIN_PX) & (u < camera.width_px + _MARGIN_PX)
    return inside_u & (v > -_MARGIN_PX) & (v < camera.height_px + _MARGIN_PX)

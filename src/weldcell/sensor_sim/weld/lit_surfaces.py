"""The surfaces in the arc's light as the camera sees them, pixel by pixel, with their texture."""

import cv2
import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel
from weldcell.models.surface_texture import SurfaceTexture
from weldcell.sensor_sim.materials import geom_materials
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.texture import SceneTextures
from weldcell.sensor_sim.weld.arc import ArcLight, lit_radiance, reaches, shaded
from weldcell.sensor_sim.weld.coarse_view import SeenCells, seen_along
from weldcell.sensor_sim.weld.fine_view import fine_view


class LitSurfaces:
    """A camera's view of what the arc lights in a scene; one for each thread."""

    def __init__(
        self, camera: CameraModel, model: mujoco.MjModel, caster: RayCaster, opaque: Bool[np.ndarray, "geoms"]
    ) -> None:
        """`caster` has all that the camera sees; `opaque` is what stops the arc's light."""
        self._view, self._caster, self._opaque = fine_view(camera), caster, opaque
        self._materials, self._textures = geom_materials(model), SceneTextures(model)
        self._floats: dict[SurfaceTexture, np.ndarray] = {}

    def radiance(
        self, arc: ArcLight, data: mujoco.MjData, T_base_camera: RigidTransform
    ) -> Float[np.ndarray, "height width"]:
        """What each pixel sees, W/(m^2 sr)."""
        R_base_camera = T_base_camera.rotation.as_matrix()
        seen = seen_along(self._view.rays_camera @ R_base_camera.T, self._caster, data, T_base_camera)
        plain, lit = self._plain(arc, seen, data)
        picture, places = self._view.whole(plain), np.zeros((len(plain), 2))
        for texture, here, places_px in self._textures.places(data, seen.points_base, seen.normals_base, seen.geom_id):
            places[here] = places_px
            whole_u, whole_v = (self._view.whole(np.where(_mask(here, len(plain)), places[:, k], -1.0)) for k in (0, 1))
            grey = cv2.remap(
                self._as_float(texture), whole_u, whole_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            factor = grey / np.float32(255)
            if len(here) < len(plain):
                on_it = self._view.whole(_mask(here, len(plain)).astype(float)) > 0.999
                factor[~on_it] = 1.0
            cv2.multiply(picture, factor, dst=picture)
        rows, columns = self._view.rough(seen, lit, places)
        rays_base = self._view.rays(rows, columns) @ R_base_camera.T
        single = seen_along(rays_base, self._caster, data, T_base_camera)
        texture_there = self._textures.factor(data, single.points_base, single.normals_base, single.geom_id)
        picture[rows, columns] = self._plain(arc, single, data)[0] * texture_there
        return picture

    def _as_float(self, texture: SurfaceTexture) -> Float[np.ndarray, "rows columns"]:
        """A texture's picture as cv2.remap needs it for fractions of a level."""
        if texture not in self._floats:
            self._floats[texture] = texture.grey.astype(np.float32)
        return self._floats[texture]

    def _plain(
        self, arc: ArcLight, seen: SeenCells, data: mujoco.MjData
    ) -> tuple[Float[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
        """Radiance without texture, and whether the arc's light arrives."""
        to_points = seen.points_base - arc.position_base
        facing = np.einsum("ni,ni->n", seen.normals_base, to_points) < 0
        free_m = np.zeros(len(to_points))
        free_m[facing] = np.where(shaded(arc, seen.points_base[facing], self._caster, data, self._opaque), 0.0, np.inf)
        return lit_radiance(arc, seen, self._materials, free_m), reaches(arc, seen, free_m)


def _mask(indices: np.ndarray, count: int) -> Bool[np.ndarray, "n"]:
    mask = np.zeros(count, bool)
    mask[indices] = True
    return mask

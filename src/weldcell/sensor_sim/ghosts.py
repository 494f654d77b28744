"""All ghost stripes of a frame."""

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.light_section import LightSection
from weldcell.sensor_sim.mirror_image import mirror_image
from weldcell.sensor_sim.mirrors import Ghost, Mirrors, MirrorView
from weldcell.sensor_sim.reflectance import LightReference
from weldcell.sensor_sim.second_bounce import bounced, second_bounce

_EVERY = 3  # of the laser's rays: ghosts are broader than the stripe, and its rays are half a pixel apart
_WIDER = 1.3  # than the picture: light that falls this far beside it is still followed


class GhostTracer:
    """Finds what mirrors throw on other surfaces, and the stripe as it shows in mirrors."""

    def __init__(self, mirrors: Mirrors, camera: CameraModel, fan: LaserFan, reference: LightReference) -> None:
        """`camera` and `fan` are the actual ones, `mirrors` the scene's."""
        self._mirrors, self._camera, self._reference = mirrors, camera, reference
        self._fan = fan.thinned(_EVERY)
        self._corners_camera = _cone(camera)

    def ghosts(self, data: mujoco.MjData, T_base_camera: RigidTransform, section: LightSection) -> tuple[Ghost, ...]:
        """The ghost stripes of a frame, none if the laser's light (`section`) meets no mirror."""
        if not self._mirrors.is_mirror[section.geom_id[section.lit]].any():
            return ()
        view = self._view(data, T_base_camera)
        section = LightSection(**{name: value[::_EVERY] for name, value in vars(section).items()})
        bounce = bounced(view, self._fan, section)
        if bounce is None:
            return ()
        found = (
            second_bounce(view, self._camera, section, bounce, self._reference),
            mirror_image(view, self._camera, self._fan, section, bounce, self._reference),
        )
        return tuple(ghost for ghost in found if ghost is not None and ghost.section.visible.any())

    def _view(self, data: mujoco.MjData, T_base_camera: RigidTransform) -> MirrorView:
        R_base_camera, centre_base = T_base_camera.rotation.as_matrix(), T_base_camera.translation
        corners_base = self._corners_camera @ R_base_camera.T
        return MirrorView(
            mirrors=self._mirrors,
            data=data,
            R_base_camera=R_base_camera,
            centre_base=centre_base,
            among=self._mirrors.caster.reachable(data, centre_base, corners_base),
            cone_cos=float(self._corners_camera[:, 2].min()),
        )


def _cone(camera: CameraModel) -> Float[np.ndarray, "4 3"]:
    """Unit directions beyond the picture's corners, all at the same angle to the camera's axis."""
    across = np.array([[x, y] for x in (-0.5, camera.width_px - 0.5) for y in (-0.5, camera.height_px - 0.5)])
    slope = _WIDER * np.linalg.norm((across - camera.principal_px) / camera.focal_px, axis=1).max()
    rays = np.array([[slope, 0, 1], [-slope, 0, 1], [0, slope, 1], [0, -slope, 1]])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)

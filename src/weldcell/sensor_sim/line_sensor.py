"""The laser-line sensor: from the scene and the camera's actual pose to the picture that it takes."""

from types import TracebackType

import mujoco
import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.sensor_sim.ambient import AmbientRenderer
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.light_section import LightSection, laser_fan, light_section
from weldcell.sensor_sim.noise import expose, noise_model
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.stripe import StripePieces, stripe_optics, stripe_pieces

_RAYS_PER_COLUMN = 2


class LineSensor:
    """A laser-line sensor in a scene; use it in a `with` block, or call `close`. One sensor for each thread."""

    def __init__(
        self,
        config: SensorConfig,
        camera: CameraModel,
        plane: LaserPlane,
        laser_source_camera: Float[np.ndarray, "3"],
        model: mujoco.MjModel,
    ) -> None:
        """`camera`, `plane` and `laser_source_camera` (m, camera frame) are the actual ones of this sensor."""
        self._camera = camera
        self._fan = laser_fan(
            plane, laser_source_camera, np.deg2rad(config.laser_fan_deg), _RAYS_PER_COLUMN * camera.width_px
        )
        self._optics = stripe_optics(config)
        self._noise = noise_model(config)
        self._caster = RayCaster(model)
        self._ambient = AmbientRenderer(model, camera, config.ambient_grey)

    def __enter__(self) -> "LineSensor":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the graphics memory."""
        self._ambient.close()

    def capture(
        self, data: mujoco.MjData, T_base_camera: RigidTransform, rng: np.random.Generator
    ) -> UInt8[np.ndarray, "height width"]:
        """The picture taken with the camera actually at `T_base_camera`; it holds no stripe if no light is seen.

        `data` needs up-to-date kinematics (mj_kinematics, and mj_camlight for the model's own lights).
        """
        _, pieces = self.truth(data, T_base_camera)
        laser = draw_stripe(pieces, self._camera.width_px, self._camera.height_px)
        return expose(self._ambient.render(data, T_base_camera), laser, self._noise, rng)

    def truth(self, data: mujoco.MjData, T_base_camera: RigidTransform) -> tuple[LightSection, StripePieces]:
        """What is lit and seen, and the exact stripe: for labels and checks, never for a pipeline."""
        section = light_section(self._caster, data, T_base_camera, self._camera, self._fan)
        return section, stripe_pieces(section, self._camera, self._fan, self._optics)

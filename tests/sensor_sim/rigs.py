"""Nominal sensors of all presets above a scene, and closed-form shapes under their light."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import SENSOR_PRESETS, SensorConfig
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.laser import LaserFan, laser_fan
from weldcell.sensor_sim.light_section import LightSection, light_section
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import irradiance, light_reference
from weldcell.sensor_sim.stripe import StripeOptics, StripePieces, stripe_optics, stripe_pieces

Heights = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Height z (base frame, m) of a surface at places x, y."""


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A sensor as designed."""

    config: SensorConfig
    camera: CameraModel
    fan: LaserFan
    optics: StripeOptics

    def T_base_camera(self, target=(0.0, 0.0, 0.0), yaw_rad: float = 0.0) -> RigidTransform:
        """The pose whose light falls straight down through `target`, where it meets the camera's axis.

        The laser frame's x is the base's y turned by the yaw.
        """
        R_base_laser = Rotation.from_euler("z", yaw_rad) * Rotation.from_matrix(
            np.column_stack([[0.0, 1, 0], [1.0, 0, 0], [0.0, 0, -1]])
        )
        R_base_camera = R_base_laser * self.fan.plane.T_camera_laser.rotation.inv()
        reach_m = self.config.working_distance_mm * 1e-3
        return rigid_from(R_base_camera, np.asarray(target) - R_base_camera.apply([0.0, 0.0, reach_m]))

    def section(self, model: mujoco.MjModel, T_base_camera: RigidTransform) -> LightSection:
        """What the light meets in a scene."""
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return light_section(RayCaster(model), data, T_base_camera, self.camera, self.fan)

    def pieces(self, model: mujoco.MjModel, T_base_camera: RigidTransform) -> StripePieces:
        """The stripe of matt white surfaces."""
        section = self.section(model, T_base_camera)
        brightness = irradiance(section, self.fan.power_ratio, light_reference(self.fan))
        return stripe_pieces(section, brightness, self.camera, self.optics)

    def profile_base(self, T_base_camera: RigidTransform, heights: Heights, half_m: float, count: int) -> np.ndarray:
        """Points (base) of a surface under the light plane, which stands upright, from one side to the other."""
        axes = (T_base_camera * self.fan.plane.T_camera_laser).rotation.as_matrix()
        source = T_base_camera.apply(self.fan.source_camera)
        ground = source[:2] + np.linspace(-half_m, half_m, count)[:, None] * axes[:2, 0]
        return np.column_stack([ground, heights(ground[:, 0], ground[:, 1])])


@cache
def rig(config: SensorConfig) -> Rig:
    """The sensor of a configuration."""
    camera, plane = nominal_camera(config), nominal_plane(config)
    fan = laser_fan(config, plane, nominal_source_camera(config))
    return Rig(config=config, camera=camera, fan=fan, optics=stripe_optics(config, camera, fan))


CROOKED = replace(
    SensorConfig(),
    distortion=(-0.2, 0.15, 1e-3, -8e-4, 0.02),
    rational=(0.1, -0.05, 0.02),
    thin_prism=(2e-3, -1e-3, 1e-3, 2e-3),
    tilt_deg=(7.0, -5.0),
    laser_profile="gaussian",
)
"""All that a lens can do at once."""

SENSORS: dict[str, SensorConfig] = {**SENSOR_PRESETS, "crooked": CROOKED}


def sensor(name: str) -> Rig:
    """The sensor of a preset, or the crooked one."""
    return rig(SENSORS[name])

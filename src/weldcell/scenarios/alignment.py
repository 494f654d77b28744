"""What is known at one time of sensor, torch and arm: how a sight becomes a place, and a place a posture."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib.calibrated_arm import CalibratedArm
from weldcell.calib.joint_problem import SENSOR_SIZE
from weldcell.calib.sensor_errors import corrected_points, corrected_sensor
from weldcell.scenarios.station import SensorBelief


@dataclass(frozen=True, kw_only=True, eq=False)
class Alignment:
    """What is known at one time of sensor, torch and arm."""

    T_flange_camera: RigidTransform
    """Hand-eye transform."""
    tip_flange: Float[np.ndarray, "3"]
    """Torch tip in the flange, m."""
    arm: CalibratedArm | None = None
    """The arm with its errors; None: as its controller believes it to be."""
    sensor: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(SENSOR_SIZE))
    """Errors of camera and light plane (see `calib.sensor_errors`)."""

    def flanges(self, joints_rad: Float[np.ndarray, "n 6"], T_base_flange: RigidTransform) -> RigidTransform:
        """Where the flange was at these readings, for which the controller reported `T_base_flange` (both stacks)."""
        return T_base_flange if self.arm is None else self.arm.flanges(joints_rad)

    def corrected(self, points_camera: Float[np.ndarray, "*batch 3"], belief: SensorBelief) -> np.ndarray:
        """Measured points (m) with the sensor's errors put right."""
        if not self.sensor.any():
            return points_camera
        flat = points_camera.reshape(-1, 3)
        return corrected_points(flat, belief.camera, belief.plane, self.sensor).reshape(points_camera.shape)

    def corrected_belief(self, belief: SensorBelief) -> SensorBelief:
        """Camera and light plane with their errors put right."""
        camera, plane = corrected_sensor(belief.camera, belief.plane, self.sensor)
        return SensorBelief(camera=camera, plane=plane)

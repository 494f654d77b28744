"""What the sensor looks like: its measuring range in the light plane, its light sheet, the scale of its profiles."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel, LaserPlane

_SCALE_STEP_MM = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnSensor:
    """A laser-line sensor as it is drawn."""

    body: int
    """Id of the body that carries the camera."""
    T_body_camera: RigidTransform
    camera: CameraModel
    plane: LaserPlane
    fan_rad: float
    """Full angle of the light's fan; its apex is the plane's nearest point to the camera's centre."""

    @cached_property
    def T_laser_camera(self) -> RigidTransform:
        """From the camera to the light plane's own frame."""
        return self.plane.T_camera_laser.inv()

    @cached_property
    def range_mm(self) -> Float[np.ndarray, "4 2"]:
        """Corners of what the camera sees of the light plane: across and along the light, mm."""
        right, bottom = self.camera.width_px - 1, self.camera.height_px - 1
        corners = np.array([[0, 0], [right, 0], [right, bottom], [0, bottom]], float)
        return self.profile_mm(self.plane.intersect(self.camera.unproject(corners)))

    def profile_mm(self, points_camera: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
        """Points within the light plane, mm: across (the camera's x) and along the light (depth)."""
        points_laser = self.T_laser_camera.apply(points_camera) if len(points_camera) else np.zeros((0, 3))
        return 1e3 * points_laser[:, [0, 2]]

    def sheet_camera(self) -> Float[np.ndarray, "3 3"]:
        """The light sheet as a triangle, from its apex to the far end of the measuring range."""
        depth_m = 1e-3 * float(self.range_mm[:, 1].max())
        half_m = depth_m * np.tan(self.fan_rad / 2)
        corners_laser = np.array([[0, 0, 0], [-half_m, 0, depth_m], [half_m, 0, depth_m]])
        return self.plane.T_camera_laser.apply(corners_laser)

    def scale_mm(self) -> tuple[list[Float[np.ndarray, "2 2"]], list[str]]:
        """Lines every 10 mm over the measuring range's bounds, with their labels."""
        (left, top), (right, bottom) = self.range_mm.min(axis=0), self.range_mm.max(axis=0)
        lines, labels = [], []
        for depth in _steps(top, bottom):
            lines.append(np.array([[left, depth], [right, depth]]))
            labels.append(f"{depth:.0f} mm")
        for across in _steps(left, right):
            lines.append(np.array([[across, top], [across, bottom]]))
            labels.append(f"{across:.0f}")
        return lines, labels


def _steps(low: float, high: float) -> Float[np.ndarray, "n"]:
    first = np.ceil(low / _SCALE_STEP_MM) * _SCALE_STEP_MM
    return np.arange(first, high + 1e-9, _SCALE_STEP_MM)

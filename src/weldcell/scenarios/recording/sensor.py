"""The sensor as it is drawn: its camera, its light sheet, and the frame that its profiles are drawn into."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import rerun as rr
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.scenarios.recording import palette

SENSOR = "cell/sensor"
PICTURE = "cell/sensor/picture"

_SCALE_STEP_MM = 20.0
_PICTURE_DISTANCE_M = 0.06  # how far before the camera its picture floats


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnSensor:
    """A laser-line sensor as it is drawn."""

    body: int
    """Id of the body that carries the camera."""
    T_body_camera: RigidTransform
    camera: CameraModel
    plane: LaserPlane
    source_camera: Float[np.ndarray, "3"]
    """Where the light's fan starts, m, camera frame."""
    fan_rad: float
    """Full angle of the light's fan."""

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
        if len(points_camera) == 0:
            return np.zeros((0, 2))
        return 1e3 * self.T_laser_camera.apply(points_camera)[:, [0, 2]]

    def drawn(self) -> Iterator[tuple[str, rr.AsComponents]]:
        """What never changes: the camera (without its distortion), the light sheet, the scale of the profiles."""
        # rerun's pixel (0, 0) is the corner of the top-left pixel, ours its centre.
        yield (
            PICTURE,
            rr.Pinhole(
                focal_length=self.camera.focal_px,
                principal_point=self.camera.principal_px + 0.5,
                resolution=[self.camera.width_px, self.camera.height_px],
                image_plane_distance=_PICTURE_DISTANCE_M,
                color=palette.FRAME,
            ),
        )
        yield (
            f"{SENSOR}/light",
            rr.Mesh3D(vertex_positions=self._sheet_camera(), triangle_indices=[[0, 1, 2]], albedo_factor=palette.LASER),
        )
        lines, labels = self._scale_mm()
        yield "profile/scale", rr.LineStrips2D(lines, colors=palette.SCALE, radii=rr.Radius.ui_points(0.5))
        yield (
            "profile/numbers",
            rr.Points2D([line[0] for line in lines], labels=labels, show_labels=True, colors=palette.NUMBER, radii=0.0),
        )
        outline = np.vstack([self.range_mm, self.range_mm[:1]])
        yield "profile/range", rr.LineStrips2D([outline], colors=palette.FRAME, radii=rr.Radius.ui_points(1.0))

    def _sheet_camera(self) -> Float[np.ndarray, "3 3"]:
        """The light sheet as a triangle, from its source to the far end of the measuring range."""
        source_laser = self.T_laser_camera.apply(self.source_camera)
        depth_m = 1e-3 * float(np.nanmax(self.range_mm[:, 1])) - source_laser[2]
        half_m = depth_m * np.tan(self.fan_rad / 2)
        from_source = np.array([[0, 0, 0], [-half_m, 0, depth_m], [half_m, 0, depth_m]])
        return self.plane.T_camera_laser.apply(source_laser + from_source)

    def _scale_mm(self) -> tuple[list[Float[np.ndarray, "2 2"]], list[str]]:
        """Lines over the measuring range's bounds, each beginning where its label stands."""
        (left, top), (right, bottom) = np.nanmin(self.range_mm, axis=0), np.nanmax(self.range_mm, axis=0)
        depths, places = _steps(top, bottom), _steps(left, right)
        lines = [np.array([[left, depth], [right, depth]]) for depth in depths]
        lines += [np.array([[across, bottom], [across, top]]) for across in places]
        return lines, [f"depth {depth:.0f}" for depth in depths] + [f"{across:.0f}" for across in places]


def _steps(low: float, high: float) -> Float[np.ndarray, "n"]:
    first = np.ceil(low / _SCALE_STEP_MM) * _SCALE_STEP_MM
    return np.arange(first, high + 1e-9, _SCALE_STEP_MM)

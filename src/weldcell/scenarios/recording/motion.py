"""How the bodies of the cell move, gathered and written in blocks."""

import mujoco
import numpy as np
import rerun as rr
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.scenarios.recording.bodies import Bodies
from weldcell.scenarios.recording.sensor import SENSOR, DrawnSensor
from weldcell.scenarios.recording.stream import Stream

_BLOCK_ROWS = 2000


class MotionLog:
    """Poses of all moving bodies and of the sensor; written row by row they would take fifteen times as long."""

    def __init__(self, bodies: Bodies, stream: Stream) -> None:
        self.sensor: DrawnSensor | None = None
        self.bodies, self._stream = bodies, stream
        self._rows: list[tuple[int, float, Float[np.ndarray, "nbody 3"], Float[np.ndarray, "nbody 9"]]] = []
        self._last: dict[str, Float[np.ndarray, "12"]] = {}

    def add(self, frame: int, time_s: float, data: mujoco.MjData) -> None:
        """Keeps where everything stands at this moment."""
        self._rows.append((frame, time_s, data.xpos.copy(), data.xmat.copy()))
        if len(self._rows) >= _BLOCK_ROWS:
            self.flush()

    def flush(self) -> None:
        """Writes what was kept."""
        if not self._rows:
            return
        frames, times_s, xpos, xmat = (np.array(column) for column in zip(*self._rows, strict=True))
        self._rows.clear()
        tracks = [(self.bodies.path(body), body, RigidTransform.identity()) for body in self.bodies.moving]
        if self.sensor:
            tracks.append((SENSOR, self.sensor.body, self.sensor.T_body_camera))
        for entity, body, T_body_child in tracks:
            rotation_base_body = Rotation.from_matrix(xmat[:, body].reshape(-1, 3, 3))
            position = xpos[:, body] + rotation_base_body.apply(T_body_child.translation)
            rotation = rotation_base_body * T_body_child.rotation
            rows = self._changed(entity, position, rotation)
            if rows.any():
                quaternion = rotation[rows].as_quat(scalar_first=False).astype(np.float32)
                columns = rr.Transform3D.columns(translation=position[rows].astype(np.float32), quaternion=quaternion)
                self._stream.log_columns(frames[rows], times_s[rows], entity, columns)

    def _changed(self, entity: str, position: Float[np.ndarray, "n 3"], rotation: Rotation) -> Bool[np.ndarray, "n"]:
        """Which rows differ from the one before: parts that stand still for a while cost nothing."""
        rows = np.hstack([position, rotation.as_matrix().reshape(-1, 9)])
        before = np.vstack([self._last.get(entity, np.full(12, np.nan)), rows[:-1]])
        self._last[entity] = rows[-1]
        return np.asarray(np.any(rows != before, axis=1))  # NaN differs from everything: the first row is written

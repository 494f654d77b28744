"""The sensor with a board held before it: pictures of boards and stripe in the light of the room.

The arm stays at home and the torch is taken off, as one does to hold a board there. Boards stand where they are put
relative to the actual camera.
"""

from types import TracebackType

import numpy as np
from jaxtyping import Float, Shaped
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import CellConfig
from weldcell.cell.profile import Shot, Stripe
from weldcell.cell.randomness import generator
from weldcell.cell.world.robot_error import BUDGETS, draw_error
from weldcell.cell.world.scene import AWAY, HOME_RAD, build_cell, build_controller, build_parts, head_design
from weldcell.models.board import Board
from weldcell.models.mesh_body import GROUP_TORCH
from weldcell.scenarios.recording import Recording
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.focus import lens
from weldcell.sensor_sim.line_sensor import Exposure, LineSensor
from weldcell.sensor_sim.printed import PrintedBoards

_TAKEN_OFF_GROUP = 5
_PICTURE_S = 2.0  # between two pictures: a board is moved by hand


class BoardBench:
    """A cell with boards; use it in a `with` block."""

    def __init__(self, config: CellConfig, seed: int, recording: Recording, boards: tuple[Board, ...]) -> None:
        self._config, self._seed, self._recording = config, seed, recording
        self._boards = {board.name: board for board in boards}
        sensor = config.sensor
        self.camera, self.plane, self.lens = nominal_camera(sensor), nominal_plane(sensor), lens(sensor)
        error = draw_error(BUDGETS[config.robot], generator(seed, "robot"))
        self._cell = build_cell(build_parts(config), head_design(sensor), error, boards)
        self._take_torch_off()
        self._cell.take(HOME_RAD)
        self._T_base_flange = build_controller(self._cell).forward(HOME_RAD)
        source_camera = nominal_source_camera(sensor)
        self._sensor = LineSensor(sensor, self.camera, self.plane, source_camera, self._cell.model, seed=seed)
        self._print = PrintedBoards(self.camera, self.lens)
        plan = config.laser_plane
        self._exposure = Exposure(exposure_ms=plan.exposure_ms, gain_db=sensor.gain_db, ambient_grey=plan.ambient_grey)
        self.frame = 0
        recording.log_cell(self._cell.model)
        fan_rad = float(np.radians(sensor.laser_fan_deg))
        recording.log_sensor(camera=self.camera, plane=self.plane, source_camera=source_camera, fan_rad=fan_rad)

    def __enter__(self) -> "BoardBench":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sensor.close()

    @property
    def time_s(self) -> float:
        """When the next picture is taken."""
        return self.frame * _PICTURE_S

    def see(self, board: str, T_camera_board: RigidTransform) -> Shaped[np.ndarray, "height width"]:
        """The picture of a board held there, the others put away."""
        T_base_camera = self._cell.T_base("camera")
        for name in self._boards:
            self._cell.place(name, T_base_camera * T_camera_board if name == board else AWAY)
        light = self._sensor.light(self._cell.data, T_base_camera, exposure=self._exposure)
        pattern = self._boards[board].pattern
        if pattern is not None:
            light = self._print.printed(light, pattern, T_base_camera * T_camera_board)
        rng = generator(self._seed, "boards/picture", self.frame)
        self._recording.log_pose(self.frame, self.time_s, self._cell.data)
        return self._sensor.picture(light, rng, self._exposure)

    def log(
        self,
        picture: Shaped[np.ndarray, "height width"],
        stripe: Stripe | None,
        marks_px: Float[np.ndarray, "n 2"],
    ) -> None:
        """Records the last picture with what was found in it; the next one comes a little later."""
        if self._recording.enabled:
            shot = Shot(image=marked(picture, marks_px), T_base_flange=self._T_base_flange, time_s=self.time_s)
            self._recording.log_shot(self.frame, shot, T_base_camera=self._cell.T_base("camera"), stripe=stripe)
        self.frame += 1

    def _take_torch_off(self) -> None:
        """Neither camera nor laser nor the recording sees it any more."""
        model = self._cell.model
        torch = model.geom_group == GROUP_TORCH
        model.geom_group[torch] = _TAKEN_OFF_GROUP
        model.geom_rgba[torch, 3] = 0.0


def marked(
    picture: Shaped[np.ndarray, "height width"], marks_px: Float[np.ndarray, "n 2"]
) -> Shaped[np.ndarray, "height width"]:
    """The picture with a small light cross, dark in its middle, at each place that was found."""
    drawn = picture.copy()
    white = np.iinfo(picture.dtype).max if picture.dtype == np.uint8 else 4095
    height, width = picture.shape
    for u, v in np.rint(marks_px[np.isfinite(marks_px).all(axis=1)]).astype(int):
        for along in range(-5, 6):
            for x, y in ((u + along, v), (u, v + along)):
                if 0 <= x < width and 0 <= y < height:
                    drawn[y, x] = white if abs(along) > 1 else 0
    return drawn

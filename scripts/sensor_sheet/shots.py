"""Pictures of plates with all their truth, exposed as a sensor's own control would."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Shaped

from weldcell.cell.configuration import CellConfig, SensorConfig
from weldcell.scenarios.dataset.plan import FramePlan, PlatePlan
from weldcell.scenarios.dataset.scene import PlateScene
from weldcell.sensor_sim.labels import FrameTruth

PLATE = PlatePlan(
    number=0,
    groove_angle_deg=45.0,
    groove_depth_mm=16.0,
    root_gap_mm=0.0,
    amplitude_mm=10.0,
    material="ground-steel",
    texture="none",
    tack_spots=0,
    texture_seed=3,
)
"""What a sheet's plates have in common."""
FRAME = FramePlan(
    number=0,
    place_ratio=0.4,
    lateral_mm=0.0,
    height_mm=-20.0,  # the torch's tip 5 mm above the plate
    lean_deg=0.0,
    roll_deg=3.0,
    yaw_deg=4.0,
    exposure_ms=1.0,
    gain_db=0.0,
    ambient_grey=6.0,
    disturbances=(),
)
"""Where a sheet's sensor stands."""

_SEED = 1
_WELL_EXPOSED_GREY = 180.0
_BRIGHT_PERCENTILE = 75  # of the stripe's columns reach that level: the plate's do, the groove's may not
_LONGEST_MS = 15.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """A picture, and what is true of it."""

    picture: Shaped[np.ndarray, "height width"]
    truth: FrameTruth
    exposure_ms: float

    @property
    def middle_px(self) -> tuple[float, float]:
        """The middle of the seam's features."""
        low, high = self._ends_px
        u, v = (low + high) / 2
        return float(u), float(v)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the seam's features."""
        low, high = self._ends_px
        width, height = np.ceil(high - low).astype(int)
        return int(width), int(height)

    @property
    def _ends_px(self) -> tuple[np.ndarray, np.ndarray]:
        pixels = self.truth.features.pixels
        return np.nanmin(pixels, axis=0), np.nanmax(pixels, axis=0)


def take(
    plate: PlatePlan = PLATE,
    frame: FramePlan = FRAME,
    sensor: SensorConfig | None = None,
    exposure_ms: float | None = None,
    speed_mm_s: float = 20.0,
) -> Shot:
    """The shot of a frame, exposed so that the undisturbed stripe is bright unless `exposure_ms` is given."""
    config = CellConfig(sensor=sensor or SensorConfig())
    config = replace(config, seam=replace(config.seam, speed_mm_s=speed_mm_s))
    with PlateScene(config, plate, _SEED) as scene:
        if exposure_ms is None:
            _, truth = scene.frame(replace(frame, disturbances=()))
            bright_grey = np.percentile(truth.stripe.amplitude_grey[truth.stripe.seen], _BRIGHT_PERCENTILE)
            exposure_ms = min(_WELL_EXPOSED_GREY / float(bright_grey), _LONGEST_MS)
        picture, truth = scene.frame(replace(frame, exposure_ms=exposure_ms))
    return Shot(picture=picture, truth=truth, exposure_ms=exposure_ms)

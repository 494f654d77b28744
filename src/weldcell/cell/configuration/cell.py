"""The whole configuration of a run, of which the other modules hold the sections."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Le

from weldcell.cell.configuration.boss import BossConfig
from weldcell.cell.configuration.calibration import CalibrationConfig, CalibrationMethod, LaserPlaneConfig
from weldcell.cell.configuration.dataset import DatasetConfig
from weldcell.cell.configuration.disturbance import Disturbance
from weldcell.cell.configuration.seam import SeamConfig
from weldcell.cell.configuration.sensor import SensorConfig
from weldcell.cell.configuration.weld import WeldConfig

RobotTier = Literal["perfect", "calibrated", "typical", "bad", "paper"]


@dataclass(frozen=True, kw_only=True)
class RecordingConfig:
    """What goes into the recording."""

    enabled: bool = True
    """Write recording.rrd."""
    jpeg_quality: Annotated[int, Ge(10), Le(100)] = 75
    """Quality of the camera pictures."""
    picture_every: Annotated[int, Ge(1), Le(100_000)] = 2
    """Keep every K-th camera picture."""


@dataclass(frozen=True, kw_only=True)
class CellConfig:
    """Everything that a run depends on, besides its scenario and seed."""

    robot: RobotTier = "typical"
    """Error budget of the actual robot."""
    method: CalibrationMethod = "joint"
    """Calibration: P2's compensation by touches, or one joint estimate that finds the robot's own errors as well."""
    arm_file: str = ""
    """YAML file of an arm of one's own, instead of the cell's."""
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """The laser-line sensor."""
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    """Hand-eye calibration and compensation."""
    laser_plane: LaserPlaneConfig = field(default_factory=LaserPlaneConfig)
    """Camera and light plane by boards."""
    seam: SeamConfig = field(default_factory=SeamConfig)
    """Workpiece with its seam, and scan."""
    weld: WeldConfig = field(default_factory=WeldConfig)
    """Welding along the seam in closed loop."""
    boss: BossConfig = field(default_factory=BossConfig)
    """Boss and scan."""
    disturbances: tuple[Disturbance, ...] = ()
    """What disturbs the sensor, and when."""
    dataset: DatasetConfig = field(default_factory=DatasetConfig)
    """What data sets are drawn from."""
    recording: RecordingConfig = field(default_factory=RecordingConfig)
    """The recording."""

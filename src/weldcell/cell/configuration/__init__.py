"""Every setting of a run, as plain frozen values with units in their names and bounds that are checked.

`scenarios.settings` builds these from YAML and the command line; each field becomes an option.
"""

from weldcell.cell.configuration.boss import BossConfig
from weldcell.cell.configuration.calibration import CalibrationConfig, CalibrationMethod, LaserPlaneConfig
from weldcell.cell.configuration.cell import CellConfig, RecordingConfig, RobotTier
from weldcell.cell.configuration.dataset import DatasetConfig
from weldcell.cell.configuration.disturbance import Disturbance, DisturbanceKind
from weldcell.cell.configuration.seam import SEAM_PRESETS, JointName, PathName, SeamConfig
from weldcell.cell.configuration.sensor import SENSOR_PRESETS, SensorConfig, SensorPreset
from weldcell.cell.configuration.surface import MaterialName, TextureName
from weldcell.cell.configuration.weld import Guidance, WeaveShape, WeldConfig

__all__ = [
    "SEAM_PRESETS",
    "SENSOR_PRESETS",
    "BossConfig",
    "CalibrationConfig",
    "CalibrationMethod",
    "CellConfig",
    "DatasetConfig",
    "Disturbance",
    "DisturbanceKind",
    "Guidance",
    "JointName",
    "LaserPlaneConfig",
    "MaterialName",
    "PathName",
    "RecordingConfig",
    "RobotTier",
    "SeamConfig",
    "SensorConfig",
    "SensorPreset",
    "TextureName",
    "WeaveShape",
    "WeldConfig",
]

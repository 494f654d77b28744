"""The ranges that data sets are drawn from."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le

from weldcell.cell.configuration.bounds import Angle, Finite, Positive, Share, Unsigned
from weldcell.cell.configuration.surface import MaterialName, TextureName
from weldcell.cell.errors import BadInput

Gain = Annotated[float, Ge(0), Le(48)]
Grey = Annotated[float, Gt(0), Le(255)]
GrooveAngle = Annotated[float, Ge(10), Le(120)]
Spots = Annotated[int, Ge(0), Le(100)]


@dataclass(frozen=True, kw_only=True)
class DatasetConfig:
    """Ranges that `weldcell dataset` draws from; what has no range here is as in the other sections."""

    frames_per_plate: Annotated[int, Ge(1), Le(10_000)] = 20
    """Pictures of one plate before the next one is made."""
    materials: tuple[MaterialName, ...] = ("mill-scale", "ground-steel", "stainless", "aluminium", "polished")
    """Materials of the plates."""
    textures: tuple[TextureName, ...] = ("none", "brushed", "scratched")
    """Patterns of the plates' brightness."""
    tack_spots: tuple[Spots, Spots] = (0, 6)
    """Fewest and most tack spots along a seam."""
    groove_angle_deg: tuple[GrooveAngle, GrooveAngle] = (35.0, 75.0)
    """Groove angle, from and to."""
    groove_depth_mm: tuple[Positive, Positive] = (8.0, 40.0)
    """Depth of the groove from the plate's top to the root face, from and to."""
    root_gap_mm: tuple[Unsigned, Unsigned] = (0.5, 3.0)
    """Gap at the root of the plates that have one, from and to."""
    root_gap_ratio: Share = 0.3
    """Share of the plates that have a gap at the root."""
    amplitude_mm: tuple[Unsigned, Unsigned] = (0.0, 20.0)
    """How far the S-shaped path swings to either side, from and to."""
    lateral_mm: tuple[Finite, Finite] = (-15.0, 15.0)
    """How far the sensor is off the seam, to the left, from and to."""
    height_mm: tuple[Finite, Finite] = (-15.0, 10.0)
    """Where the light meets the camera's axis, above the plate's top, from and to: it sets the stand-off."""
    lean_deg: tuple[Angle, Angle] = (-10.0, 10.0)
    """How far the sensor leans forwards in the direction of travel, from and to."""
    roll_deg: tuple[Angle, Angle] = (-8.0, 8.0)
    """How far the sensor leans to the right, from and to."""
    yaw_deg: tuple[Angle, Angle] = (-15.0, 15.0)
    """How far the sensor is turned from the direction of travel, from and to."""
    exposure_ms: tuple[Positive, Positive] = (2.0, 10.0)
    """Exposure time, from and to, even in its logarithm."""
    gain_db: tuple[Gain, Gain] = (0.0, 6.0)
    """Gain, from and to."""
    ambient_grey: tuple[Grey, Grey] = (0.5, 8.0)
    """Level of a white surface in the cell's light, from and to, even in its logarithm."""
    arc_ratio: Share = 0.1
    """Share of the frames with arc light."""
    spatter_ratio: Share = 0.1
    """Share of the frames with spatter."""
    fume_ratio: Share = 0.1
    """Share of the frames with fume."""
    stripe_lost_ratio: Share = 0.02
    """Share of the frames whose laser fails, in part or (from strength 1 on) wholly."""
    sensor_knocked_ratio: Share = 0.02
    """Share of the frames with a knocked sensor."""
    stuck_exposure_ratio: Share = 0.02
    """Share of the frames with a stuck exposure."""
    disturbance_strength: tuple[Positive, Positive] = (0.03, 1.0)
    """Strength of the disturbances, as a multiple of the usual, from and to, even in its logarithm."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value == ():
                raise BadInput(f"dataset.{name}: found none, expected one or more")
            if isinstance(value, tuple) and not isinstance(value[0], str) and value[0] > value[1]:
                raise BadInput(f"dataset.{name}: found {value[0]:g} to {value[1]:g}, expected the smaller one first")

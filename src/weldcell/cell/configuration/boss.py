"""The boss and its scan."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le

from weldcell.cell.configuration.bounds import Finite, Point, Positive, Unsigned
from weldcell.cell.configuration.surface import MaterialName, TextureName


@dataclass(frozen=True, kw_only=True)
class BossConfig:
    """The boss (square frustum) and its scan."""

    slant_edge_mm: Positive = 50.0
    """Length of each slanted edge."""
    slope_deg: Annotated[float, Ge(10), Le(85)] = 53.13010235415598
    """Angle between slanted faces and base (tan = 4/3)."""
    top_mm: Positive = 40.0
    """Side of the square top."""
    material: MaterialName = "matt-white"
    """What the boss's surface is."""
    texture: TextureName = "none"
    """Pattern of the boss's brightness."""
    position_mm: Point = (930.0, 0.0, 300.0)
    """Centre of the boss's underside, in the robot base, as the controller was told."""
    yaw_deg: Finite = 0.0
    """Turn of the boss about the vertical."""
    misplacement_mm: Unsigned = 2.0
    """How far off the boss actually stands (one sigma, horizontal)."""
    misplacement_deg: Unsigned = 0.5
    """How far off the boss is actually turned (one sigma)."""
    frames: Annotated[int, Ge(16), Le(100_000)] = 140
    """Pictures of the boss, over two passes from opposite sides."""
    speed_mm_s: Positive = 40.0
    """Scan speed."""

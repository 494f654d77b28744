"""Welding along the seam, and what guides the torch."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from weldcell.cell.configuration.bounds import Angle, Share, Unsigned

Guidance = Literal["laser", "scan", "arc", "none"]
WeaveShape = Literal["none", "sine", "triangle"]


@dataclass(frozen=True, kw_only=True)
class WeldConfig:
    """Welding along the seam, guided by a sensor."""

    guidance: Guidance = "laser"
    """What guides the torch: the laser ahead of it, a scan made before, the arc's current, or nothing (as taught)."""
    speed_mm_s: Annotated[float, Gt(0), Le(500)] = 10.0
    """Welding speed."""
    frame_hz: Annotated[float, Ge(1), Le(1000)] = 10.0
    """Pictures a second while welding."""
    latency_ms: Unsigned = 50.0
    """From a picture's exposure until its result is there."""
    servo_hz: Annotated[float, Ge(100), Le(10_000)] = 1000.0
    """Rate at which the drives' physics steps."""
    command_hz: Annotated[float, Ge(20), Le(1000)] = 125.0
    """Rate at which the controller takes new places for the torch."""
    height_mm: Annotated[float, Ge(-20), Le(100)] = 0.0
    """Wire's tip above the seam's root (or edge), along the wire."""
    work_angle_deg: Angle = 0.0
    """How far the torch leans to the right, across the seam."""
    travel_angle_deg: Annotated[float, Ge(-45), Le(45)] = 0.0
    """How far the torch leans in the direction of travel: positive drags, negative pushes."""
    misplacement_mm: Annotated[float, Ge(0), Le(50)] = 5.0
    """How far off the part stands from where the controller was told (its direction is drawn)."""
    misplacement_deg: Annotated[float, Ge(0), Le(10)] = 1.0
    """How far off it is turned (either way, drawn)."""
    drift_mm: Annotated[float, Ge(0), Le(20)] = 2.0
    """How far the part drifts from when the arc is lit until the seam's end, by heat (its direction is drawn)."""
    arc: bool = True
    """Whether arc, spatter and fume disturb the sensor while the torch welds."""
    lost_frames_ratio: Share = 0.0
    """Share of the pictures that never arrive, at random."""
    weave: WeaveShape = "none"
    """Whether and how the torch weaves across the seam (guidance by the arc weaves as a sine at least)."""
    weave_amplitude_mm: Annotated[float, Ge(0), Le(10)] = 2.0
    """How far the weave swings to either side."""
    weave_hz: Annotated[float, Gt(0), Le(10)] = 2.0
    """Weaves a second."""
    feed_forward: bool = True
    """Whether the drives know velocity and torque of the path ahead, or follow places alone."""
    drift_model: bool = True
    """Whether the tracker tells drift from misplacement, and predicts it until the torch comes."""

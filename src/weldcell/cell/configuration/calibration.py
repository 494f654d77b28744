"""Calibration of hand-eye, robot and torch, and of camera and light plane."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from weldcell.cell.configuration.bounds import Point, Positive, Unsigned

CalibrationMethod = Literal["p2", "joint"]


@dataclass(frozen=True, kw_only=True)
class CalibrationConfig:
    """Hand-eye on the standard sphere, compensation by touches, and its verification."""

    sphere_diameter_mm: Positive = 40.0
    """Diameter of the standard sphere."""
    sphere_position_mm: Point = (930.0, 0.0, 430.0)
    """Where the sphere's centre was put, in the robot base (the actual place is a little off)."""
    translations: Annotated[int, Ge(4), Le(1000)] = 10
    """Views with the flange's orientation kept (they give the rotation)."""
    free_poses: Annotated[int, Ge(3), Le(1000)] = 10
    """Views from free poses (they give the translation)."""
    wanted_shift_mm: Unsigned = 0.0
    """Free views are left out once the mount's place is predicted this well (one sigma); 0 takes them all."""
    touches: Annotated[int, Ge(8), Le(10_000)] = 60
    """Touches of the torch tip on the sphere."""
    tip_radius_mm: Unsigned = 0.6
    """Radius of the rounded torch tip."""
    estimate_tip: bool = True
    """Estimate the torch tip from the touches as well; false is P2 to the letter (nominal tip)."""
    robot_sigma_mm: Annotated[float, Ge(1e-5), Le(100)] = 0.1
    """The robot's error for a single pose that the compensation expects: weighs it against the sights' own noise."""
    second_sphere_mm: Point = (0.0, 0.0, 0.0)
    """Where a second sphere stands from the first, on a bar of known length (joint estimate only); 0 0 0 is none."""
    viewpoints: Annotated[int, Ge(1), Le(1000)] = 10
    """Views of each point in the verification."""
    near_points_mm: tuple[Point, ...] = ((60.0, -50.0, 20.0), (-70.0, 30.0, 40.0), (20.0, 80.0, -20.0))
    """Verification points near the sphere, from the sphere's place."""
    far_points_mm: tuple[Point, ...] = ((-130.0, 320.0, 60.0), (-150.0, -330.0, 0.0), (120.0, 290.0, 160.0))
    """Verification points far from the sphere, from the sphere's place."""


@dataclass(frozen=True, kw_only=True)
class LaserPlaneConfig:
    """Calibration of camera and light plane by boards held before the sensor, in the light of the room."""

    exposure_ms: Positive = 0.5
    """Exposure for boards: print and stripe must both show well."""
    ambient_grey: Annotated[float, Gt(0), Le(2000)] = 200.0
    """Level (of 255) of a white surface after 1 ms at 0 dB, the room lit for it."""
    boards: Annotated[int, Ge(4), Le(200)] = 15
    """Pictures of the chessboard with the stripe on it."""
    columns: Annotated[int, Ge(4), Le(60)] = 17
    """Inner corners of the chessboard along its longer side."""
    rows: Annotated[int, Ge(3), Le(60)] = 13
    """Inner corners along the shorter side."""
    square_mm: Unsigned = 0.0
    """Side of a square; 0 is what fills 3/4 of the view."""
    lean_deg: Annotated[float, Ge(10), Le(65)] = 50.0
    """Largest lean of the chessboard against the picture."""
    positions: Annotated[int, Ge(3), Le(200)] = 10
    """Places of the board of parallel lines along the camera's axis."""
    lines: Annotated[int, Ge(2), Le(20)] = 2
    """Lines on it; P1 has two."""
    misfacing_deg: Unsigned = 0.0
    """How far that board is off facing the camera (one sigma about each axis), which the method takes as 0."""
    step_targets: Annotated[int, Ge(1), Le(200)] = 8
    """Pictures of the target with steps."""
    noise_px: tuple[Unsigned, ...] = (0.0, 0.1, 0.3, 1.0)
    """Normal noise that is added to the found features (each axis) to compare the methods."""
    noise_repeats: Annotated[int, Ge(1), Le(100)] = 3
    """Draws of that noise; the table has their medians."""

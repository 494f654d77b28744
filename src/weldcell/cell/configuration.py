"""Every setting of a run, as plain frozen values with units in their names and bounds that are checked.

`scenarios.settings` builds these from YAML and the command line; each field becomes an option.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

RobotTier = Literal["perfect", "calibrated", "typical", "bad", "paper"]

Positive = Annotated[float, Gt(0), Le(1e6)]
Unsigned = Annotated[float, Ge(0), Le(1e6)]
Finite = Annotated[float, Ge(-1e6), Le(1e6)]
Point = tuple[Finite, Finite, Finite]


@dataclass(frozen=True, kw_only=True)
class SensorConfig:
    """The laser-line sensor (P2's) as designed."""

    width_px: Annotated[int, Ge(16), Le(8192)] = 1440
    """Picture width."""
    height_px: Annotated[int, Ge(16), Le(8192)] = 1080
    """Picture height."""
    pixel_um: Positive = 3.45
    """Pixel pitch."""
    focal_mm: Positive = 12.0
    """Focal length of the lens."""
    working_distance_mm: Positive = 275.0
    """From the camera's centre to where its axis meets the light plane."""
    triangulation_deg: Annotated[float, Ge(5), Le(80)] = 45.0
    """Angle between the camera's axis and the light plane."""
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (-0.10, 0.12, 2e-4, -1e-4, 0.0)
    """OpenCV's k1 k2 p1 p2 k3 of the lens."""
    laser_line_um: Positive = 160.0
    """Thickness of the light sheet, full width at 1/e^2."""
    laser_fan_deg: Annotated[float, Ge(1), Le(120)] = 40.0
    """Full opening angle of the light fan."""
    f_number: Positive = 8.0
    """Aperture: sets blur by diffraction and the speckle's grain."""
    peak_grey: Annotated[float, Ge(1), Le(255)] = 200.0
    """Grey level of the stripe on a matt white surface hit head-on."""
    ambient_grey: Annotated[float, Ge(0), Le(255)] = 18.0
    """Grey level of a white surface in the cell's light, through the band-pass filter."""
    noise: bool = True
    """Photon noise, read noise and speckle; quantisation to 8 bits is always there."""
    electrons_per_grey: Positive = 41.0
    """Photo-electrons for one grey level (10.5 ke- full well over 255 levels)."""
    read_noise_grey: Unsigned = 0.5
    """Read noise, one sigma."""
    speckle_contrast: Annotated[float, Ge(0), Le(1)] = 0.45
    """Contrast of the laser's speckle within one pixel."""


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
    touches: Annotated[int, Ge(8), Le(10_000)] = 60
    """Touches of the torch tip on the sphere."""
    tip_radius_mm: Unsigned = 0.6
    """Radius of the rounded torch tip."""
    estimate_tip: bool = True
    """Estimate the torch tip from the touches as well; false is P2 to the letter (nominal tip)."""
    robot_sigma_mm: Annotated[float, Ge(1e-5), Le(100)] = 0.1
    """The robot's error for a single pose that the compensation expects: weighs it against the sights' own noise."""
    viewpoints: Annotated[int, Ge(1), Le(1000)] = 10
    """Views of each point in the verification."""
    near_points_mm: tuple[Point, ...] = ((60.0, -50.0, 20.0), (-70.0, 30.0, 40.0), (20.0, 80.0, -20.0))
    """Verification points near the sphere, from the sphere's place."""
    far_points_mm: tuple[Point, ...] = ((-130.0, 320.0, 60.0), (-150.0, -330.0, 0.0), (120.0, 290.0, 160.0))
    """Verification points far from the sphere, from the sphere's place."""


@dataclass(frozen=True, kw_only=True)
class SeamConfig:
    """The V-groove plate and its scan."""

    length_mm: Positive = 300.0
    """Length of the plate along the seam."""
    width_mm: Positive = 160.0
    """Width of the plate across the seam."""
    thickness_mm: Positive = 60.0
    """Plate thickness."""
    groove_angle_deg: Annotated[float, Ge(10), Le(120)] = 45.0
    """Groove angle between the two walls."""
    root_gap_mm: Unsigned = 0.0
    """Gap at the root."""
    root_face_mm: Unsigned = 4.0
    """Height of the land below the root."""
    amplitude_mm: Unsigned = 20.0
    """How far the S-shaped path swings to either side."""
    position_mm: Point = (930.0, 0.0, 300.0)
    """Centre of the plate's underside, in the robot base, as the controller was told."""
    yaw_deg: Finite = 90.0
    """Direction of the seam and of travel, about the vertical from the base's x."""
    misplacement_mm: Unsigned = 2.0
    """How far off the plate actually stands (one sigma, horizontal)."""
    misplacement_deg: Unsigned = 0.3
    """How far off the plate is actually turned (one sigma)."""
    frames: Annotated[int, Ge(8), Le(100_000)] = 300
    """Pictures along the seam."""
    speed_mm_s: Positive = 20.0
    """Scan speed."""


@dataclass(frozen=True, kw_only=True)
class BossConfig:
    """The boss (square frustum) and its scan."""

    slant_edge_mm: Positive = 50.0
    """Length of each slanted edge."""
    slope_deg: Annotated[float, Ge(10), Le(85)] = 53.13010235415598
    """Angle between slanted faces and base (tan = 4/3)."""
    top_mm: Positive = 40.0
    """Side of the square top."""
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
    sensor: SensorConfig = field(default_factory=SensorConfig)
    """The laser-line sensor."""
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    """Hand-eye calibration and compensation."""
    seam: SeamConfig = field(default_factory=SeamConfig)
    """V-groove plate and scan."""
    boss: BossConfig = field(default_factory=BossConfig)
    """Boss and scan."""
    recording: RecordingConfig = field(default_factory=RecordingConfig)
    """The recording."""

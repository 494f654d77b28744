"""Every setting of a run, as plain frozen values with units in their names and bounds that are checked.

`scenarios.settings` builds these from YAML and the command line; each field becomes an option.
"""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from weldcell.cell.errors import BadInput

CalibrationMethod = Literal["p2", "joint"]
RobotTier = Literal["perfect", "calibrated", "typical", "bad", "paper"]

SensorPreset = Literal["p2", "p1", "profiler"]
MaterialName = Literal["matt-white", "mill-scale", "ground-steel", "stainless", "aluminium", "polished"]
TextureName = Literal["none", "brushed", "scratched"]
JointName = Literal["butt", "v", "v-gap", "bevel", "u", "j", "lap", "fillet", "corner"]
PathName = Literal["straight", "arc", "s", "surface", "saddle"]
Guidance = Literal["laser", "scan", "arc", "none"]
WeaveShape = Literal["none", "sine", "triangle"]
DisturbanceKind = Literal["arc", "spatter", "fume", "stripe-lost", "sensor-knocked", "stuck-exposure"]

Positive = Annotated[float, Gt(0), Le(1e6)]
Unsigned = Annotated[float, Ge(0), Le(1e6)]
Finite = Annotated[float, Ge(-1e6), Le(1e6)]
Angle = Annotated[float, Ge(-89), Le(89)]
Point = tuple[Finite, Finite, Finite]
Share = Annotated[float, Ge(0), Le(1)]
Gain = Annotated[float, Ge(0), Le(48)]
Grey = Annotated[float, Gt(0), Le(255)]
GrooveAngle = Annotated[float, Ge(10), Le(120)]
Spots = Annotated[int, Ge(0), Le(100)]


@dataclass(frozen=True, kw_only=True)
class SensorConfig:
    """The laser-line sensor as designed; `SENSOR_PRESETS` holds three whose values are the fields' defaults."""

    preset: SensorPreset = "p2"
    """Sensor that the other fields' defaults are taken from."""
    width_px: Annotated[int, Ge(16), Le(8192)] = 1440
    """Picture width."""
    height_px: Annotated[int, Ge(16), Le(8192)] = 1080
    """Picture height."""
    pixel_um: Positive = 3.45
    """Pixel pitch."""
    focal_mm: Positive = 12.0
    """Focal length as a calibration finds it: from the lens to the picture when in focus."""
    working_distance_mm: Positive = 275.0
    """From the camera's centre to where its axis meets the light plane."""
    triangulation_deg: Annotated[float, Ge(5), Le(80)] = 45.0
    """Angle between the camera's axis and the light plane."""
    look_ahead_mm: Positive = 60.0
    """From the torch's tip forward to the light plane."""
    below_tip_mm: Finite = 25.0
    """From the torch's tip down to where the camera's axis meets the light: puts the joint into the range."""
    stripe_along: Literal["rows", "columns"] = "rows"
    """What the stripe of a flat surface runs along in the picture; depth moves it across."""
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (-0.10, 0.12, 2e-4, -1e-4, 0.0)
    """OpenCV's k1 k2 p1 p2 k3 of the lens."""
    rational: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)
    """OpenCV's k4 k5 k6 (rational model)."""
    thin_prism: tuple[Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0)
    """OpenCV's s1 s2 s3 s4."""
    tilt_deg: tuple[Angle, Angle] = (0.0, 0.0)
    """Tilt of the picture's plane against the lens (Scheimpflug): OpenCV's tau_x and tau_y."""
    f_number: Positive = 8.0
    """Aperture: sets blur by diffraction, depth of field and the speckle's grain."""
    focus_mm: Unsigned = 0.0
    """Distance along the axis at which the lens is in focus; 0 is the working distance."""
    wavelength_nm: Annotated[float, Ge(300), Le(2000)] = 658.0
    """The laser's wavelength."""
    laser_linewidth_nm: Unsigned = 1.0
    """The laser's spectral width, full at half maximum: on rough surfaces it takes contrast from the speckle."""
    laser_line_um: Positive = 160.0
    """Thickness of the light sheet at its waist, full width at 1/e^2."""
    laser_range_mm: Unsigned = 0.0
    """From the laser's source to where its sheet meets the camera's axis; 0 is level with the camera as light goes."""
    laser_waist_mm: Unsigned = 0.0
    """Distance of the sheet's waist from the laser; 0 is where the sheet meets the camera's axis."""
    laser_m2: Annotated[float, Ge(1), Le(1000)] = 1.2
    """Beam quality M^2: how much faster than an ideal beam the sheet grows away from its waist."""
    laser_fan_deg: Annotated[float, Ge(1), Le(120)] = 40.0
    """Full opening angle of the light fan."""
    laser_profile: Literal["uniform", "gaussian"] = "uniform"
    """Power along the fan: even, or falling to 1/e^2 at the fan's ends."""
    exposure_ms: Positive = 1.0
    """Exposure time: light, arc and motion blur go with it."""
    gain_db: Annotated[float, Ge(0), Le(48)] = 0.0
    """Gain: grey levels for a photo-electron go with it."""
    peak_grey: Annotated[float, Ge(1), Le(255)] = 200.0
    """Level (of 255) of the stripe on a matt white surface hit head-on, after 1 ms at 0 dB."""
    ambient_grey: Annotated[float, Ge(0), Le(255)] = 18.0
    """Level (of 255) of a white surface in the cell's light through the band-pass filter, after 1 ms at 0 dB."""
    bits: Literal[8, 12] = 8
    """Bits of a pixel; 12 bits come as 16-bit numbers from 0 to 4095."""
    noise: bool = True
    """Photon noise, read noise, fixed pattern and speckle; quantisation is always there."""
    electrons_per_grey: Positive = 41.0
    """Photo-electrons for one level of 255 at 0 dB."""
    full_well_electrons: Positive = 10_500.0
    """Charge that a pixel can hold."""
    blooming_ratio: Annotated[float, Ge(0), Le(1)] = 0.0
    """Share of the charge beyond the full well that spills into the neighbours along the column."""
    read_noise_grey: Unsigned = 0.5
    """Read noise (levels of 255 at 0 dB), one sigma."""
    gain_spread_ratio: Annotated[float, Ge(0), Le(0.2)] = 0.005
    """Fixed pattern: spread of the pixels' response (PRNU), one sigma."""
    offset_spread_electrons: Unsigned = 1.0
    """Fixed pattern: spread of the pixels' dark level (DSNU), one sigma."""
    speckle_ratio: Annotated[float, Ge(0), Le(1)] = 1.0
    """Share left of the speckle contrast that the optics imply; 0 is a perfect despeckler."""
    profile_only: bool = False
    """No pictures: stripe centres straight from the exact ones, scattered as the pictures' physics has it; for studies
    of many trials."""
    motion_blur: bool = False
    """Whether motion during the exposure blurs the picture."""
    second_bounce: bool = True
    """Whether the laser's reflection from shiny surfaces lights others (ghost stripes)."""


SENSOR_PRESETS: dict[SensorPreset, SensorConfig] = {
    "p2": SensorConfig(),
    "p1": SensorConfig(
        preset="p1",
        width_px=1280,
        height_px=1024,
        pixel_um=5.2,
        focal_mm=6.7595,
        working_distance_mm=89.4314,  # b tan(theta): b = 91.42 mm, theta = 44.37 deg (P1, table I)
        triangulation_deg=45.63,  # 90 deg - theta
        below_tip_mm=0.0,  # the range reaches from 40 mm above the axis to 120 mm below it
        stripe_along="columns",
        laser_range_mm=127.889,  # b / cos(theta): b is measured level with the camera along its X axis
        laser_line_um=200.0,  # the sheet stays thin over the range: z_R = 40 mm
    ),
    "profiler": SensorConfig(
        preset="profiler",
        width_px=2048,
        height_px=1088,
        pixel_um=5.5,
        focal_mm=20.0,
        working_distance_mm=190.0,
        triangulation_deg=30.0,
        distortion=(-0.04, 0.02, 0.0, 0.0, 0.0),
        tilt_deg=(-10.3327, 0.0),  # Scheimpflug: tan(tilt) = -focal / distance * cot(triangulation)
        wavelength_nm=450.0,
        laser_fan_deg=44.0,
    ),
}
"""P2's sensor (1440 x 1080, 12 mm); P1's (its table I; the paper names no camera: a common 1/2 inch one); a profiler of
2048 points with a tilted lens, as commercial ones are."""


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
class SeamConfig:
    """The workpiece with its seam, and its scan; `SEAM_PRESETS` holds the sizes that are each joint's defaults."""

    joint: JointName = "v"
    """Joint; the other fields' defaults are sizes that suit it."""
    path: PathName = "s"
    """Course of the seam; `surface` is an S on a free-form surface (grooves), `saddle` a branch pipe on a run pipe."""
    length_mm: Positive = 300.0
    """Length of the part along the seam."""
    width_mm: Positive = 160.0
    """Width of the part across the seam."""
    thickness_mm: Positive = 60.0
    """Plate thickness; of a lap and a fillet that of the lower plate."""
    groove_angle_deg: Annotated[float, Ge(0), Le(120)] = 45.0
    """Groove angle between the two walls."""
    root_gap_mm: Unsigned = 0.0
    """Gap at the root; of a lap and a fillet between the plates."""
    root_gap_end_mm: Annotated[float, Ge(-1), Le(1e6)] = -1.0
    """Gap at the seam's end if it changes along the seam (0: it closes); -1 is the same all along."""
    root_gap_share: Annotated[float, Gt(0), Le(1)] = 1.0
    """Share of the seam over which the gap changes evenly; from there on it stays."""
    root_face_mm: Unsigned = 4.0
    """Height of the land below the root."""
    root_radius_mm: Unsigned = 0.0
    """Radius of the rounded bottom of a U or J."""
    mismatch_mm: Finite = 0.0
    """How much higher the left member of a groove stands."""
    upper_thickness_mm: Unsigned = 0.0
    """Thickness of a lap's upper plate and of a fillet's web; 0 is the lower plate's."""
    rise_mm: Positive = 50.0
    """Height of a fillet's web; length of a corner's plates along their inner sides."""
    corner_angle_deg: Annotated[float, Ge(30), Le(150)] = 90.0
    """Angle between both plates of a corner, on the inner side."""
    amplitude_mm: Unsigned = 20.0
    """How far an S-shaped path swings to either side."""
    radius_mm: Finite = 400.0
    """Radius of an arc; negative bends to the right."""
    surface_wave_mm: Unsigned = 18.0
    """How far a free-form surface swings up and down along the seam."""
    run_radius_mm: Positive = 75.0
    """Outer radius of a saddle's run pipe."""
    branch_radius_mm: Positive = 35.0
    """Outer radius of a saddle's branch pipe."""
    saddle_deg: tuple[Finite, Finite] = (200.0, 340.0)
    """Where a saddle's seam begins and ends about the branch's axis, from the run's direction counter-clockwise."""
    tack_welds: Annotated[int, Ge(0), Le(50)] = 0
    """Tack welds, evenly along the seam."""
    tack_length_mm: Positive = 15.0
    """Length of a tack weld."""
    part_file: str = ""
    """YAML file of a part of one's own, instead of all these sizes; `joint` says how its seam is found."""
    material: MaterialName = "matt-white"
    """What the part's surface is."""
    texture: TextureName = "none"
    """Pattern of the part's brightness."""
    tack_spots: Annotated[int, Ge(0), Le(100)] = 0
    """Dark heat-tinted spots along the seam, where it was tacked."""
    position_mm: Point = (930.0, 0.0, 300.0)
    """Centre of the part's underside, in the robot base, as the controller was told."""
    yaw_deg: Finite = 90.0
    """Direction of the seam and of travel, about the vertical from the base's x."""
    misplacement_mm: Unsigned = 2.0
    """How far off the part actually stands (one sigma, horizontal)."""
    misplacement_deg: Unsigned = 0.3
    """How far off the part is actually turned (one sigma)."""
    frames: Annotated[int, Ge(8), Le(100_000)] = 300
    """Pictures along the seam."""
    speed_mm_s: Positive = 20.0
    """Scan speed."""
    scan_height_mm: Annotated[float, Ge(0), Le(100)] = 20.0
    """Wire's tip above the joint's highest feature during the scan; 20 mm more where the torch would touch the part."""


SEAM_PRESETS: dict[JointName, SeamConfig] = {
    "v": SeamConfig(),
    "v-gap": SeamConfig(joint="v-gap", thickness_mm=20.0, groove_angle_deg=60.0, root_gap_mm=2.0, root_face_mm=2.0),
    "butt": SeamConfig(joint="butt", thickness_mm=8.0, root_gap_mm=1.0, root_face_mm=0.0),
    "bevel": SeamConfig(joint="bevel", thickness_mm=20.0, groove_angle_deg=45.0, root_face_mm=2.0),
    "u": SeamConfig(joint="u", thickness_mm=25.0, groove_angle_deg=20.0, root_face_mm=3.0, root_radius_mm=6.0),
    "j": SeamConfig(joint="j", thickness_mm=25.0, groove_angle_deg=20.0, root_face_mm=3.0, root_radius_mm=8.0),
    "lap": SeamConfig(joint="lap", thickness_mm=6.0, root_face_mm=0.0),
    "fillet": SeamConfig(joint="fillet", thickness_mm=10.0, root_face_mm=0.0),
    "corner": SeamConfig(joint="corner", thickness_mm=12.0, root_face_mm=2.0),
}
"""P2's plate for the V; the others in sizes that ISO 9692-1 recommends for arc welding, with plates that suit them."""


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


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Something that disturbs the sensor between two times of a job."""

    kind: DisturbanceKind
    """What happens."""
    start_s: Unsigned = 0.0
    """When it begins."""
    end_s: Unsigned = 1e6
    """When it is over."""
    strength: Unsigned = 1.0
    """How strong it is, as a multiple of the usual."""

    def __post_init__(self) -> None:
        if self.end_s < self.start_s:
            found = f"{self.kind} from {self.start_s:g} to {self.end_s:g} s"
            raise BadInput(f"found {found}, expected the smaller one first")


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

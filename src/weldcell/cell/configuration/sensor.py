"""The laser-line sensor, and the three that come with the cell."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le

from weldcell.cell.configuration.bounds import Angle, Finite, Positive, Unsigned

SensorPreset = Literal["p2", "p1", "profiler"]


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

"""From light to a noisy 8-bit picture: speckle, photon noise, read noise, quantisation."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.stripe import WAVELENGTH_UM

_SEED_LIMIT = 2**31 - 1  # cv2.setRNGSeed takes a positive 32-bit integer
_COARSEST_GRAIN_PX = 16.0  # a lens that makes coarser grain than this makes no stripe either


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """The camera's and the laser's noise."""

    electrons_per_grey: float
    """Photo-electrons for one grey level."""
    read_noise_grey: float
    """Standard deviation of the read noise."""
    speckle_contrast: float
    """Standard deviation of the speckle's factor (its mean is 1)."""
    grain_px: float
    """Size of the speckle's grain: its correlation is exp(-d^2 / 2 grain^2)."""

    def __post_init__(self) -> None:
        for name in ("electrons_per_grey", "read_noise_grey", "speckle_contrast", "grain_px"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadInput(f"noise: {name} is {value}, expected a finite number >= 0")
        if self.electrons_per_grey == 0:
            raise BadInput("noise: electrons_per_grey is 0, expected more")


def noise_model(config: SensorConfig) -> NoiseModel | None:
    """The noise of a sensor, or None where it is switched off.

    Speckle is the interference of the light through one lens opening, so its grain is the size of the Airy disc
    (Goodman, Speckle Phenomena in Optics, 2007): correlation sigma 0.42 lambda N, widened by the pixel (a box against
    a box is a triangle of variance 1/6).
    """
    if not config.noise:
        return None
    magnification = config.focal_mm / (config.working_distance_mm - config.focal_mm)
    airy_px = 0.42 * WAVELENGTH_UM * config.f_number * (1 + magnification) / config.pixel_um
    return NoiseModel(
        electrons_per_grey=config.electrons_per_grey,
        read_noise_grey=config.read_noise_grey,
        speckle_contrast=config.speckle_contrast,
        grain_px=float(np.sqrt(airy_px**2 + 1 / 6)),
    )


def expose(
    ambient_grey: Float[np.ndarray, "height width"],
    laser: LaserLight,
    noise: NoiseModel | None,
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "height width"]:
    """The picture (8 bits, clipped) of ambient light plus laser light; the same `rng` gives the same bytes.

    Without noise it is only rounded to the nearest level.
    """
    light = np.array(ambient_grey, dtype=np.float32)
    lit_rows = light[laser.first_row : laser.first_row + len(laser.grey)]
    if noise is None:
        lit_rows += laser.grey
        return _quantise(light)
    if noise.speckle_contrast > 0 and laser.grey.size:
        lit_rows += laser.grey * speckle(laser.grey.shape, noise.speckle_contrast, noise.grain_px, rng)
    else:
        lit_rows += laser.grey
    sigma_grey = light * np.float32(1 / noise.electrons_per_grey)
    sigma_grey += np.float32(noise.read_noise_grey**2)
    cv2.sqrt(sigma_grey, dst=sigma_grey)
    sigma_grey *= _standard_normal(light.shape, rng)
    light += sigma_grey
    return _quantise(light)


def speckle(
    shape: tuple[int, int], contrast: float, grain_px: float, rng: np.random.Generator
) -> Float[np.ndarray, "height width"]:
    """Factors of mean 1 and standard deviation `contrast`, gamma-distributed, correlated over the grain.

    Gamma with shape k = 1/contrast^2 is the intensity of k independent speckle patterns (Goodman, 2007). It comes from
    a correlated normal field g by Wilson and Hilferty's cube: k (1 - 1/(9k) + g/(3 sqrt(k)))^3 / k, whose mean and
    contrast are right to 1 % for contrasts up to 0.6 (3 % at 1).
    """
    taps = _grain_taps(grain_px)
    white = _standard_normal(shape, rng)
    field = np.asarray(cv2.sepFilter2D(white, cv2.CV_32F, taps, taps, borderType=cv2.BORDER_REFLECT), dtype=np.float32)
    shape_k = 1 / contrast**2
    field *= np.float32(1 / (3 * np.sqrt(shape_k)))
    field += np.float32(1 - 1 / (9 * shape_k))
    np.maximum(field, 0, out=field)
    return field * field * field


def _grain_taps(grain_px: float) -> Float[np.ndarray, "taps"]:
    """Filter that gives white noise the correlation exp(-d^2 / 2 grain^2) between pixels, and keeps its variance.

    The root of the sampled correlation's own spectrum: a sampled Gaussian filter correlates fine grain too little.
    """
    grain_px = min(max(grain_px, 0.1), _COARSEST_GRAIN_PX)
    reach = int(np.ceil(5 * grain_px)) + 3
    correlation = np.exp(-(np.arange(-reach, reach + 1) ** 2) / (2 * grain_px**2))
    spectrum = np.maximum(np.fft.fft(np.fft.ifftshift(correlation)).real, 0)
    taps = np.fft.fftshift(np.fft.ifft(np.sqrt(spectrum)).real)
    return (taps / np.linalg.norm(taps)).astype(np.float32)


def _standard_normal(shape: tuple[int, int], rng: np.random.Generator) -> Float[np.ndarray, "height width"]:
    """Normal numbers (float32) by OpenCV's generator, seeded from `rng`: seven times as fast as NumPy's."""
    cv2.setRNGSeed(int(rng.integers(1, _SEED_LIMIT)))
    numbers = np.empty(shape, np.float32)
    cv2.randn(numbers, np.zeros(1), np.ones(1))
    return numbers


def _quantise(light: Float[np.ndarray, "height width"]) -> UInt8[np.ndarray, "height width"]:
    """Nearest grey level (halves to the even one, so no bias), clipped to 0..255."""
    return np.asarray(cv2.addWeighted(light, 1, light, 0, 0, dtype=cv2.CV_8U), dtype=np.uint8)  # rounds and saturates

"""How bright a radiance in the laser's band is in the picture, and how bright hot steel is in that band.

A lens of diameter A at the distance c before the picture turns the radiance L of a surface into the irradiance
pi t L (A / 2c)^2 of a pixel (Boreman, Basic Electro-Optics for Electrical Engineers, 1998), whatever the distance. A
pixel of side a collects that over an exposure of 1 ms as photons of energy h c / lambda, of which the quantum
efficiency become electrons.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.configuration import SensorConfig
from weldcell.sensor_sim.focus import lens

FILTER_WIDTH_NM = 10.0
"""Width of the band-pass filter before the lens: the usual hard-coated laser-line filter."""
_TRANSMISSION = 0.8  # of lens and filter at the laser's line
_QUANTUM_EFFICIENCY = 0.5  # of a global-shutter CMOS chip in the red (EMVA 1288 sheets of such chips: 0.4 to 0.6)
_EXPOSURE_S = 1e-3  # light is counted in levels of 255 after 1 ms at 0 dB

_PLANCK_J_S, _LIGHT_M_S, _BOLTZMANN_J_K = 6.62607015e-34, 299_792_458.0, 1.380649e-23  # CODATA 2018
_STEEL_EMISSIVITY = 0.4  # liquid iron in the red, normal: 0.35 to 0.4 (Touloukian & DeWitt, 1970)


@dataclass(frozen=True, kw_only=True)
class Photometry:
    """The camera's response to light within its filter's band."""

    grey_per_radiance: float
    """Levels of 255, after 1 ms at 0 dB, for 1 W/(m^2 sr) within the band."""
    wavelength_m: float
    """Centre of the band."""

    def hot_steel_grey(self, temperature_k: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Level of an extended surface of steel at this temperature: Planck's law times its emissivity."""
        exponent = _PLANCK_J_S * _LIGHT_M_S / (self.wavelength_m * _BOLTZMANN_J_K * np.asarray(temperature_k))
        per_metre = 2 * _PLANCK_J_S * _LIGHT_M_S**2 / self.wavelength_m**5 / np.expm1(np.minimum(exponent, 600.0))
        return self.grey_per_radiance * _STEEL_EMISSIVITY * per_metre * FILTER_WIDTH_NM * 1e-9


def photometry(config: SensorConfig) -> Photometry:
    """The response of a sensor."""
    glass = lens(config)
    pixel_m, wavelength_m = 1e-6 * config.pixel_um, 1e-9 * config.wavelength_nm
    irradiance = np.pi * _TRANSMISSION * (glass.aperture_m / (2 * glass.principal_m)) ** 2
    photons = irradiance * pixel_m**2 * _EXPOSURE_S * wavelength_m / (_PLANCK_J_S * _LIGHT_M_S)
    return Photometry(
        grey_per_radiance=photons * _QUANTUM_EFFICIENCY / config.electrons_per_grey, wavelength_m=wavelength_m
    )

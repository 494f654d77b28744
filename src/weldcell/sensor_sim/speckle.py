"""Laser speckle: its contrast and grain from the optics, and light that has it.

Grain. The picture of a rough surface in laser light is a random field, seen through a round lens opening: its
brightness is correlated over d as |mu(d)|^2 = (2 J1(x) / x)^2, x = pi d / (lambda N'), with the working f-number
N' = N (1 + m) (Goodman, Speckle Phenomena in Optics, 2007, section 4.4). Here it is a Gaussian exp(-d^2 / 2 g^2) with
the same integral along a line, 32 lambda N' / (3 pi^2), so

    g = 0.431 lambda N'.

Across a thin line the grain is coarser. Let the light sheet's geometric image be Gaussian with one sigma p, and the
lens's blur too, a (both of brightness). The field h * (a rough line) then has the covariance

    integral h(v - x) h(v' - x) exp(-x^2 / 2 p^2) dx  ~  sqrt(I(v) I(v')) exp(-(v - v')^2 / 4 g'^2),

with I = exp(-v^2 / 2 s^2) the blurred stripe, s^2 = a^2 + p^2, and g' = g s / p (a Gaussian Schell-model beam: Mandel
and Wolf, Optical Coherence and Quantum Optics, 1995, section 5.6). So the stripe is its mean times a stationary
speckle, and where the lens can't resolve the line, it is one grain wide and its centre stands still.

Stripe centre. With contrast C along the line the centroid of one column scatters by, to first order in C,

    sigma_v^2 = C^2 g' s^4 / (2 s^2 + g'^2)^(3/2)     (C^2 g' s sqrt(2) / 4 for s >> g').

*It grows with the line's width.* Dorsch, Häusler and Herrmann (Applied Optics 33, 1994) have sigma_v = C lambda N' / pi
(in depth C lambda / (2 pi sin u sin theta)) without the width. That holds where the sheet's image is as wide as the
lens's Airy disc, 4 p = 2.44 lambda N'; thinner lines scatter less, wider ones more.

Pixels average. Along the stripe that is a box against a box over the correlation (Goodman, section 4.6). Across it, the
pixel averages stripe and speckle together: I(v) and I(v') of the covariance above are blurred by 1/12 each, which
leaves it of the same form: S^2 = s^2 + 1/12 for s^2,

    G^2 = (S / s)^4 (2 s^2 + g'^2) - 2 S^2     for g'^2,

and a share g' / sqrt(g'^2 + 2 s^2) * sqrt(G^2 + 2 S^2) / G of C^2, so that the centroid scatters by as much as before.

Contrast. The other factors of C^2 (variance over squared mean) are:
- polarisation: a surface that depolarises sends two independent patterns, 1/2 (Goodman, section 4.3);
- spectrum: patterns of two wavelengths differ where the light's ways do. For ways with the standard deviation L and a
  Gaussian spectrum of half width delta at 1/e, (1 + 8 pi^2 (L delta / lambda^2)^2)^(-1/2) (Goodman, section 6.3, for
  L = sigma_h (cos i + cos o), the height's standard deviation sigma_h seen in and out). Across what one grain sees of
  a surface that is seen askew, 1/w^2 = 1/a^2 + 1/p^2 on the surface, the ways differ by w sin(o) as well;
- what a despeckler leaves.

Surfaces are taken as lit head-on; the lens out of focus is taken to leave the grain as it is (as it nearly does).
"""

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.special import erf

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.sensor_sim.design import laser_range_m
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.focus import lens
from weldcell.sensor_sim.laser import laser_sheet
from weldcell.sensor_sim.materials import MATERIALS
from weldcell.sensor_sim.normal_field import normal_field

_GRAIN = 32 / (3 * np.pi**2) / np.sqrt(2 * np.pi)  # 0.431
_AIRY_SIGMA = 0.42  # of the Airy disc over lambda N, as `focus` takes it
_FINEST_PX, _COARSEST_PX = 0.05, 16.0  # finer is averaged away; a lens with coarser grain makes no stripe either
_PERIOD_PX = 64  # across the stripe the field repeats then: more than one column's light is wide, and it fits the cache
_FAINTEST_TAP = 0.01  # of the largest: loses 1e-4 of the variance


@dataclass(frozen=True, kw_only=True)
class Speckle:
    """The speckle of a sensor's stripe, as its pixels see it."""

    contrast: float
    """Standard deviation over mean of a pixel's laser light, on matt white."""
    along_px: float
    """Grain along the stripe before pixels average it: brightness correlates as exp(-d^2 / 2 along^2)."""
    across_px: float
    """Grain across the stripe, pixels included."""
    stripe_along: Literal["rows", "columns"]
    """What the stripe runs along in the picture."""

    def __post_init__(self) -> None:
        for name in ("contrast", "along_px", "across_px"):
            value = getattr(self, name)
            if not np.isfinite(value) or value < 0:
                raise BadInput(f"speckle: {name} is {value}, expected a finite number >= 0")

    @cached_property
    def filters(self) -> tuple[Float[np.ndarray, "along"], Float[np.ndarray, "across"]]:
        """Filters along and across the stripe that give white noise the grain, for `gamma_factors`."""
        return (
            _taps(self.correlation_along, self.along_px, self.contrast),
            _taps(self.correlation_across, self.across_px, self.contrast),
        )

    @cached_property
    def row_filter(self) -> Float[np.ndarray, "along"]:
        """Filter that gives white noise the grain along the stripe and leaves it normal, for `correlated_rows`."""
        return _taps(self.correlation_along, self.along_px, contrast=0.0)

    def correlation_along(self, lag_px: Float[np.ndarray, "*lags"]) -> Float[np.ndarray, "*lags"]:
        """Correlation of pixels this far apart along the stripe."""
        return pixel_covariance(lag_px, self.along_px) / pixel_covariance(np.zeros(1), self.along_px)

    def correlation_across(self, lag_px: Float[np.ndarray, "*lags"]) -> Float[np.ndarray, "*lags"]:
        """Correlation of pixels this far apart across the stripe."""
        return np.asarray(np.exp(-(lag_px**2) / (2 * max(self.across_px, _FINEST_PX) ** 2)))


def nominal_speckle(config: SensorConfig) -> Speckle:
    """The speckle of the stripe where the light plane meets the camera's axis; no contrast if noise is off."""
    matt = MATERIALS["matt-white"]
    contrast = speckle_contrast(config, np.array(matt.depolarises), np.array(matt.height_sigma_m))
    line = _line(config)
    return Speckle(
        contrast=float(contrast) if config.noise else 0.0,
        along_px=line.grain_px,
        across_px=min(line.pixel_grain_px, _COARSEST_PX),
        stripe_along=config.stripe_along,
    )


def speckle_contrast(
    config: SensorConfig, depolarises: Bool[np.ndarray, "*surfaces"], height_sigma_m: Float[np.ndarray, "*surfaces"]
) -> Float[np.ndarray, "*surfaces"]:
    """Contrast of a pixel's laser light on surfaces of which these are the `Material`'s values."""
    line, seen_rad = _line(config), np.deg2rad(config.triangulation_deg)
    ways_m = np.hypot(height_sigma_m * (1 + np.cos(seen_rad)), line.seen_m * np.sin(seen_rad))
    half_width_m = config.laser_linewidth_nm * 1e-9 / (2 * np.sqrt(np.log(2)))  # at 1/e, from full at half maximum
    spectrum = (1 + 8 * np.pi**2 * (ways_m * half_width_m / (config.wavelength_nm * 1e-9) ** 2) ** 2) ** -0.5
    pixel = line.pixel_share * pixel_covariance(np.zeros(()), line.grain_px)
    return np.asarray(config.speckle_ratio * np.sqrt(np.where(depolarises, 0.5, 1.0) * spectrum * pixel))


def pixel_covariance(lag_px: Float[np.ndarray, "*lags"], grain_px: float) -> Float[np.ndarray, "*lags"]:
    """Covariance of two pixels' averages, `lag_px` apart, of a variable with covariance exp(-d^2 / 2 grain^2).

    Places in two boxes of width 1 differ by a triangle's d, and a triangle is the second difference of a corner, so the
    integral is the second difference of F with F'' = exp(-d^2 / 2 grain^2). At 0 it is the variance that is left.
    """
    grain = float(np.clip(grain_px, _FINEST_PX, _COARSEST_PX))

    def corner(x: Float[np.ndarray, "*lags"]) -> Float[np.ndarray, "*lags"]:
        steep = x * grain * np.sqrt(np.pi / 2) * erf(x / (np.sqrt(2) * grain))
        return np.asarray(steep + grain**2 * np.exp(-(x**2) / (2 * grain**2)))

    return np.asarray(corner(lag_px + 1) - 2 * corner(lag_px) + corner(lag_px - 1))


def with_speckle(
    laser: LaserLight,
    speckle: Speckle,
    rng: np.random.Generator,
    contrast: Float[np.ndarray, "*band"] | None = None,
) -> LaserLight:
    """The laser's light with speckle; the same `rng` gives the same.

    `contrast` is the speckle's own unless given for each pixel: any array that broadcasts to the light's.
    """
    contrast = np.asarray(speckle.contrast if contrast is None else contrast, dtype=np.float32)
    if laser.grey.size == 0 or not contrast.any():
        return laser
    even = contrast.size == 1
    grey = np.empty_like(laser.grey)
    bands = [laser.grey, grey, np.broadcast_to(contrast, grey.shape)]
    light, speckled, contrasts = bands if speckle.stripe_along == "rows" else (band.T for band in bands)
    field = correlated_normals((_PERIOD_PX, light.shape[1]), speckle, rng)
    factors = gamma_factors(field, contrast.reshape(1, 1)) if even else field
    for first in range(0, len(light), _PERIOD_PX):
        block = slice(first, min(first + _PERIOD_PX, len(light)))
        here = factors[: block.stop - first]
        np.multiply(light[block], here if even else gamma_factors(here, contrasts[block]), out=speckled[block])
    return dataclasses.replace(laser, grey=grey)


def correlated_normals(
    shape: tuple[int, int], speckle: Speckle, rng: np.random.Generator
) -> Float[np.ndarray, "across along"]:
    """Standard normal numbers (float32) of which `gamma_factors` correlate as the speckle.

    The second axis runs along the stripe; each end of the field goes on at the other.
    """
    along, across = speckle.filters
    top, left = len(across) // 2, len(along) // 2
    white = cv2.copyMakeBorder(normal_field(shape, rng), top, top, left, left, cv2.BORDER_WRAP)
    field = cv2.sepFilter2D(white, cv2.CV_32F, along, across, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(field[top : top + shape[0], left : left + shape[1]])


def correlated_rows(
    shape: tuple[int, int], speckle: Speckle, rng: np.random.Generator
) -> Float[np.ndarray, "rows along"]:
    """Standard normal numbers that are correlated along the stripe as its centres are, in independent rows."""
    taps = speckle.row_filter
    white = normal_field((shape[0], shape[1] + len(taps) - 1), rng)
    reach = len(taps) // 2
    smooth = cv2.sepFilter2D(white, cv2.CV_32F, taps, np.ones(1, np.float32), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(smooth[:, reach : reach + shape[1]], dtype=float)


def gamma_factors(
    field: Float[np.ndarray, "rows columns"], contrast: Float[np.ndarray, "..."]
) -> Float[np.ndarray, "rows columns"]:
    """Gamma-distributed factors of mean 1 and standard deviation `contrast` from a standard normal field.

    Gamma with shape k = 1/contrast^2 is the brightness of k independent speckle patterns (Goodman, section 3.3). It
    comes by Wilson and Hilferty's cube, (1 - 1/(9k) + field/(3 sqrt(k)))^3, whose mean and contrast are right to 1 %
    for contrasts up to 0.6 (3 % at 1).
    """
    root = field * (contrast / 3)
    root += 1 - contrast**2 / 9
    np.maximum(root, 0, out=root)
    cube = root * root
    cube *= root
    return cube


def _taps(
    correlation_at: Callable[[Float[np.ndarray, "lags"]], Float[np.ndarray, "lags"]], reach_px: float, contrast: float
) -> Float[np.ndarray, "taps"]:
    """Filter for white noise that gives `gamma_factors` of it this correlation, and keeps its variance.

    The root of the sampled correlation's own spectrum: a sampled Gaussian filter correlates fine grain too little.
    """
    reach = int(np.ceil(4 * min(reach_px, _COARSEST_PX))) + 3
    correlation = _before_the_cube(correlation_at(np.arange(-reach, reach + 1.0)), contrast)
    spectrum = np.maximum(np.fft.fft(np.fft.ifftshift(correlation)).real, 0)
    taps = np.fft.fftshift(np.fft.ifft(np.sqrt(spectrum)).real)
    needed = np.flatnonzero(np.abs(taps) > _FAINTEST_TAP * taps.max())
    taps = taps[needed[0] : needed[-1] + 1]
    return (taps / np.linalg.norm(taps)).astype(np.float32)


def _before_the_cube(correlation: Float[np.ndarray, "lags"], contrast: float) -> Float[np.ndarray, "lags"]:
    """Correlation that a normal field needs so that `gamma_factors` of it correlate as given.

    (a + b x)^3 of normal x is a sum of Hermite polynomials of orders 1 to 3 with these variances, and the polynomial of
    order n correlates as the n-th power.
    """
    a, b = 1 - contrast**2 / 9, max(contrast, 1e-3) / 3
    variances = np.array([9 * b**2 * (a**2 + b**2) ** 2, 18 * a**2 * b**4, 6 * b**6])
    normal = np.linspace(0, 1, 200)
    cubed = (normal[:, None] ** [1, 2, 3]) @ variances / variances.sum()
    return np.interp(correlation, cubed, normal)


@dataclass(frozen=True, kw_only=True)
class _Line:
    """The stripe's own size, which its speckle across depends on."""

    grain_px: float
    """Grain of a wide surface (g)."""
    pixel_grain_px: float
    """Grain across the stripe with the pixel (G)."""
    pixel_share: float
    """Share of the squared contrast that the pixel leaves across the stripe."""
    seen_m: float
    """Standard deviation, on the surface across the stripe, of what one grain sees (w)."""


def _line(config: SensorConfig) -> _Line:
    """The stripe on a surface that lies head-on to the light where it meets the camera's axis, in focus."""
    view = lens(config)
    pixels_per_m = 1e6 * view.principal_m / (config.working_distance_mm * 1e-3) / config.pixel_um
    pixels_per_m *= np.cos(np.deg2rad(config.triangulation_deg))  # the surface is seen askew
    sheet = pixels_per_m * float(laser_sheet(config).sigma_m(np.array([laser_range_m(config)]))[0])
    blur = view.airy_sigma_px
    grain = _GRAIN / _AIRY_SIGMA * blur
    thin2, across2 = blur**2 + sheet**2, grain**2 * (1 + (blur / sheet) ** 2)
    thick2 = thin2 + 1 / 12
    pixel2 = (thick2 / thin2) ** 2 * (2 * thin2 + across2) - 2 * thick2
    return _Line(
        grain_px=float(grain),
        pixel_grain_px=float(np.sqrt(pixel2)),
        pixel_share=float(np.sqrt(across2 / (across2 + 2 * thin2) * (pixel2 + 2 * thick2) / pixel2)),
        seen_m=float(blur * sheet / np.sqrt(thin2) / pixels_per_m),
    )

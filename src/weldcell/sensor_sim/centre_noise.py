"""What the stripe's centre scatters by in a column, from the pictures' own physics: for profiles without pictures.

The centre is measured as `tracking.stripe_centre` does: for a Gaussian stripe A g(v) of width s on a background b, the
root of sum w x I = 0 with x = v - c and w = g / (k + g). To first order it moves by

    dc = sum m dI / D,    m = w x,    D = sum m x I / s^2,

so independent pixels of variance V give sum m^2 V / D^2; speckle of contrast C and correlation rho, whose dI is I times
a factor, gives C^2 sum sum m I m' I' rho / D^2. In electrons V is

    A g + b (photons) + read noise^2 + dark pattern^2 + 1 / (12 gain^2) (rounding) + PRNU^2 (A g + b)^2.

k is the background's variance over that share B of (A g)^2 that would explain the rest; the extractor measures B, here
it follows from the above. The sums depend on the stripe's width and on k alone, and are tabulated.

Speckle is no small disturbance: beyond first order, estimate and window err together. That is taken as a factor
1 + 0.3 C^2 on its deviation, as measured on pictures: within 5 % for contrasts up to 0.6 and widths from 0.8 to 3 px,
15 % at 0.9, where the pictures lose their darkest columns. Left out: those losses, saturation, uneven background, and
what of the stripe lies beyond the picture.

Where the stripe slants, its neighbours see other grains. The speckle's share of dc is the speckle under x g(x), and
with the grain G across the stripe such shares, d apart, correlate as

    -(exp(-d^2 / 2 Q^2))'' Q^2 = (1 - d^2 / Q^2) exp(-d^2 / 2 Q^2),     Q^2 = G^2 + 2 s^2.

That is the mean of cos(a d / Q) over numbers a whose density goes with a^2 exp(-a^2 / 2). So dc is a sum of a few waves
across the stripe, at Gauss's nodes of that density, whose amplitudes are random along it (Shinozuka, Simulation of
multivariate and multidimensional random processes, J. Acoust. Soc. Am. 49, 1971).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import map_coordinates

from weldcell.sensor_sim.chip import CameraChip
from weldcell.sensor_sim.speckle import Speckle, correlated_rows

_WIDTHS_PX = np.geomspace(0.4, 8.0, 31)  # of the tables
_LEAST_K, _MOST_K = np.exp(-(2.7**2) / 2), 1e3  # of a flat window of 2.7 sigma, and of a matched filter
_KS = np.geomspace(_LEAST_K, _MOST_K, 17)
_NARROWEST_WEIGHT_PX = 1.0
_SECOND_ORDER = 0.3
_REACH_PX = 30  # more than 2.7 sigma of the widest
_NODES, _NODE_WEIGHTS = (values[3:] for values in np.polynomial.hermite_e.hermegauss(6))  # the positive half
_WAVES, _WAVE_SHARES = _NODES, np.sqrt(_NODE_WEIGHTS * _NODES**2 / np.sum(_NODE_WEIGHTS * _NODES**2))


@dataclass(frozen=True, kw_only=True)
class CentreSigma:
    """Standard deviations of stripe centres, one for each."""

    noise_px: Float[np.ndarray, "n"]
    """By what is independent from pixel to pixel."""
    speckle_px: Float[np.ndarray, "n"]
    """By speckle, which neighbouring columns share."""

    @property
    def total_px(self) -> Float[np.ndarray, "n"]:
        """By both."""
        return np.hypot(self.noise_px, self.speckle_px)


@dataclass(frozen=True, kw_only=True, eq=False)
class CentreNoise:
    """The scatter of the stripe centres of one sensor."""

    chip: CameraChip
    """The camera's chip."""
    speckle: Speckle
    """The stripe's speckle."""
    dark_variance: float
    """Variance of a dark pixel, in electrons."""
    response_variance: float
    """Variance of the pixels' response."""
    tables_px2: Float[np.ndarray, "4 widths ks"]
    """sum m^2 g^n / D^2 for n = 0, 1, 2, and the speckle's double sum, for a peak of 1."""

    def sigma(
        self,
        amplitude_grey: Float[np.ndarray, "n"],
        sigma_px: Float[np.ndarray, "n"],
        ambient_grey: Float[np.ndarray, "n"],
        contrast: Float[np.ndarray, "n"] | None = None,
    ) -> CentreSigma:
        """Standard deviations of the centres of stripes of this peak and width on this background.

        Light is in levels of 255 at 1 ms and 0 dB. `contrast` is the speckle's own unless given for each.
        """
        peak, background = amplitude_grey * self.chip.electrons_per_light, ambient_grey * self.chip.electrons_per_light
        photons, response = float(self.chip.noise), self.response_variance
        contrast2 = (np.full_like(peak, self.speckle.contrast) if contrast is None else contrast) ** 2
        of_background = (self.dark_variance + photons * background + response * background**2) / peak**2
        of_peak = (photons + 2 * response * background) / peak
        _, linear, square, speckled = self._look_up(sigma_px, np.full_like(peak, _LEAST_K))
        own_share = (of_peak * linear + contrast2 * speckled) / square + response
        even, linear, square, speckled = self._look_up(sigma_px, of_background / np.maximum(own_share, 1e-12))
        return CentreSigma(
            noise_px=np.sqrt(of_background * even + of_peak * linear + response * square),
            speckle_px=np.sqrt(contrast2 * speckled) * (1 + _SECOND_ORDER * contrast2),
        )

    def draw_px(
        self,
        columns: Int[np.ndarray, "n"],
        sigma: CentreSigma,
        rng: np.random.Generator,
        centre_px: Float[np.ndarray, "n"] | float = 0.0,
        sigma_px: Float[np.ndarray, "n"] | float = 1.0,
    ) -> Float[np.ndarray, "n"]:
        """Random errors of the centres in these columns; the same `rng` gives the same.

        Speckle is correlated from column to column, the less the further `centre_px` moves meanwhile; `sigma_px` is the
        stripe's width. Where a column has several centres each has its own speckle.
        """
        if len(columns) == 0:
            return np.zeros(0)
        order = np.argsort(columns, kind="stable")
        is_new = np.diff(columns[order], prepend=columns[order[0]] - 1) != 0
        first = np.maximum.accumulate(np.where(is_new, np.arange(len(columns)), 0))
        layer = np.empty(len(columns), np.int64)
        layer[order] = np.arange(len(columns)) - first
        start, layers = int(columns.min()), int(layer.max()) + 1
        rows = correlated_rows((2 * len(_WAVES) * layers, int(columns.max()) - start + 1), self.speckle, rng)
        waves = rows.reshape(2, len(_WAVES), layers, -1)[:, :, layer, columns - start]
        phase = _WAVES[:, None] * centre_px / np.hypot(self.speckle.across_px, np.sqrt(2) * sigma_px)
        shared = _WAVE_SHARES @ (np.cos(phase) * waves[0] + np.sin(phase) * waves[1])
        return sigma.noise_px * rng.standard_normal(len(columns)) + sigma.speckle_px * shared

    def _look_up(self, sigma_px: Float[np.ndarray, "n"], k: Float[np.ndarray, "n"]) -> Float[np.ndarray, "4 n"]:
        """The tables at these widths and k; beyond their ends, there."""
        places = [
            np.log(values / grid[0]) / np.log(grid[1] / grid[0]) for values, grid in ((sigma_px, _WIDTHS_PX), (k, _KS))
        ]
        return np.stack([map_coordinates(table, places, order=1, mode="nearest") for table in self.tables_px2])


def centre_noise(chip: CameraChip, speckle: Speckle) -> CentreNoise:
    """The scatter of stripe centres of a sensor with this chip and speckle."""
    pattern = chip.pattern
    rounding = 1 / 12 / chip.levels_per_electron**2
    dark_pattern = float(pattern.offset_electrons.var()) if pattern else 0.0
    return CentreNoise(
        chip=chip,
        speckle=speckle,
        dark_variance=rounding + dark_pattern + chip.noise * chip.read_noise_electrons**2,
        response_variance=float(pattern.response.var()) if pattern else 0.0,
        tables_px2=_tables(speckle),
    )


def _tables(speckle: Speckle) -> Float[np.ndarray, "4 widths ks"]:
    v = np.arange(-_REACH_PX, _REACH_PX + 1.0)
    widths = _WIDTHS_PX[:, None, None]
    stripe = np.exp(-0.5 * (v / widths) ** 2)
    weight = np.exp(-0.5 * (v / np.maximum(widths, _NARROWEST_WEIGHT_PX)) ** 2)
    moment = v * weight / (_KS[:, None] + weight)
    scale = (widths[..., 0] ** 2 / np.sum(moment * v * stripe, axis=-1)) ** 2
    lever = moment * stripe
    sums = [np.sum(moment**2 * stripe**power, axis=-1) for power in range(3)]
    sums.append(np.sum(lever @ speckle.correlation_across(v[:, None] - v) * lever, axis=-1))
    return np.stack(sums) * scale

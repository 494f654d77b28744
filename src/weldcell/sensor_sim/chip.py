"""The camera chip: from light to the numbers of a picture.

Light comes in levels of 255 (at 1 ms, 0 dB). Each pixel gathers electrons in proportion, its own response being a
little off (PRNU). Photons come at random: here a normal number of Poisson's variance, which lacks its skewness (0.1 at
100 electrons, two levels of light). The well holds only so many, and a share of the rest spills along the column
(blooming). The dark level of each pixel is a little off (DSNU), reading adds noise, and gain makes levels of it,
rounded and clipped to 8 or 12 bits. So well below saturation, with K levels for an electron,

    mean = K (electrons + offset),   variance = K mean + (K read noise)^2 + 1/12

(EMVA Standard 1288, release 4.0, sections 2.2 and 2.4). There is no black level: read noise around 0 is clipped.
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float, Shaped

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.cell.randomness import generator
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.normal_field import fill_normals, normal_field, seed_normals

_TILE_ROWS = 32  # three float32 tiles of 1440 columns stay in a core's level-2 cache


@dataclass(frozen=True, kw_only=True, eq=False)
class FixedPattern:
    """What differs from pixel to pixel, the same in all pictures."""

    response: Float[np.ndarray, "height width"]
    """Response over the mean pixel's (float32)."""
    offset_electrons: Float[np.ndarray, "height width"]
    """Dark level less the mean pixel's (float32)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraChip:
    """A chip with its exposure and gain."""

    bits: int
    """8 or 12."""
    electrons_per_light: float
    """Electrons gathered in one exposure from light of one level of 255."""
    levels_per_electron: float
    """Gain: levels of this chip's pictures for an electron."""
    full_well_electrons: float
    """Charge that a pixel can hold."""
    blooming_ratio: float
    """Share of the charge beyond the full well that spills along the column; the rest is drained."""
    read_noise_electrons: float
    """Standard deviation of the read noise."""
    noise: bool
    """Whether there is photon and read noise."""
    pattern: FixedPattern | None
    """The pixels' differences, if any."""

    def __post_init__(self) -> None:
        for name in ("electrons_per_light", "levels_per_electron", "full_well_electrons"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise BadInput(f"chip: {name} is {getattr(self, name)}, expected a finite number > 0")
        if not (np.isfinite(self.read_noise_electrons) and self.read_noise_electrons >= 0):
            raise BadInput(f"chip: read_noise_electrons is {self.read_noise_electrons}, expected a finite number >= 0")
        if not 0 <= self.blooming_ratio <= 1:
            raise BadInput(f"chip: blooming_ratio is {self.blooming_ratio}, expected 0 to 1")
        if self.bits not in (8, 12):
            raise BadInput(f"chip: bits is {self.bits}, expected 8 or 12")

    @property
    def white_level(self) -> int:
        """The highest level of a picture."""
        return int(2**self.bits - 1)

    @cached_property
    def response(self) -> Float[np.ndarray, "..."]:
        """Electrons for one level of light (float32), for each pixel or for all."""
        mean = np.float32(self.electrons_per_light)
        return np.asarray(mean if self.pattern is None else mean * self.pattern.response)


def camera_chip(config: SensorConfig, seed: int = 0) -> CameraChip:
    """The chip of a sensor; `seed` says which one of its series."""
    levels_per_grey = (2**config.bits - 1) / 255
    spreads = (config.gain_spread_ratio, config.offset_spread_electrons)
    shape = (config.width_px, config.height_px)
    return CameraChip(
        bits=config.bits,
        electrons_per_light=config.electrons_per_grey * config.exposure_ms,
        levels_per_electron=10 ** (config.gain_db / 20) * levels_per_grey / config.electrons_per_grey,
        full_well_electrons=config.full_well_electrons,
        blooming_ratio=config.blooming_ratio,
        read_noise_electrons=config.read_noise_grey * config.electrons_per_grey,
        noise=config.noise,
        pattern=fixed_pattern(*shape, *spreads, seed) if config.noise and any(spreads) else None,
    )


def fixed_pattern(
    width_px: int, height_px: int, gain_spread_ratio: float, offset_spread_electrons: float, seed: int
) -> FixedPattern:
    """Normal differences of response and dark level, independent from pixel to pixel (one sigma each)."""
    rng = generator(seed, "fixed pattern")  # its own numbers, whatever the frames' generators are made from
    response = normal_field((height_px, width_px), rng)
    response *= np.float32(gain_spread_ratio)
    response += 1
    offset_electrons = normal_field((height_px, width_px), rng)
    offset_electrons *= np.float32(offset_spread_electrons)
    return FixedPattern(response=response, offset_electrons=offset_electrons)


def expose(
    ambient_grey: Float[np.ndarray, "height width"], laser: LaserLight, chip: CameraChip, rng: np.random.Generator
) -> Shaped[np.ndarray, "height width"]:
    """The picture of ambient and laser light: uint8, or uint16 up to 4095. The same `rng` gives the same bytes.

    Both lights are in levels of 255 at 1 ms and 0 dB. It goes by strips of rows that stay in the processor's cache.
    """
    if chip.pattern is not None and chip.pattern.response.shape != ambient_grey.shape:
        raise BadInput(f"chip: it has {chip.pattern.response.shape} pixels, the picture {ambient_grey.shape}")
    height, width = ambient_grey.shape
    picture = np.empty((height, width), np.uint8 if chip.bits == 8 else np.uint16)
    charge, sigma, noise = np.empty((3, _TILE_ROWS, width), np.float32)
    bloomed = _bloomed(ambient_grey, laser, chip) if chip.blooming_ratio else None
    if chip.noise:
        seed_normals(rng)
    for first in range(0, height, _TILE_ROWS):
        rows = slice(first, min(first + _TILE_ROWS, height))
        tile = slice(0, rows.stop - first)
        if bloomed is None:
            _gather(ambient_grey, laser, chip, rows, charge[tile])
        else:
            charge[tile] = bloomed[rows]
        _add_noise(charge[tile], chip, sigma[tile], noise[tile])
        if chip.pattern is not None:
            charge[tile] += chip.pattern.offset_electrons[rows]
        _convert(charge[tile], noise[tile], chip, picture[rows])
    return picture


def spilled(
    charge: Float[np.ndarray, "height columns"], full_well: float, blooming_ratio: float
) -> Float[np.ndarray, "height columns"]:
    """Charge (electrons) after that beyond the full well has spilled: half of its share goes up, half goes down.

    What flows down past row i is r_i = max(0, r_(i-1) + spilled_i - room_i), a queue, whose closed form is
    r = S - min(0, running minimum of S) with S the running sum of spilled - room (Lindley, 1952). Charge that flows out
    of the picture is lost.
    """
    kept = np.minimum(charge, full_well)
    half = (charge - kept) * (blooming_ratio / 2)
    for downwards in (slice(None), slice(None, None, -1)):
        excess, held = half[downwards], kept[downwards]
        total = np.cumsum(excess - (full_well - held), axis=0)
        flow = total - np.minimum(np.minimum.accumulate(total, axis=0), 0)
        before = np.vstack([np.zeros_like(flow[:1]), flow[:-1]])
        held += before + excess - flow
    return kept


def _bloomed(
    ambient_grey: Float[np.ndarray, "height width"], laser: LaserLight, chip: CameraChip
) -> Float[np.ndarray, "height width"]:
    """Mean charge (electrons) of the whole picture, spilled."""
    charge = np.empty(ambient_grey.shape, np.float32)
    _gather(ambient_grey, laser, chip, slice(0, len(charge)), charge)
    full = np.flatnonzero(charge.max(axis=0) > chip.full_well_electrons)
    charge[:, full] = spilled(charge[:, full].astype(float), chip.full_well_electrons, chip.blooming_ratio)
    return charge


def _gather(
    ambient_grey: Float[np.ndarray, "height width"],
    laser: LaserLight,
    chip: CameraChip,
    rows: slice,
    charge: Float[np.ndarray, "rows width"],
) -> None:
    """Write the mean charge (electrons) of some rows into `charge`."""
    response = chip.response if chip.response.ndim == 0 else chip.response[rows]
    lit_rows, lit_columns = laser.window
    first, last = max(rows.start, lit_rows.start), min(rows.stop, lit_rows.stop)
    if last <= first:
        np.multiply(ambient_grey[rows], response, out=charge)
        return
    np.copyto(charge, ambient_grey[rows])
    lit = charge[first - rows.start : last - rows.start, lit_columns]
    lit += laser.grey[first - lit_rows.start : last - lit_rows.start]
    charge *= response


def _add_noise(
    charge: Float[np.ndarray, "rows width"],
    chip: CameraChip,
    sigma: Float[np.ndarray, "rows width"],
    noise: Float[np.ndarray, "rows width"],
) -> None:
    """Clip `charge` to the full well, and write what noise adds to it into `noise`; `sigma` is overwritten.

    A full well has no photon noise but is still read with some, so photons are drawn apart where wells fill up; not so
    where the converter clips first.
    """
    full_well = chip.full_well_electrons
    converter_clips_first = full_well * chip.levels_per_electron > chip.white_level + 1
    if not chip.noise:
        cv2.min(charge, full_well, dst=charge)
        noise[:] = 0
    elif converter_clips_first or charge.max() < full_well - 6 * np.sqrt(full_well):
        np.add(charge, np.float32(chip.read_noise_electrons**2), out=sigma)
        _draw(sigma, noise)
    else:
        np.copyto(sigma, charge)
        _draw(sigma, noise)
        cv2.add(charge, noise, dst=charge)
        cv2.min(charge, full_well, dst=charge)
        fill_normals(noise)
        noise *= np.float32(chip.read_noise_electrons)


def _draw(variance: Float[np.ndarray, "rows width"], noise: Float[np.ndarray, "rows width"]) -> None:
    """Write normal numbers of that variance into `noise`; `variance` is left as standard deviations."""
    cv2.sqrt(variance, dst=variance)
    fill_normals(noise)
    noise *= variance


def _convert(
    charge: Float[np.ndarray, "rows width"],
    noise: Float[np.ndarray, "rows width"],
    chip: CameraChip,
    levels: Shaped[np.ndarray, "rows width"],
) -> None:
    """Write the nearest levels (halves to the even one, so no bias) into `levels`, clipped."""
    gain, depth = chip.levels_per_electron, cv2.CV_8U if chip.bits == 8 else cv2.CV_16U
    cv2.addWeighted(charge, gain, noise, gain, 0, dst=levels, dtype=depth)
    if chip.bits != 8:
        cv2.min(levels, chip.white_level, dst=levels)

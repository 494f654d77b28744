"""What a weave in a groove does to the welding current, and how the torch's offset is read from it.

With a torch e to the left of the groove's middle, weaving by s(phi), and walls at half the groove angle h, the contact
tip is cot(h) |e + s(phi)| nearer to the wall than to the middle of the groove. Each harmonic n of that goes through the
arc's answer G(n f), a small linear system (`CurrentResponse`): it is stronger and earlier for fast waves than for slow
ones. For a sine s = A sin(phi) and k = e / A, |k| <= 1, the distance's harmonics are

    first, on sin(phi)       (2 A / pi) (k sqrt(1 - k^2) + asin k)         slope 4/pi at 0, ends at A beyond k = 1
    second, on -cos(2 phi)   (4 A / 3 pi) (1 - k^2)^(3/2)                  only where both walls are met
    mean                     (2 A / pi) (sqrt(1 - k^2) + k asin k)

so the first says how far off the torch is, and the second that there is a groove. They are tabulated here for any weave
from the current that it makes, by the detectors themselves.

Two detectors. "half-periods", the classical one: mean current of the left half-period less that of the right one.
"projection": the amplitude of the first harmonic. Both are shifted by the phase by which the current is ahead. Noise
that is white as a distance, of two-sided density N (m^2/Hz), gives in one weave of T seconds

    projection     sigma = sqrt(2 N / T) tan(h) pi / 4
    half-periods   sigma = sqrt(N / T) tan(h)

if the current followed the distance at once: for a sharp V the signal is a square wave, for which half-periods are the
matched filter and a sine loses 11 %. The arc's answer and its foot take that difference away, and what short circuits
leave behind is slow, which a sine takes in less of: with them the projection is the better one.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Bool, Complex, Float

from weldcell.cell.errors import BadInput
from weldcell.tracking.weaving import Weave

ArcDetector = Literal["projection", "half-periods"]

_PHASES = 512
_OFFSETS = np.linspace(-1.0, 1.0, 81)  # of the amplitude: beyond it the signature says only which wall
_HARMONICS = 4  # fitted: two carry the signal; the others would leak into them where samples are missing


@dataclass(frozen=True, kw_only=True)
class CurrentResponse:
    """How the current answers to the contact tip's distance; found by lifting the torch over a plate."""

    static_a_per_m: float = 4.0e3
    """Fall of the current for each metre of a slow rise."""
    lead_s: float = 0.38
    """Time of the zero: how much more a fast rise counts."""
    settle_s: float = 0.093
    """Time in which the wire's stick-out follows."""
    choke_s: float = 0.0065
    """Time in which the current follows."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and (value > 0 or (value == 0 and name != "static_a_per_m"))):
                raise BadInput(f"arc response: {name} is {value}, expected a positive number")

    def nearer(self, frequency_hz: Float[np.ndarray, "*n"]) -> Complex[np.ndarray, "*n"]:
        """Complex rise of the current for a wave by which the work comes nearer, A/m."""
        s = 2j * np.pi * np.asarray(frequency_hz)
        return self.static_a_per_m * (1 + s * self.lead_s) / ((1 + s * self.settle_s) * (1 + s * self.choke_s))


@dataclass(frozen=True, kw_only=True)
class WaveReading:
    """What one weave's current shows."""

    first_a: float
    """Detector's signal of the lateral offset: positive if the torch is left of the groove's middle."""
    second_a: float
    """Amplitude of the second harmonic as far as it is that of a groove: positive for two walls."""
    mean_a: float
    """Mean current."""


@dataclass(frozen=True, eq=False)
class ArcSignature:
    """The current over a weave in a V-groove, for any lateral offset, as one detector sees it."""

    weave: Weave
    """The weave."""
    groove_angle_rad: float
    """Between the groove's walls."""
    response: CurrentResponse
    """The arc's answer."""
    detector: ArcDetector = "projection"
    """How the offset is read."""

    def read(self, phase_rad: Float[np.ndarray, "n"], current_a: Float[np.ndarray, "n"]) -> WaveReading:
        """The reading of samples of one weave; some may be missing."""
        columns = np.outer(phase_rad, np.arange(1, _HARMONICS + 1))
        design = np.hstack([np.ones((len(phase_rad), 1)), np.cos(columns), np.sin(columns)])
        found = np.linalg.lstsq(design, current_a, rcond=None)[0]
        harmonics_a = found[1 : _HARMONICS + 1] - 1j * found[_HARMONICS + 1 :]  # cosine less i times sine
        if self.detector == "half-periods":
            left = np.sin(phase_rad + self.lead_rad) > 0
            first_a = _mean(current_a[left]) - _mean(current_a[~left])
        else:
            first_a = float((1j * harmonics_a[0] * np.exp(-1j * self.lead_rad)).real)
        second_a = float(-(harmonics_a[1] * np.exp(-1j * np.angle(self._answers[1]))).real)
        return WaveReading(first_a=first_a, second_a=second_a, mean_a=float(found[0]))

    def lateral_m(self, first_a: float) -> float:
        """How far left of the groove's middle the torch is, no more than the weave's amplitude."""
        first, _, _ = self._tables
        return float(np.interp(first_a, first, _OFFSETS)) * self.weave.amplitude_m

    def second_a(self, lateral_m: float) -> float:
        """The second harmonic that a groove gives at this offset."""
        return self._of_offset(1, lateral_m)

    def mean_a(self, lateral_m: float) -> float:
        """How much the mean current is above that in the groove's bottom."""
        return self._of_offset(2, lateral_m)

    @cached_property
    def lead_rad(self) -> float:
        """By how much the current's first harmonic is ahead of the weave."""
        return float(np.angle(self._answers[0]))

    @cached_property
    def first_a_per_m(self) -> float:
        """Slope of the detector's signal at the groove's middle."""
        first, _, _ = self._tables
        middle = len(_OFFSETS) // 2
        return float(first[middle + 1] - first[middle - 1]) / float(2 * _OFFSETS[middle + 1] * self.weave.amplitude_m)

    @cached_property
    def _answers(self) -> Complex[np.ndarray, "k"]:
        """The current's answer to the first two harmonics."""
        return self.response.nearer(self.weave.frequency_hz * np.array([1, 2]))

    @cached_property
    def _tables(self) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
        """Detector's signal (rising), second harmonic and mean at the tabulated offsets."""
        phase_rad = _phases()
        waves = [self.read(phase_rad, self._wave_a(offset * self.weave.amplitude_m)) for offset in _OFFSETS]
        first, second, mean = (np.array([getattr(wave, f"{name}_a") for wave in waves]) for name in _READ)
        return np.maximum.accumulate(first), second, mean

    def _wave_a(self, lateral_m: float) -> Float[np.ndarray, "n"]:
        """The current above that in the groove's bottom, over evenly spaced phases of one weave."""
        offset_m = lateral_m + self.weave.lateral_at_phase_m(_phases())
        nearer_m = np.abs(offset_m) / np.tan(self.groove_angle_rad / 2)
        answer = self.response.nearer(self.weave.frequency_hz * np.arange(_PHASES // 2 + 1))
        return np.fft.irfft(np.fft.rfft(nearer_m) * answer, _PHASES)

    def _of_offset(self, table: int, lateral_m: float) -> float:
        return float(np.interp(lateral_m / self.weave.amplitude_m, _OFFSETS, self._tables[table]))


_READ = ("first", "second", "mean")


def _phases() -> Float[np.ndarray, "n"]:
    return 2 * np.pi * (np.arange(_PHASES) + 0.5) / _PHASES


def _mean(values: Float[np.ndarray, "n"]) -> float:
    return float(values.mean()) if len(values) else np.nan


def quiet_samples(
    time_s: Float[np.ndarray, "n"],
    current_a: Float[np.ndarray, "n"],
    usual_a: float,
    hold_s: float,
    ratios: tuple[float, float],
) -> Bool[np.ndarray, "n"]:
    """Which samples are of a calm arc: within these ratios of the usual current, and not just after one that is not."""
    wild = (current_a < ratios[0] * usual_a) | (current_a > ratios[1] * usual_a)
    since_s = time_s - np.maximum.accumulate(np.where(wild, time_s, -np.inf))
    return since_s > hold_s

"""Seam tracking by the welding current of a weaving torch: no other sensor, no look-ahead, no error of mounting.

Each weave gives one reading of the lateral offset (`arc_signature` says how) and one of the height (`arc_height`), and
each reading moves the torch's path (`arc_correction`). The first weaves only look; what they agree on is then taken
back at once.

What to expect, for unrest of the arc's length of sigma l and correlation time c, read over a weave of T: two-sided
density N = 2 l^2 c, so l = 1 mm, c = 4 ms, T = 0.5 s and a 60 degree V give s = sqrt(2 N / T) tan(30 deg) pi / 4 =
0.08 mm for the projection, and a path of 0.71 s = 0.06 mm. Drops and short circuits come on top: the wire grows while
a drop bridges the arc, and the current takes 0.1 s to forget it.

Only a groove whose both walls are met within the weave can be followed. `score` compares the second harmonic with that
of a groove at that offset: 1 for a V, 0 for a plate or a butt joint, little for a lap. Below a half there is nothing
to follow: the correction is held and the state says so.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadInput
from weldcell.tracking.arc_correction import ArcCorrection, ArcGains
from weldcell.tracking.arc_height import ArcHeight
from weldcell.tracking.arc_signature import (
    ArcDetector,
    ArcSignature,
    CurrentResponse,
    WaveReading,
    quiet_samples,
)
from weldcell.tracking.weaving import Weave

ArcTrackState = Literal["learning", "tracking", "coasting", "lost", "not-observable"]

_LEAST_SCORE = 0.5
_START: tuple[ArcTrackState, str] = ("learning", "the first weaves are looked at")
_NEAR_MIDDLE = 0.5  # of the amplitude
_SCORE_SHARE = 0.3  # of the newest weave in the score
_SCATTER_WEAVES = 40  # that the readings' scatter is taken over
_SCALES = np.geomspace(0.4, 2.5, 74)  # of the slope, where it is identified: 2.5 % apart
_SIGMA_OF_MEDIAN = 1.4826  # of normal numbers
_FEWEST_SAMPLES = 32  # for the nine numbers of the fit
_WIDEST_GAP_RAD = 1.0  # in a weave that is read: a third of a half-period


@dataclass(frozen=True, kw_only=True)
class ThroughArcSettings:
    """What is known of weave, groove and arc, and how fast the path follows."""

    weave: Weave
    """The weave, as the torch is made to move."""
    groove_angle_rad: float = np.pi / 3
    """Between the groove's walls."""
    response: CurrentResponse = field(default_factory=CurrentResponse)
    """The current over the contact tip's distance."""
    identify_slope: bool = False
    """Scale the response to what weaves near the groove's middle show; it must be right to a factor of two."""
    detector: ArcDetector = "projection"
    """How a weave is read."""
    gains: ArcGains = field(default_factory=ArcGains)
    """How fast the path follows."""
    learning_weaves: int = 4
    """Weaves without corrections, in which the score and the first offset are found."""
    reference_a: float | None = None
    """Mean current at the wanted height with the torch in the groove's middle; None: it is learned."""
    reference_weaves: int = 8
    """Weaves near the groove's middle to learn the reference (until then the height is left alone) and slope from."""
    calm_ratios: tuple[float, float] = (0.6, 1.5)
    """Samples outside these multiples of the usual current are no arc's or a short circuit's."""
    hold_s: float = 0.0065
    """So long after such a sample the current is not used: the choke's time."""
    least_calm_ratio: float = 0.5
    """Weaves with a smaller share of calm samples are not read."""
    patience_weaves: int = 6
    """Weaves in a row without a reading after which the seam is lost."""

    def __post_init__(self) -> None:
        if self.weave.shape == "none":
            raise BadInput("through-arc tracking: found no weave, expected a sine or triangle")
        if not 0 < self.groove_angle_rad < np.pi:
            raise BadInput(f"through-arc tracking: groove_angle_rad is {self.groove_angle_rad}, expected 0 to pi")
        for name in ("learning_weaves", "reference_weaves"):
            if getattr(self, name) < 1:
                raise BadInput(f"through-arc tracking: {name} is {getattr(self, name)}, expected 1 or more")


@dataclass(frozen=True, kw_only=True)
class ArcReading:
    """What one weave said."""

    time_s: float
    """Its end."""
    lateral_m: float
    """The torch's offset from the groove's middle, left positive; NaN if the weave was not read."""
    lateral_sigma_m: float
    """Its sigma by the readings' own scatter; inf for the first two."""
    height_m: float
    """How much too high the torch is; NaN while the reference is learned or if the weave was not read."""
    height_sigma_m: float
    """Its sigma in the same way: the reference's error and the arc's slow wander are not in it."""
    calm_ratio: float
    """Share of samples of a calm arc."""
    score: float
    """How much the weaves so far look like those in a groove: 1, or 0 for a plate."""
    state: ArcTrackState
    """The tracker's state after this weave."""
    reason: str
    """Why it does not track; empty if it does."""


class ThroughArcTracker:
    """Follows a groove by weave after weave of current; `feed` changes it."""

    def __init__(self, settings: ThroughArcSettings) -> None:
        self.settings = settings
        self.signature = ArcSignature(settings.weave, settings.groove_angle_rad, settings.response, settings.detector)
        self.state, self.reason = _START
        self.scale = 1.0
        self._path = ArcCorrection(settings.gains, settings.weave.amplitude_m)
        self._score = 0.0
        self._places_m: deque[tuple[float, float]] = deque(maxlen=_SCATTER_WEAVES)
        self._height = ArcHeight(self.signature, settings.reference_a, settings.reference_weaves)
        self._usual_a: float | None = None
        self._previous_mean_a: float | None = None
        self._learned: list[WaveReading] = []
        self._near_middle: list[WaveReading] = []
        self._missed = 0
        self._ever_tracked = False
        self._samples = np.empty((0, 3))

    def correction(self) -> tuple[float, float]:
        """Where to move the torch's path: to the left, and up (both m), from where it was planned."""
        return self._path.lateral_m, self._path.vertical_m

    def correction_sigma(self) -> tuple[float, float]:
        """Sigma of both corrections once the path has settled, by the readings' scatter; inf before it is known."""
        gains, (lateral_m, height_m) = self.settings.gains, self._sigmas_m()
        return gains.lateral_noise_ratio() * lateral_m, gains.vertical_noise_ratio() * height_m

    def feed(
        self, time_s: Float[np.ndarray, "n"], phase_rad: Float[np.ndarray, "n"], current_a: Float[np.ndarray, "n"]
    ) -> list[ArcReading]:
        """Readings of the weaves that these samples complete, mostly none; the corrections are changed by them.

        Samples come in order of time; the phase is `Weave.phase_rad`, growing without end.
        """
        fresh = np.column_stack([np.atleast_1d(values) for values in (time_s, phase_rad, current_a)])
        if not np.all(np.isfinite(fresh)):
            raise BadInput("through-arc tracking: found NaN or infinity among times, phases and currents")
        self._samples = np.vstack([self._samples, fresh])
        weave = np.floor(self._samples[:, 1] / (2 * np.pi))
        whole = np.unique(weave[weave < _weave_to_come(self._samples[:, 1])])
        readings = [self._read(*self._samples[weave == number].T) for number in whole]
        self._samples = self._samples[~np.isin(weave, whole)]
        return readings

    def _read(
        self, time_s: Float[np.ndarray, "n"], phase_rad: Float[np.ndarray, "n"], current_a: Float[np.ndarray, "n"]
    ) -> ArcReading:
        """One whole weave."""
        settings = self.settings
        usual_a = float(np.median(current_a)) if self._usual_a is None else self._usual_a
        calm = quiet_samples(time_s, current_a, usual_a, settings.hold_s, settings.calm_ratios) & (usual_a > 0)
        calm_ratio, end_s = float(calm.mean()), float(time_s[-1])
        readable = calm.sum() >= _FEWEST_SAMPLES and calm_ratio >= settings.least_calm_ratio
        phase_rad = np.mod(phase_rad[calm], 2 * np.pi)
        if not readable or np.diff(phase_rad, prepend=0.0, append=2 * np.pi).max() > _WIDEST_GAP_RAD:
            return self._missed_weave(end_s, calm_ratio)
        self._missed, self._usual_a = 0, float(np.median(current_a[calm]))
        wave = self.signature.read(phase_rad, self._without_trend(phase_rad, current_a[calm]))
        lateral_m = self.signature.lateral_m(wave.first_a / self.scale)
        self._judge(wave, lateral_m)
        height_m = self._height.height_m(wave, lateral_m, self.scale)
        self._places_m.append((self._path.lateral_m - lateral_m, self._path.vertical_m - height_m))
        if len(self._learned) < settings.learning_weaves:
            self._learn(wave)
        else:
            self._follow(wave, lateral_m, height_m)
        return self._reading(end_s, lateral_m, height_m, calm_ratio)

    def _without_trend(
        self, phase_rad: Float[np.ndarray, "n"], current_a: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """The currents less a slow rise or fall, which would look like an offset: 1/pi of it in the first harmonic.

        Its slope is that of the mean from the weave before: a slope fitted to the weave itself would take 60 % of the
        first harmonic's information with it, since a sine and a line are alike.
        """
        mean_a = float(current_a.mean())
        rise_a = 0.0 if self._previous_mean_a is None else mean_a - self._previous_mean_a
        self._previous_mean_a = mean_a
        return current_a - rise_a * (phase_rad / (2 * np.pi) - 0.5)

    def _judge(self, wave: WaveReading, lateral_m: float) -> None:
        """Brings the score up to date."""
        scale, signature = self.scale, self.signature
        fresh = 1 + (wave.second_a / scale - signature.second_a(lateral_m)) / signature.second_a(0.0)
        share = max(_SCORE_SHARE, 1 / (len(self._learned) + 1))
        self._score += share * (fresh - self._score)

    def _learn(self, wave: WaveReading) -> None:
        """After enough weaves: whether there is a groove, and the first step to the seam."""
        self._learned.append(wave)
        if len(self._learned) < self.settings.learning_weaves:
            self.state, self.reason = _START
            return
        self._settle()
        if self.state == "tracking":
            first_a = float(np.mean([learned.first_a for learned in self._learned]))
            self._previous_mean_a = None  # the mean's step by this move is no trend
            if not self._path.start(self.signature.lateral_m(first_a / self.scale)):
                self._beyond()

    def _identify(self, wave: WaveReading) -> None:
        """How much stronger the current's answer is than was said: where first and second harmonic fit a groove.

        From weaves near the groove's middle: at its walls there is no second harmonic to go by.
        """
        self._near_middle.append(wave)
        if len(self._near_middle) != self.settings.reference_weaves:
            return
        first_a, second_a = np.mean([[near.first_a, near.second_a] for near in self._near_middle], axis=0).tolist()
        signature = self.signature
        misfit_a = [second_a / scale - signature.second_a(signature.lateral_m(first_a / scale)) for scale in _SCALES]
        self.scale = float(_SCALES[np.argmin(np.abs(misfit_a))])

    def _follow(self, wave: WaveReading, lateral_m: float, height_m: float) -> None:
        """Moves the path by a reading, unless there is nothing to follow."""
        self._settle()
        if self.state != "tracking":
            self._path.hold()
            return
        if abs(lateral_m) < _NEAR_MIDDLE * self.settings.weave.amplitude_m:
            self._height.learn(wave, lateral_m, self.scale)
            if self.settings.identify_slope:
                self._identify(wave)
        if not self._path.follow(lateral_m, height_m):
            self._beyond()

    def _settle(self) -> None:
        """Tracking if the weaves look like those in a groove."""
        if self._score >= _LEAST_SCORE:
            self.state, self.reason, self._ever_tracked = "tracking", "", True
            return
        self.state = "lost" if self._ever_tracked else "not-observable"
        self.reason = f"the current does not show the two walls of a groove (score {self._score:.2f})"

    def _missed_weave(self, end_s: float, calm_ratio: float) -> ArcReading:
        """Goes on with the drift that was learned, for a while."""
        self._missed += 1
        self._previous_mean_a = None
        if self._missed > self.settings.patience_weaves:
            self._path.hold()
            self._usual_a = None  # an arc that burns anew may burn otherwise
            self.state, self.reason = "lost", f"no calm arc for {self._missed} weaves"
        elif self.state in ("tracking", "coasting"):
            self.state, self.reason = "coasting", f"only {100 * calm_ratio:.0f} % of the weave is of a calm arc"
            if not self._path.coast():
                self._beyond()
        return self._reading(end_s, np.nan, np.nan, calm_ratio)

    def _beyond(self) -> None:
        self.state, self.reason = "lost", f"the correction would exceed {1e3 * self.settings.gains.limit_m:g} mm"

    def _reading(self, time_s: float, lateral_m: float, height_m: float, calm_ratio: float) -> ArcReading:
        lateral_sigma_m, height_sigma_m = self._sigmas_m()
        return ArcReading(
            time_s=time_s,
            lateral_m=lateral_m,
            lateral_sigma_m=lateral_sigma_m,
            height_m=height_m,
            height_sigma_m=height_sigma_m,
            calm_ratio=calm_ratio,
            score=self._score,
            state=self.state,
            reason=self.reason,
        )

    def _sigmas_m(self) -> tuple[float, float]:
        """Sigma of one weave's lateral and height readings, by the scatter of the seam's place that they give.

        Second differences leave out the seam's own course; of white noise their variance is six times its own. The
        median leaves out the start.
        """
        places_m = np.array(self._places_m).reshape(-1, 2)
        sigmas_m = [_scatter_m(place_m[np.isfinite(place_m)]) for place_m in places_m.T]
        return sigmas_m[0], sigmas_m[1]


def _scatter_m(place_m: Float[np.ndarray, "n"]) -> float:
    if len(place_m) < 3:
        return np.inf
    return float(np.median(np.abs(np.diff(place_m, n=2))) * _SIGMA_OF_MEDIAN / np.sqrt(6))


def _weave_to_come(phase_rad: Float[np.ndarray, "n"]) -> float:
    """Number of the weave that the next sample will be of, so that no weave waits for it."""
    if len(phase_rad) < 2:
        return -np.inf
    return float(np.floor((phase_rad[-1] + (phase_rad[-1] - phase_rad[-2]) * (1 + 1e-6)) / (2 * np.pi)))

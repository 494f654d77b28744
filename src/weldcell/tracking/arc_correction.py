"""How readings of a weaving torch move its path: integrating control, and the seam's drift learned on top.

Lateral, left of travel positive: with e the torch's offset from the groove's middle and u the path's correction,

    v <- v - b e,     u <- u - a e + v          (a: lateral_gain, b: lateral_drift_gain)

With b = 0 that is integrating control: after a start off the seam the offset falls by (1 - a) a weave, and on a seam
that runs off by d a weave it stays d / a behind (10 mm/s, 3 degrees, 2 Hz: 0.26 mm a weave, so 0.52 mm for a = 0.5).
With b > 0 the drift is learned and nothing stays. It is an alpha-beta filter of the seam's place, so readings of sigma
s leave (P. R. Kalata, The tracking index, IEEE Trans. AES 20, 1984; variance of the one-step prediction)

    sigma_u^2 = s^2 (2 a^2 + a b + 2 b) / (a (4 - 2 a - b)),   s^2 a / (2 - a) for b = 0.

The default pair is critically damped: a = 1 - r^2, b = (1 - r)^2 with r = 0.7; it leaves 0.71 s. The height has a gain
alone: up (out of the joint, along -z of the torch) is positive.
"""

from dataclasses import dataclass

import numpy as np

from weldcell.cell.errors import BadInput


@dataclass(frozen=True, kw_only=True)
class ArcGains:
    """How fast the path follows."""

    lateral: float = 0.51
    """Share of a reading by which the path is moved."""
    lateral_drift: float = 0.09
    """Share of a reading by which the path's drift for each weave is changed; 0: integrating control."""
    vertical: float = 0.1
    """Share of a height reading by which the path is moved; 0: the height is left alone."""
    limit_m: float = 0.02
    """Largest correction."""

    def __post_init__(self) -> None:
        if not (0 < self.lateral < 2 and 0 <= self.lateral_drift < 4 - 2 * self.lateral):
            found = f"{self.lateral}, {self.lateral_drift}"
            raise BadInput(f"through-arc tracking: lateral gains {found} are not stable; expected a < 2, b < 4 - 2 a")
        if not 0 <= self.vertical < 2:
            raise BadInput(f"through-arc tracking: vertical gain is {self.vertical}, expected 0 or more and below 2")
        if not self.limit_m > 0:
            raise BadInput(f"through-arc tracking: limit_m is {self.limit_m}, expected a positive number")

    def lateral_noise_ratio(self) -> float:
        """Sigma of the settled path over that of a reading."""
        a, b = self.lateral, self.lateral_drift
        return float(np.sqrt((2 * a * a + a * b + 2 * b) / (a * (4 - 2 * a - b))))

    def vertical_noise_ratio(self) -> float:
        """The same for the height."""
        return float(np.sqrt(self.vertical / (2 - self.vertical)))


class ArcCorrection:
    """The path's correction; its methods change it."""

    def __init__(self, gains: ArcGains, most_drift_m: float) -> None:
        """`most_drift_m`: the largest drift of the seam in one weave that is believed."""
        self._gains, self._most_drift_m = gains, most_drift_m
        self._drift_m = 0.0
        self.lateral_m = 0.0
        self.vertical_m = 0.0

    def follow(self, lateral_m: float, height_m: float) -> bool:
        """Moves against a reading; no further than the limit, and False if it would have to. No height: NaN."""
        drift_m = self._drift_m - self._gains.lateral_drift * lateral_m
        self._drift_m = float(np.clip(drift_m, -self._most_drift_m, self._most_drift_m))
        rise_m = -self._gains.vertical * height_m if np.isfinite(height_m) else 0.0
        return self._move(self._drift_m - self._gains.lateral * lateral_m, rise_m)

    def start(self, lateral_m: float) -> bool:
        """Takes back a whole offset that several readings agree on; False at the limit."""
        return self._move(-lateral_m, 0.0)

    def coast(self) -> bool:
        """Goes on with the drift alone; False at the limit."""
        return self._move(self._drift_m, 0.0)

    def hold(self) -> None:
        """Stands still and forgets the drift."""
        self._drift_m = 0.0

    def _move(self, left_m: float, up_m: float) -> bool:
        limit_m = self._gains.limit_m
        asked_m = np.array([self.lateral_m + left_m, self.vertical_m + up_m])
        self.lateral_m, self.vertical_m = np.clip(asked_m, -limit_m, limit_m).tolist()
        within = bool(np.abs(asked_m).max() <= limit_m)
        if not within:
            self.hold()
        return within

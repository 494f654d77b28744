"""The torch's height by a weave's mean current, against a reference that is given or learned.

The mean current falls by the static slope for each metre of height, and rises with the offset, which brings one wall
near: that part is taken off by the signature. The slow slope is weak (2 % a millimetre), and the arc's slow wander and
short circuits count in full, so a reading is good to some 0.5 mm only. The reference is learned from weaves near the
groove's middle, since far off it the offset is not known well; then it is their height that is held.
"""

import numpy as np

from weldcell.tracking.arc_signature import ArcSignature, WaveReading


class ArcHeight:
    """Reads the height; `learn` changes it."""

    def __init__(self, signature: ArcSignature, reference_a: float | None, weaves: int) -> None:
        """`reference_a`: mean current at the wanted height in the groove's middle; None: learned from `weaves`."""
        self._signature, self._weaves = signature, weaves
        self._reference_a = reference_a
        self._means_a: list[float] = []

    def height_m(self, wave: WaveReading, lateral_m: float, scale: float) -> float:
        """How much too high the torch is at this offset; NaN without a reference. `scale`: of the arc's answer."""
        if self._reference_a is None:
            return np.nan
        missing_a = self._reference_a - self._in_middle_a(wave, lateral_m, scale)
        return missing_a / (scale * self._signature.response.static_a_per_m)

    def learn(self, wave: WaveReading, lateral_m: float, scale: float) -> None:
        """Takes a weave near the groove's middle into the reference, while that is wanted."""
        if self._reference_a is not None:
            return
        self._means_a.append(self._in_middle_a(wave, lateral_m, scale))
        if len(self._means_a) == self._weaves:
            self._reference_a = float(np.mean(self._means_a))

    def _in_middle_a(self, wave: WaveReading, lateral_m: float, scale: float) -> float:
        """What the mean current would be with the torch in the groove's middle."""
        return wave.mean_a - scale * (self._signature.mean_a(lateral_m) - self._signature.mean_a(0.0))

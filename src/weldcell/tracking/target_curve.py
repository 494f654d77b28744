"""The seam just ahead of the torch, kept between two frames: reading it off costs a tenth of working it out."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_BEHIND_M, _AHEAD_M, _NODES = 1e-3, 11e-3, 13
_SPAN_S = 0.25

Curve = Callable[
    [Float[np.ndarray, "m"], Float[np.ndarray, "m"]], tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m"]]
]


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetCurve:
    """Deviations of the seam on a stretch of the path and a span of time, linear in between."""

    from_m: float
    """Arc length of the first node."""
    from_s: float
    """First time since the arc was lit."""
    values_m: Float[np.ndarray, "2 k 3"]
    """At both times and all nodes: lateral and vertical deviation, and the sigma of either."""

    def covers(self, arc_length_m: float, arc_s: float) -> bool:
        """Whether a place and a time are on it."""
        on = self.from_m <= arc_length_m <= self.from_m + _BEHIND_M + _AHEAD_M
        return on and self.from_s <= arc_s <= self.from_s + _SPAN_S

    def at(self, arc_length_m: float, arc_s: float) -> tuple[float, float, float]:
        """Lateral and vertical deviation and their sigma (m). A node every millimetre: straight lines are 1 um off."""
        node = (arc_length_m - self.from_m) / (_BEHIND_M + _AHEAD_M) * (_NODES - 1)
        first = min(int(node), _NODES - 2)
        along, later = node - first, (arc_s - self.from_s) / _SPAN_S
        rows = self.values_m[:, first] * (1 - along) + self.values_m[:, first + 1] * along
        lateral, vertical, sigma = rows[0] * (1 - later) + rows[1] * later
        return float(lateral), float(vertical), float(sigma)


def target_curve(curve: Curve, arc_length_m: float, arc_s: float) -> TargetCurve:
    """The stretch ahead of this place, from this time on."""
    nodes = np.linspace(arc_length_m - _BEHIND_M, arc_length_m + _AHEAD_M, _NODES)
    times_s = np.repeat([arc_s, arc_s + _SPAN_S], _NODES)
    values_m = np.column_stack(curve(np.tile(nodes, 2), times_s)).reshape(2, _NODES, 3)
    return TargetCurve(from_m=float(nodes[0]), from_s=arc_s, values_m=values_m)

"""How a part drifts while it is welded: a smooth function of the time since the arc was lit, with its prior.

Heat lets a part creep in a direction that nobody knows, starting when the arc is lit. Two things are known of it.

*Modes.* Heat spreads by conduction, whose solutions are sums of modes that settle exponentially (Carslaw and Jaeger
1959, Conduction of Heat in Solids, chapter 3), and what expands with it does the same: d(t) = sum D_k
(1 - exp(-t / T_k)), here with four time constants an octave apart, and D t for all that settle later. Each D is
normal with the standard deviation `size_m` (D t: `size_m` within half the longest constant).

*Wandering.* What is left is a rate that keeps a standard deviation r and forgets itself over a time T (the process of
Uhlenbeck and Ornstein 1930, Physical Review 36, 823, whose integral is their displacement of a particle):

    cov(rate(t), rate(t')) = r^2 exp(-|t - t'| / T),        var d(t) = 2 r^2 T (t - T (1 - exp(-t / T))).

Between two knots a time h apart, with e = exp(-h / T), the state (d, rate) goes over by F = [1 T (1 - e); 0 e] and
gains a normal pair of covariance r^2 [T^2 (2 h / T - 3 + 4 e - e^2)  T (1 - e)^2; T (1 - e)^2  1 - e^2]. In between,
given the states at both knots, the mean is close to the cubic with these values and slopes (exactly so for T without
end: Wahba 1990, Spline Models for Observational Data, chapter 1). What this leaves out is the variance between knots,
(2 r^2 / T) h^3 / 192: 5 um at the defaults.

So d(t) is linear in standard normal numbers, and a later interval changes nothing before it: the basis can grow while
it is in use. The modes come first because a seam that bends shows only what of the drift goes across it where the
light is. What goes along it is invisible there and yet counts where the torch is, a look-ahead behind, on another
heading; only a drift that was the same kind of motion all the time can be known from what was seen of it before.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

_OCTAVES = 4
_LATER = 0.5
_HARDLY, _ALONE = 0.05, 1.5  # of a mode's prior sigma, where a hypothesis has another one, or this one only
_CALM = 0.3  # of the wandering's, where nothing drifts


@dataclass(frozen=True, kw_only=True)
class DriftBasis:
    """One coordinate of the drift as a linear function of standard normal numbers."""

    size_m: float
    """Prior standard deviation of each mode."""
    shortest_s: float
    """Shortest time constant of the modes."""
    wander_m_s: float
    """Prior standard deviation of the wandering rate."""
    memory_s: float
    """Time over which that rate stays alike."""
    knot_s: float
    """Time between two knots of the wandering."""
    intervals: int = 1

    @property
    def count(self) -> int:
        """How many numbers describe the drift of one coordinate."""
        return _OCTAVES + 1 + 1 + 2 * self.intervals

    def precisions(self) -> Float[np.ndarray, "h k"]:
        """For each hypothesis on what drifts the prior precision of each number: nothing, one mode, all of them."""
        scales = np.ones((_OCTAVES + 3, self.count))
        modes = scales[:, : _OCTAVES + 1]
        modes[:-1] = _HARDLY
        modes[1:-1][np.diag_indices(_OCTAVES + 1)] = _ALONE
        scales[0, _OCTAVES + 1 :] = _CALM
        return scales**-2

    def reaching(self, arc_s: float) -> "DriftBasis":
        """This basis, or one with more intervals whose knots reach this time; its first numbers mean the same."""
        intervals = int(np.ceil(arc_s / self.knot_s))
        return replace(self, intervals=intervals) if intervals > self.intervals else self

    def at(self, arc_s: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m k"]:
        """What each number adds to the drift at these times since the arc was lit (m); nothing before that."""
        time_s = np.maximum(arc_s, 0.0)[:, None]
        modes = -np.expm1(-time_s / self._constants_s)
        steady = time_s / (_LATER * self._constants_s[-1])
        return np.hstack([self.size_m * modes, self.size_m * steady, self._wandering(time_s)])

    def _wandering(self, time_s: Float[np.ndarray, "m 1"]) -> Float[np.ndarray, "m j"]:
        knots = time_s[:, 0] / self.knot_s
        interval = np.minimum(knots.astype(int), self.intervals - 1)
        x = (knots - interval)[:, None]
        first, last = self._states[interval], self._states[interval + 1]
        square, cube = x * x, x * x * x
        return (
            (1 - 3 * square + 2 * cube) * first[:, 0]
            + (3 * square - 2 * cube) * last[:, 0]
            + (x - 2 * square + cube) * self.knot_s * first[:, 1]
            + (cube - square) * self.knot_s * last[:, 1]
        )

    @cached_property
    def _constants_s(self) -> Float[np.ndarray, "o"]:
        return self.shortest_s * 2.0 ** np.arange(_OCTAVES)

    @cached_property
    def _states(self) -> Float[np.ndarray, "knots 2 j"]:
        """Value and rate of the wandering at each knot, by its standard normal numbers."""
        memory, left = self.memory_s, np.exp(-self.knot_s / self.memory_s)
        onwards = np.array([[1.0, memory * (1 - left)], [0.0, left]])
        place = memory**2 * (2 * self.knot_s / memory - 3 + 4 * left - left**2)
        both = memory * (1 - left) ** 2
        gained = self.wander_m_s * np.linalg.cholesky(np.array([[place, both], [both, 1 - left**2]]))
        states = np.zeros((self.intervals + 1, 2, 1 + 2 * self.intervals))
        states[0, 1, 0] = self.wander_m_s
        for knot in range(self.intervals):
            states[knot + 1] = onwards @ states[knot]
            states[knot + 1, :, 1 + 2 * knot : 3 + 2 * knot] = gained
        return states

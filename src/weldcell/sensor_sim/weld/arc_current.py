"""The welding current of a gas metal arc on a constant-voltage source, over the contact tip's distance to the work.

The wire leaves the contact tip, sticks out by L, and the arc of length l bridges the rest of the distance: H = L + l.
It melts as fast as Lesnewich's law says and is fed at a constant rate w, and the circuit's voltages add up:

    dL/dt       = w - k1 I - k2 L I^2
    Lw dI/dt    = U0 - Rs I - (a + b I + E l) - r L I

So a sudden change of H first changes the arc's length, which moves the current a lot; then the stick-out follows, the
arc's length recovers ("self-regulation"), and what stays is smaller. Linear about an equilibrium, with
p = k1 + 2 k2 L I, q = k2 I^2 and R = Rs + b + r L:

    dI / dH = -E (s + q) / ((Lw s + R) (s + q) + (E - r I) p) = -g (1 + s t_lead) / ((1 + s t_settle) (1 + s t_choke))

The defaults (230 A, 26 V, H = 18 mm) give g = 4.0 A/mm for slow changes, 12.6 A/mm and 24 degrees of lead at 2 Hz, and
15.2 A/mm, the most, at 6 Hz; measured and calculated for such arcs, the current is most sensitive at some 5 Hz (Ushio
and Mao, Sensitivity characteristics of arc sensor in GMA welding, Science and Technology of Welding and Joining 2,
1997). With an arc of constant length, g would be k2 I^2 / p = 4.2 A/mm, 2 % of the current a millimetre: the wire's law
bounds the slow slope, whatever the source. A shorter stick-out raises it (5.6 A/mm at H = 12 mm).

Constants, for mild steel wire of 1.2 mm in argon with some CO2: k1 = 0.3 mm/(A s), k2 = 5e-5 /(A^2 s) (J. Norrish,
Advanced Welding Processes, burn-off of 1.2 mm plain carbon steel); a = 15.7 V, b = 0.024 ohm, Lw = 0.3 mH (D. S. Naidu,
S. Ozcelik and K. L. Moore, Modeling, Sensing and Control of Gas Metal Arc Welding, 2003; their E is 0.4 V/mm in argon,
CO2 raises it: 0.75 V/mm chosen); r = 0.7 ohm/m is hot steel of 0.8 micro-ohm m.

Noise is a voltage, so that the circuit shapes it as it shapes the signal. Levels are chosen, to be usual: drops grow
and fall and the pool heaves (1 mm of arc length, 4 ms; drops at about 80 Hz); now and then a drop bridges the arc for
some ms (as often as the arc's light drops out); the wire's contact in the tip wanders slowly (0.15 mm). This makes the
distance uncertain by some 0.2 mm over a half-second, as it is in practice (0.25 mm: J. N. Pires, A. Loureiro and G.
Bolmsjo, Welding Robots, 2006). The source's regulation is that of its slope and choke; pulsed sources are not modelled.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float
from scipy.optimize import brentq

from weldcell.cell.errors import BadGeometry

_STEP_S = 5e-4  # a tenth of the choke's time: the current's decay within a step is exact, the wire's creep 50 um
_SHORTEST_M = 1e-3  # of a stick-out: the wire burns back to the contact tip no further


@dataclass(frozen=True, kw_only=True)
class ArcNoise:
    """What makes the current restless."""

    length_m: float = 1e-3
    """Fast unrest of the arc's length (one sigma): drops and pool."""
    length_s: float = 4e-3
    """Its correlation time."""
    wander_m: float = 1.5e-4
    """Slow unrest (one sigma): where the wire touches the contact tip."""
    wander_s: float = 2.0
    """Its correlation time."""
    drops_hz: float = 80.0
    """Drops a second; their rhythm is loose."""
    drops_v: float = 1.0
    """Amplitude of the voltage's ripple by them."""
    shorts_per_s: float = 6.0
    """Short circuits by drops that bridge the arc."""
    short_s: tuple[float, float] = (0.0015, 0.004)
    """Their shortest and longest duration."""


QUIET = ArcNoise(length_m=0.0, wander_m=0.0, drops_v=0.0, shorts_per_s=0.0)
"""An arc without noise."""


@dataclass(frozen=True, kw_only=True)
class ArcElectrics:
    """Source, wire and arc."""

    wire_feed_m_s: float = 0.106
    """Speed of the wire."""
    open_voltage_v: float = 29.8
    """Of the source without load."""
    source_ohm: float = 0.015
    """Fall of the source's voltage with current, cables included."""
    inductance_h: float = 3e-4
    """Of the choke and cables."""
    arc_offset_v: float = 15.7
    """Voltage of an arc of no length at no current (anode and cathode fall)."""
    arc_ohm: float = 0.0237
    """Rise of the arc's voltage with current."""
    arc_field_v_per_m: float = 750.0
    """Rise of the arc's voltage with its length."""
    wire_ohm_per_m: float = 0.7
    """Resistance of the stick-out."""
    melting_m_per_as: float = 3.0e-4
    """k1: wire melted by the arc's heat at its end."""
    melting_per_a2s: float = 5.0e-5
    """k2: wire melted by its own resistance, for each metre of stick-out."""
    longest_arc_m: float = 0.012
    """A longer arc goes out."""
    least_current_a: float = 40.0
    """With less current the arc goes out."""
    most_current_a: float = 500.0
    """The source gives no more."""
    noise: ArcNoise = field(default_factory=ArcNoise)
    """What makes the current restless."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if name != "noise" and not (np.isfinite(value) and value > 0):
                raise BadGeometry(f"arc: {name} is {value}, expected a positive number")


@dataclass(frozen=True, kw_only=True)
class ArcState:
    """An arc at rest."""

    current_a: float
    """Its current."""
    stick_out_m: float
    """How far the wire sticks out of the contact tip."""
    arc_m: float
    """Length of the arc."""


@dataclass(frozen=True, kw_only=True)
class ArcResponse:
    """How the current answers to small changes of the contact tip's distance H; see the module's formula."""

    static_a_per_m: float
    """g: fall of the current for a slow rise, positive."""
    lead_s: float
    """Time of the zero: how much more a fast rise counts."""
    settle_s: float
    """Time in which the wire's stick-out follows."""
    choke_s: float
    """Time in which the current follows."""

    def at(self, frequency_hz: Float[np.ndarray, "*n"]) -> Complex[np.ndarray, "*n"]:
        """Complex ratio of the current's wave to the distance's, A/m; negative for a slow wave."""
        s = 2j * np.pi * np.asarray(frequency_hz)
        return -self.static_a_per_m * (1 + s * self.lead_s) / ((1 + s * self.settle_s) * (1 + s * self.choke_s))


def equilibrium(electrics: ArcElectrics, ctwd_m: float) -> ArcState:
    """The arc at rest at this distance of the contact tip; raises BadGeometry where none burns."""

    def stick_out_m(current_a: float) -> float:
        melted = electrics.wire_feed_m_s - electrics.melting_m_per_as * current_a
        return melted / (electrics.melting_per_a2s * current_a**2)

    def missing_v(current_a: float) -> float:
        return _circuit_v(electrics, current_a, stick_out_m(current_a), ctwd_m)

    most_a = electrics.wire_feed_m_s / electrics.melting_m_per_as
    ends = electrics.least_current_a, min(most_a, electrics.most_current_a)
    if not (np.isfinite(ctwd_m) and ends[0] < ends[1] and missing_v(ends[0]) > 0 > missing_v(ends[1])):
        raise BadGeometry(f"arc: none burns at rest with a contact tip {ctwd_m} m from the work")
    current_a = float(brentq(missing_v, *ends))
    stick_out = stick_out_m(current_a)
    if not 0 < ctwd_m - stick_out < electrics.longest_arc_m:
        raise BadGeometry(f"arc: none burns at rest with a contact tip {ctwd_m} m from the work")
    return ArcState(current_a=current_a, stick_out_m=stick_out, arc_m=ctwd_m - stick_out)


def response(electrics: ArcElectrics, ctwd_m: float) -> ArcResponse:
    """How the current answers to small changes about rest at this distance: what a test on a plate would find."""
    rest = equilibrium(electrics, ctwd_m)
    current_a = rest.current_a
    p = electrics.melting_m_per_as + 2 * electrics.melting_per_a2s * rest.stick_out_m * current_a
    q = electrics.melting_per_a2s * current_a**2
    ohm = _ohm(electrics, rest.stick_out_m)
    back_v = (electrics.arc_field_v_per_m - electrics.wire_ohm_per_m * current_a) * p
    poles = np.roots([electrics.inductance_h, ohm + electrics.inductance_h * q, ohm * q + back_v])
    if np.iscomplexobj(poles):
        raise BadGeometry("arc: with this choke the current swings; expected a smaller inductance_h")
    fast, slow = sorted(-1 / poles)
    return ArcResponse(
        static_a_per_m=electrics.arc_field_v_per_m * q / (ohm * q + back_v), lead_s=1 / q, settle_s=slow, choke_s=fast
    )


class ArcSource:
    """A burning arc; `step` changes it. It starts at rest at the first distance, if one burns there."""

    def __init__(self, electrics: ArcElectrics, rng: np.random.Generator) -> None:
        self._electrics, self._rng = electrics, rng
        self._stick_out_m: float | None = None
        self._current_a = 0.0
        self._burning = False
        start = rng.normal(size=2).tolist()
        self._length_m, self._wander_m = start[0] * electrics.noise.length_m, start[1] * electrics.noise.wander_m
        self._drops_rad = float(rng.uniform(0, 2 * np.pi))
        self._short_left_s = 0.0

    @property
    def burning(self) -> bool:
        """Whether there is an arc (or a drop that bridges it)."""
        return self._burning

    def currents(self, ctwd_m: Float[np.ndarray, "n"], dt_s: float) -> Float[np.ndarray, "n"]:
        """`step` for each of these distances; the wire's melting makes it a loop."""
        return np.array([self.step(float(distance_m), dt_s) for distance_m in ctwd_m])

    def step(self, ctwd_m: float, dt_s: float) -> float:
        """The mean current (A) during the next `dt_s` with the contact tip so far from the work; inf: no work there.

        The mean is what an integrating converter shows: sampled at 2 kHz and decimated.
        """
        if not (ctwd_m > 0 and dt_s > 0):
            raise BadGeometry(f"arc: expected a positive distance and time, found {ctwd_m} m, {dt_s} s")
        if self._stick_out_m is None:
            self._strike(ctwd_m)
        count = int(np.ceil(dt_s / _STEP_S - 1e-9))
        noises = self._rng.standard_normal((count, 3)).tolist()
        return sum(self._small_step(ctwd_m, dt_s / count, noise) for noise in noises) / count

    def _strike(self, ctwd_m: float) -> None:
        try:
            rest = equilibrium(self._electrics, ctwd_m)
        except BadGeometry:
            self._stick_out_m = min(ctwd_m, 0.015)  # cut short and fed on until it touches
            return
        self._stick_out_m, self._current_a, self._burning = rest.stick_out_m, rest.current_a, True

    def _small_step(self, ctwd_m: float, dt_s: float, noise: list[float]) -> float:
        """The current at the end of a small step: exact for a wire that stands still; then the wire moves on."""
        electrics, stick_out_m = self._electrics, min(self._stick_out_m or 0.0, ctwd_m)
        noise_v, bridged = self._unrest(dt_s, noise)
        arc_m = ctwd_m - stick_out_m
        touching = arc_m <= 0 or (bridged and self._burning)
        self._burning = touching or (
            self._burning and arc_m < electrics.longest_arc_m and self._current_a > electrics.least_current_a
        )
        if not self._burning:
            self._current_a, melted_m_s = 0.0, 0.0
        else:
            self._current_a = self._next_current_a(stick_out_m, None if touching else arc_m, noise_v, dt_s)
            at_end = 0.0 if touching else electrics.melting_m_per_as * self._current_a
            melted_m_s = at_end + electrics.melting_per_a2s * stick_out_m * self._current_a**2
        grown_m = stick_out_m + (electrics.wire_feed_m_s - melted_m_s) * dt_s
        self._stick_out_m = max(grown_m, _SHORTEST_M)
        return self._current_a

    def _next_current_a(self, stick_out_m: float, arc_m: float | None, noise_v: float, dt_s: float) -> float:
        """The current after `dt_s`, on its way to what the voltages ask for; without an arc if `arc_m` is None."""
        electrics = self._electrics
        if arc_m is None:
            ohm, drive_v = electrics.source_ohm + electrics.wire_ohm_per_m * stick_out_m, electrics.open_voltage_v
        else:
            ohm = _ohm(electrics, stick_out_m)
            drive_v = electrics.open_voltage_v - electrics.arc_offset_v - electrics.arc_field_v_per_m * arc_m + noise_v
        asked_a = max(drive_v, 0.0) / ohm
        left = math.exp(-dt_s * ohm / electrics.inductance_h)
        return min(asked_a + (self._current_a - asked_a) * left, electrics.most_current_a)

    def _unrest(self, dt_s: float, noise: list[float]) -> tuple[float, bool]:
        """The noise's voltage, and whether a drop bridges the arc."""
        levels = self._electrics.noise
        keep, slow = math.exp(-dt_s / levels.length_s), math.exp(-dt_s / levels.wander_s)
        self._length_m = keep * self._length_m + levels.length_m * math.sqrt(1 - keep**2) * noise[0]
        self._wander_m = slow * self._wander_m + levels.wander_m * math.sqrt(1 - slow**2) * noise[1]
        # a tenth of its frequency wide: the rhythm's phase wanders by a radian in some three drops
        spread_rad = math.sqrt(0.2 * math.pi * levels.drops_hz * dt_s)
        self._drops_rad += 2 * math.pi * levels.drops_hz * dt_s + spread_rad * noise[2]
        ripple_v = levels.drops_v * math.sin(self._drops_rad)
        if self._short_left_s <= 0 and levels.shorts_per_s > 0 and self._rng.random() < levels.shorts_per_s * dt_s:
            self._short_left_s = float(self._rng.uniform(*levels.short_s))
        bridged = self._short_left_s > 0
        self._short_left_s -= dt_s
        return -self._electrics.arc_field_v_per_m * (self._length_m + self._wander_m) + ripple_v, bridged


def _ohm(electrics: ArcElectrics, stick_out_m: float) -> float:
    """All that the current meets: source, arc, wire."""
    return electrics.source_ohm + electrics.arc_ohm + electrics.wire_ohm_per_m * stick_out_m


def _circuit_v(electrics: ArcElectrics, current_a: float, stick_out_m: float, ctwd_m: float) -> float:
    """Voltage that is left to raise the current."""
    arc_v = electrics.arc_offset_v + electrics.arc_field_v_per_m * (ctwd_m - stick_out_m)
    return electrics.open_voltage_v - arc_v - _ohm(electrics, stick_out_m) * current_a

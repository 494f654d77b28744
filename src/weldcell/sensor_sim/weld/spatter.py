"""Spatter: glowing droplets that the arc throws out, and the streaks that they leave in the picture.

Births are a Poisson process in time. Each slot of 0.1 s has its own random numbers, so that what flies at a time
depends on the seed and that time alone. A droplet of diameter d starts at the arc with the velocity v and flies under
gravity g and a drag that is taken as linear with the time constant k it has at the start,

    x(t) = k (v - k g) (1 - exp(-t / k)) + k g t,     1/k = 18 mu (1 + 0.15 Re^0.687) / (rho d^2)

(Schiller and Naumann, 1935). It lands where a straight flight would meet a surface, or where it comes down to the tip's
height. Its heat goes to the air (Ranz and Marshall: Nu = 2 + 0.6 Re^(1/2) Pr^(1/3)) and into radiation, taken as linear
in the temperature with the value at 1900 K:

    T(t) = T_air + (T_0 - T_air) exp(-t / c),     c = rho c_p d / 6 h,     h = Nu k_air / d + 4 e sigma T^3.

Figures. Wire droplets in gas metal arcs are at 2100 to 2800 K (Soderstrom, Scott and Mendez, Calorimetric measurement
of droplet temperature in GMAW, Welding Journal 90, 2011), spatter some way off still at 2300 K (Fire 7, 441, 2024, doi
10.3390/fire7120441); larger droplets are slower (Shin and You, Energies 13, 6502, 2020). Sizes, speeds and numbers are
chosen to be usual. Their mass at strength 1 is 0.16 g/s, a tenth of 5 kg of wire an hour: an arc that spatters.
Brightness is Planck's law for liquid steel at that temperature: no free factor.
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from weldcell.cell.randomness import generator

DROPLETS_PER_S = 800.0
"""Births a second at strength 1."""
SLOT_S = 0.1
LIFE_S = 0.4
"""After this a droplet is forgotten; it has landed and is dark by then, or is out of sight."""

_GRAVITY_M_S2 = 9.80665
_DIAMETER_M, _DIAMETER_SPREAD, _DIAMETER_RANGE_M = 0.25e-3, 0.5, (0.05e-3, 2e-3)  # log-normal
_SPEED_M_S, _SPEED_SPREAD, _SPEED_RANGE_M_S = 3.5, 0.6, (0.3, 12.0)  # log-normal, for the median diameter
_SPEED_EXPONENT = -0.3  # of the diameter
_LOWEST_RAD, _HIGHEST_RAD = np.deg2rad(3.0), np.deg2rad(60.0)
_TEMPERATURE_K, _TEMPERATURE_SPREAD_K, _TEMPERATURE_MOST_K = 2450.0, 120.0, 2800.0

_AIR_K, _GREY_K = 300.0, 1900.0  # around, and where radiation is linearised
_STEEL_KG_M3, _STEEL_J_KG_K, _EMISSIVITY, _STEFAN = 7000.0, 800.0, 0.4, 5.670374e-8  # liquid iron
_AIR_KG_M3, _AIR_VISCOSITY = 1.2, 1.8e-5  # for drag, Pa s
_FILM_W_M_K, _FILM_M2_S, _PRANDTL = 0.075, 1.5e-4, 0.7  # air at 1100 K, between droplet and surroundings
_LANDED_COOLING = 4.0  # a splat on cold metal loses its heat this many times as fast (chosen)
_DARK_K = 1200.0  # steel's light in the red is a 10^-4 of what it is at 2400 K
_NEWTON_STEPS = 4
_LOWEST_DROP_M = 5e-4  # of an arc beside or below its torch's tip


@dataclass(frozen=True, kw_only=True)
class Droplets:
    """Droplets as they are born at the arc."""

    birth_s: Float[np.ndarray, "n"]
    """Time of birth."""
    velocity_base: Float[np.ndarray, "n 3"]
    """Start velocity, m/s; base frame, z up."""
    diameter_m: Float[np.ndarray, "n"]
    """Diameter."""
    temperature_k: Float[np.ndarray, "n"]
    """Temperature at the start."""

    def chosen(self, which: np.ndarray) -> "Droplets":
        """Some of them."""
        return Droplets(**{field.name: getattr(self, field.name)[which] for field in fields(self)})


def born(seed: int, stage: str, start_s: float, end_s: float, rate_per_s: float) -> Droplets:
    """The droplets born from `start_s` up to before `end_s`, whatever was asked before."""
    slots = range(max(int(start_s // SLOT_S), 0), int(end_s // SLOT_S) + 1)
    droplets = joined([_slot(generator(seed, stage, slot), slot * SLOT_S, rate_per_s) for slot in slots])
    return droplets.chosen((droplets.birth_s >= start_s) & (droplets.birth_s < end_s))


def joined(parts: list[Droplets]) -> Droplets:
    """All droplets of several lots."""
    nothing = np.empty(0)
    none = Droplets(birth_s=nothing, velocity_base=np.empty((0, 3)), diameter_m=nothing, temperature_k=nothing)
    return Droplets(
        **{field.name: np.concatenate([getattr(part, field.name) for part in [none, *parts]]) for field in fields(none)}
    )


def flight_m(droplets: Droplets, ages_s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """How far droplets of these ages are from the arc, had nothing stood in their way."""
    drag_s = _drag_s(droplets)[:, None]
    fall = np.array([0.0, 0.0, -_GRAVITY_M_S2]) * drag_s
    ages_s = np.maximum(ages_s, 0)[:, None]
    return -drag_s * np.expm1(-ages_s / drag_s) * (droplets.velocity_base - fall) + fall * ages_s


def landing_age_s(droplets: Droplets, straight_m: Float[np.ndarray, "n"], drop_m: float) -> Float[np.ndarray, "n"]:
    """Age at which droplets land: at a surface `straight_m` ahead, or `drop_m` below the arc; inf for never."""
    drag_s = _drag_s(droplets)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = straight_m / (np.linalg.norm(droplets.velocity_base, axis=1) * drag_s)
        at_surface_s = np.where(share < 1, -drag_s * np.log1p(-share), np.inf)
    rise_m_s, drop_m = droplets.velocity_base[:, 2], max(drop_m, _LOWEST_DROP_M)
    age_s = (rise_m_s + np.sqrt(rise_m_s**2 + 2 * _GRAVITY_M_S2 * drop_m)) / _GRAVITY_M_S2  # without drag
    for _ in range(_NEWTON_STEPS):
        fall_m_s = _GRAVITY_M_S2 * drag_s
        speed_m_s = (rise_m_s + fall_m_s) * np.exp(-age_s / drag_s) - fall_m_s
        age_s = age_s - (flight_m(droplets, age_s)[:, 2] + drop_m) / speed_m_s
    return np.fmin(at_surface_s, age_s)


def temperature_k(
    droplets: Droplets, ages_s: Float[np.ndarray, "n"], landing_s: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Temperature of droplets of these ages that land at `landing_s`; a landed one cools faster."""
    flown_s, lain_s = np.minimum(ages_s, landing_s), np.maximum(ages_s - landing_s, 0)
    decay = np.exp(-(flown_s + _LANDED_COOLING * lain_s) / _cooling_s(droplets))
    return _AIR_K + (droplets.temperature_k - _AIR_K) * decay


def glowing(droplets: Droplets, time_s: float) -> Bool[np.ndarray, "n"]:
    """Which droplets can still be bright enough to be seen at a time: those that would be hot if still in flight."""
    ages_s = np.maximum(time_s - droplets.birth_s, 0)
    return temperature_k(droplets, ages_s, ages_s) > _DARK_K


def _slot(rng: np.random.Generator, start_s: float, rate_per_s: float) -> Droplets:
    """The droplets of one slot of time."""
    count = rng.poisson(rate_per_s * SLOT_S)
    birth_s = start_s + SLOT_S * rng.uniform(size=count)
    diameter_m = np.clip(_DIAMETER_M * np.exp(_DIAMETER_SPREAD * rng.normal(size=count)), *_DIAMETER_RANGE_M)
    median_m_s = _SPEED_M_S * (diameter_m / _DIAMETER_M) ** _SPEED_EXPONENT
    speed_m_s = np.clip(median_m_s * np.exp(_SPEED_SPREAD * rng.normal(size=count)), *_SPEED_RANGE_M_S)
    azimuth_rad, elevation_rad = rng.uniform(0, 2 * np.pi, count), rng.uniform(_LOWEST_RAD, _HIGHEST_RAD, count)
    level = np.cos(elevation_rad)
    directions = np.column_stack([level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), np.sin(elevation_rad)])
    hot_k = _TEMPERATURE_K + _TEMPERATURE_SPREAD_K * rng.normal(size=count)
    return Droplets(
        birth_s=birth_s,
        velocity_base=speed_m_s[:, None] * directions,
        diameter_m=diameter_m,
        temperature_k=np.clip(hot_k, _GREY_K, _TEMPERATURE_MOST_K),
    )


def _drag_s(droplets: Droplets) -> Float[np.ndarray, "n"]:
    """Time constant of the drag at the start's speed."""
    speed_m_s = np.linalg.norm(droplets.velocity_base, axis=1)
    reynolds = _AIR_KG_M3 * speed_m_s * droplets.diameter_m / _AIR_VISCOSITY
    return _STEEL_KG_M3 * droplets.diameter_m**2 / (18 * _AIR_VISCOSITY * (1 + 0.15 * reynolds**0.687))


def _cooling_s(droplets: Droplets) -> Float[np.ndarray, "n"]:
    """Time constant of the cooling in flight."""
    speed_m_s = np.linalg.norm(droplets.velocity_base, axis=1)
    nusselt = 2 + 0.6 * np.sqrt(speed_m_s * droplets.diameter_m / _FILM_M2_S) * _PRANDTL ** (1 / 3)
    loss = nusselt * _FILM_W_M_K / droplets.diameter_m + 4 * _EMISSIVITY * _STEFAN * _GREY_K**3
    return _STEEL_KG_M3 * _STEEL_J_KG_K * droplets.diameter_m / (6 * loss)

"""Spatter: a Poisson process of droplets that fly, land and cool as mechanics and heat transfer have it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import kstest

from weldcell.cell.configuration import SensorConfig
from weldcell.sensor_sim.weld.photometry import photometry
from weldcell.sensor_sim.weld.spatter import (
    DROPLETS_PER_S,
    Droplets,
    born,
    flight_m,
    glowing,
    landing_age_s,
    temperature_k,
)

GRAVITY = np.array([0.0, 0.0, -9.80665])
NEVER = np.full(1, np.inf)


def droplet(velocity=(1.0, 0.5, 2.0), diameter_m=5e-4, temperature=2400.0) -> Droplets:
    return Droplets(
        birth_s=np.zeros(1),
        velocity_base=np.array([velocity]),
        diameter_m=np.array([diameter_m]),
        temperature_k=np.array([temperature]),
    )


def drag_s(drop: Droplets) -> float:
    """Schiller and Naumann, written anew: viscous time over the drag's excess."""
    speed, d = np.linalg.norm(drop.velocity_base), drop.diameter_m[0]
    reynolds = 1.2 * speed * d / 1.8e-5
    return float(7000 * d**2 / (18 * 1.8e-5) / (1 + 0.15 * reynolds**0.687))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_births_are_a_poisson_process(seed):
    droplets = born(seed, "spatter", 0.0, 40.0, 100.0)
    counts = np.histogram(droplets.birth_s, np.arange(0, 40.01, 0.05))[0]
    assert counts.mean() == pytest.approx(5.0, abs=4 * np.sqrt(5 / 800))  # 4 sigma
    assert counts.var() / counts.mean() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 800))
    gaps = np.diff(np.sort(droplets.birth_s))
    assert kstest(gaps * 100, "expon").pvalue > 1e-3


def test_births_do_not_depend_on_what_was_asked():
    whole = born(7, "spatter", 0.0, 3.0, 200.0)
    part = born(7, "spatter", 0.93, 2.21, 200.0)
    inside = (whole.birth_s >= 0.93) & (whole.birth_s < 2.21)
    for name in ("birth_s", "velocity_base", "diameter_m", "temperature_k"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[inside])


def test_droplets_weigh_a_tenth_of_the_wire():
    droplets = born(1, "spatter", 0.0, 60.0, DROPLETS_PER_S)
    kg_per_s = np.sum(7000 * np.pi / 6 * droplets.diameter_m**3) / 60
    assert kg_per_s == pytest.approx(0.1 * 5 / 3600, rel=0.25)  # rounded figures


def test_heavy_droplets_fly_a_parabola():
    heavy, ages_s = droplet(diameter_m=1.0), np.linspace(0, 0.5, 6)
    for age_s in ages_s:
        expected = heavy.velocity_base[0] * age_s + GRAVITY * age_s**2 / 2
        np.testing.assert_allclose(flight_m(heavy, np.array([age_s]))[0], expected, atol=2e-5)  # drag: t / k = 1e-5


@pytest.mark.parametrize("diameter_m", [1e-4, 3e-4, 1e-3])
def test_flight_solves_the_equation_of_motion_with_linear_drag(diameter_m):
    drop = droplet(diameter_m=diameter_m)
    k = drag_s(drop)

    def motion(_, state):
        return np.concatenate([state[3:], GRAVITY - state[3:] / k])

    start = np.concatenate([np.zeros(3), drop.velocity_base[0]])
    solved = solve_ivp(motion, (0, 0.3), start, rtol=1e-9, atol=1e-12).y[:3, -1]
    np.testing.assert_allclose(flight_m(drop, np.array([0.3]))[0], solved, atol=1e-7)  # the solver's tolerance


@pytest.mark.parametrize("velocity", [(1.0, 0.5, 2.0), (4.0, 0.0, 0.3), (0.1, 0.0, 0.5)])
def test_droplets_land_when_they_have_come_down(velocity):
    drop = droplet(velocity)
    age_s = landing_age_s(drop, NEVER, 0.003)
    assert age_s[0] > 2 * 0.9 * velocity[2] / 9.81 * 0.9
    assert flight_m(drop, age_s)[0, 2] == pytest.approx(-0.003, abs=1e-7)


def test_droplets_land_on_walls_before_that():
    drop = droplet((3.0, 0.0, 0.1))
    age_s = landing_age_s(drop, np.array([0.06]), 0.003)
    assert flight_m(drop, age_s)[0, 0] == pytest.approx(0.06, rel=1e-3)  # straight but for gravity's millimetre


def test_cooling_solves_newtons_law_and_is_faster_after_landing():
    drop = droplet(diameter_m=4e-4)
    speed = np.linalg.norm(drop.velocity_base)
    nusselt = 2 + 0.6 * (speed * 4e-4 / 1.5e-4) ** 0.5 * 0.7 ** (1 / 3)
    h = nusselt * 0.075 / 4e-4 + 4 * 0.4 * 5.670374e-8 * 1900**3
    rate = 6 * h / (7000 * 800 * 4e-4)
    flying = temperature_k(drop, np.array([0.05]), NEVER)[0]
    assert flying == pytest.approx(300 + 2100 * np.exp(-0.05 * rate), rel=1e-9)
    assert temperature_k(drop, np.array([0.05]), np.array([0.02]))[0] < flying


def test_brightness_is_plancks():
    response = photometry(SensorConfig())
    ratio = response.hot_steel_grey(np.array(2400.0)) / response.hot_steel_grey(np.array(1800.0))
    second_constant = 1.438777e-2  # m K; at 658 nm Wien's law is Planck's to 1e-4
    assert ratio == pytest.approx(np.exp(second_constant / 658e-9 * (1 / 1800 - 1 / 2400)), rel=1e-3)


def test_brightness_of_steel_by_hand():
    """2400 K at 658 nm: 1.191e8 / 0.658^5 / (exp(14388 / (0.658 2400)) - 1) W/(m2 sr um), times 0.4 and 0.01 um."""
    radiance = 1.191e8 / 0.658**5 / np.expm1(14388 / (0.658 * 2400)) * 0.4 * 0.01
    aperture_m = 12e-3 * 275 / 287 / 8  # focal length 12 * 275 / 287 mm, f/8
    watt = np.pi * 0.8 * radiance * (aperture_m / 24e-3) ** 2 * (3.45e-6) ** 2
    electrons = watt * 1e-3 / (6.626e-34 * 2.998e8 / 658e-9) * 0.5
    assert photometry(SensorConfig()).hot_steel_grey(np.array(2400.0)) == pytest.approx(electrons / 41, rel=2e-3)


def test_only_cold_droplets_are_forgotten():
    droplets = born(3, "spatter", 0.0, 0.5, DROPLETS_PER_S)
    dark = ~glowing(droplets, 0.5)
    hot = temperature_k(droplets, 0.5 - droplets.birth_s, np.full(len(dark), np.inf))
    response = photometry(SensorConfig())
    assert dark.any() and response.hot_steel_grey(hot[dark]).max() < 0.2  # levels

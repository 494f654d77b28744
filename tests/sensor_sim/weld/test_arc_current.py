"""The current obeys its own balances, answers as the linear theory says; the arc goes out or shorts as arcs do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from weldcell.cell.errors import BadGeometry
from weldcell.sensor_sim.weld.arc_current import QUIET, ArcElectrics, ArcNoise, ArcSource, equilibrium, response

CALM = ArcElectrics(noise=QUIET)
REST_M = 0.018
DT_S = 1e-3


def source(electrics=CALM, seed=1):
    return ArcSource(electrics, np.random.default_rng(seed))


@pytest.mark.parametrize("ctwd_m", [0.014, 0.018, 0.022])
def test_at_rest_the_wire_melts_as_it_is_fed_and_the_voltages_add_up(ctwd_m):
    rest, e = equilibrium(CALM, ctwd_m), CALM
    current = rest.current_a
    melted = e.melting_m_per_as * current + e.melting_per_a2s * rest.stick_out_m * current**2
    arc_v = e.arc_offset_v + e.arc_ohm * current + e.arc_field_v_per_m * rest.arc_m
    wire_v = e.wire_ohm_per_m * rest.stick_out_m * current
    assert melted == pytest.approx(e.wire_feed_m_s, rel=1e-9)  # solver's precision
    assert e.open_voltage_v - e.source_ohm * current == pytest.approx(arc_v + wire_v, abs=1e-6)  # V
    assert rest.stick_out_m + rest.arc_m == pytest.approx(ctwd_m)


def test_the_usual_arc_is_one_of_the_textbook():
    """1.2 mm wire at 6.4 m/min: 200 to 250 A at 24 to 29 V, an arc of some millimetres; 2 % a millimetre."""
    rest = equilibrium(CALM, REST_M)
    volts = CALM.open_voltage_v - CALM.source_ohm * rest.current_a
    assert 200 < rest.current_a < 250 and 24 < volts < 29 and 0.002 < rest.arc_m < 0.006
    slope = response(CALM, REST_M).static_a_per_m
    bound = CALM.melting_per_a2s * rest.current_a**2
    bound /= CALM.melting_m_per_as + 2 * CALM.melting_per_a2s * rest.stick_out_m * rest.current_a
    assert 3e3 < slope < bound  # an arc of constant length has the steepest slope that the wire's law allows


def test_the_slow_slope_is_that_between_two_arcs_at_rest():
    step_m = 1e-5
    near, far = (equilibrium(CALM, REST_M + side * step_m).current_a for side in (-1, 1))
    # second differences of the curve: 40 A/mm^2 x (0.01 mm)^2
    assert response(CALM, REST_M).static_a_per_m == pytest.approx((near - far) / (2 * step_m), rel=1e-4)


def test_a_sudden_change_moves_the_current_a_lot_and_then_less_as_the_linear_system_does():
    step_m = 2e-5
    r, arc = response(CALM, REST_M), source()
    before = arc.step(REST_M, DT_S)
    rise = before - arc.currents(np.full(600, REST_M + step_m), DT_S)
    numerator = r.static_a_per_m * np.array([r.lead_s, 1])
    denominator = np.polymul([r.settle_s, 1], [r.choke_s, 1])
    times = np.arange(6001) * DT_S / 10
    _, ideal, _ = lsim((numerator, denominator), np.full(6001, step_m), times)
    ideal = ideal[:-1].reshape(-1, 10).mean(axis=1)
    assert np.abs(rise - ideal).max() < 0.05 * ideal.max()  # steps of 0.5 ms against a choke's 6.5 ms
    assert ideal.max() > 2.5 * r.static_a_per_m * step_m  # self-regulation takes most of it back
    assert rise[-1] == pytest.approx(r.static_a_per_m * step_m, rel=0.02)


@pytest.mark.parametrize("frequency_hz", [0.5, 2.0, 5.0])
def test_a_wave_of_distance_gives_the_wave_of_current_that_the_response_says(frequency_hz):
    count = round(4 / frequency_hz / DT_S)
    phase = 2 * np.pi * frequency_hz * (np.arange(count) + 0.5) * DT_S
    distance_m = REST_M + 1e-4 * np.sin(phase)
    settled = slice(count // 2, None)
    current = source().currents(distance_m, DT_S)[settled]
    found = 2 * np.mean(current * np.exp(-1j * (phase[settled] - np.pi / 2))) / 1e-4
    said = response(CALM, REST_M).at(np.array(frequency_hz))
    assert abs(found / said - 1) < 0.03  # half a step's lag at 5 Hz is 0.008 rad; curvature over 0.1 mm


def test_the_current_is_most_sensitive_at_about_five_hertz():
    """Ushio and Mao, 1997: measured about 5 Hz."""
    frequencies = np.linspace(0.1, 40, 800)
    sensitivity = np.abs(response(CALM, REST_M).at(frequencies))
    assert 3 < frequencies[np.argmax(sensitivity)] < 10


def test_an_arc_that_becomes_too_long_goes_out_and_strikes_again_when_the_wire_has_come_down():
    arc = source()
    arc.currents(np.full(100, REST_M), DT_S)
    away = arc.currents(np.full(50, REST_M + 0.015), DT_S)
    assert not arc.burning and away[-1] == 0.0
    back = arc.currents(np.full(1500, REST_M), DT_S)
    assert arc.burning
    assert back[-1] == pytest.approx(equilibrium(CALM, REST_M).current_a, rel=0.01)
    assert np.max(back) > 1.5 * back[-1]  # it strikes by touching


def test_no_work_means_no_current():
    assert np.all(source().currents(np.full(200, np.inf), DT_S) == 0.0)


def test_a_tip_pushed_to_the_work_draws_a_short_circuits_current_and_burns_free():
    arc = source()
    arc.currents(np.full(100, REST_M), DT_S)
    near = arc.currents(np.full(300, REST_M - 0.006), DT_S)
    assert np.max(near[:20]) > 1.3 * equilibrium(CALM, REST_M).current_a
    assert near[-1] == pytest.approx(equilibrium(CALM, REST_M - 0.006).current_a, rel=0.02)  # settles in 0.09 s


@pytest.mark.parametrize("seed", [1, 2])
def test_unrest_of_the_arcs_length_shows_as_the_spectrum_says(seed):
    """Two-sided density 2 l^2 c of the distance, through the response; 2 % for steps of 0.5 ms against 4 ms."""
    noise = ArcNoise(length_m=2e-4, wander_m=0.0, drops_v=0.0, shorts_per_s=0.0)
    current = source(replace(CALM, noise=noise), seed).currents(np.full(40_000, REST_M), DT_S)
    waves = np.fft.rfft(current.reshape(40, -1), axis=1)[:, 1:9] * DT_S  # 1 s each: 1 to 8 Hz
    answer = response(CALM, REST_M).at(np.arange(1, 9))
    omega = 2 * np.pi * np.arange(1, 9)
    density = 2 * noise.length_m**2 * noise.length_s / (1 + (omega * noise.length_s) ** 2)
    ratio = np.mean(np.abs(waves) ** 2 / (np.abs(answer) ** 2 * density))
    assert ratio == pytest.approx(1.0, abs=4 / np.sqrt(40 * 8))  # 320 exponential numbers, four sigma


def test_short_circuits_come_as_often_as_they_should():
    electrics = replace(CALM, noise=replace(QUIET, shorts_per_s=6.0))
    current = source(electrics).currents(np.full(30_000, REST_M), DT_S)
    above = current > 1.15 * np.median(current)
    starts = int(np.sum(above[1:] & ~above[:-1]))
    assert abs(starts - 180) < 4 * np.sqrt(180)  # Poisson, four sigma


def test_the_current_is_the_same_for_the_same_seed_one_by_one_or_all_at_once():
    electrics, distance_m = ArcElectrics(), REST_M + 1e-3 * np.sin(np.arange(300) / 40)
    one = source(electrics, 5)
    singly = [one.step(float(d), DT_S) for d in distance_m]
    np.testing.assert_array_equal(source(electrics, 5).currents(distance_m, DT_S), singly)
    assert not np.array_equal(source(electrics, 6).currents(distance_m, DT_S), singly)


@pytest.mark.parametrize(("distance_m", "dt_s"), [(0.0, 1e-3), (np.nan, 1e-3), (0.018, 0.0), (-0.01, 1e-3)])
def test_what_is_no_distance_or_time_is_refused(distance_m, dt_s):
    with pytest.raises(BadGeometry):
        source().step(distance_m, dt_s)


def test_electrics_that_are_none_are_refused():
    with pytest.raises(BadGeometry, match="wire_feed_m_s"):
        ArcElectrics(wire_feed_m_s=0.0)
    with pytest.raises(BadGeometry, match="none burns"):
        equilibrium(CALM, 0.5)

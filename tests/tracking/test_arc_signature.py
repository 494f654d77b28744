"""What a weave's current shows: the closed forms of a V, both detectors, their noise."""

import numpy as np
import pytest

from weldcell.tracking.arc_signature import ArcSignature, CurrentResponse, quiet_samples
from weldcell.tracking.weaving import Weave

A = 0.002
WEAVE = Weave(amplitude_m=A, frequency_hz=2.0)
AT_ONCE = CurrentResponse(static_a_per_m=1e4, lead_s=0.0, settle_s=0.0, choke_s=0.0)
COT = 1 / np.tan(np.pi / 6)
PHASE = 2 * np.pi * (np.arange(500) + 0.5) / 500


def signature(response=AT_ONCE, detector="projection", weave=WEAVE):
    return ArcSignature(weave, np.pi / 3, response, detector)


def current(lateral_m, weave=WEAVE):
    """In a V of 60 degrees, by an arc that answers at once."""
    return 230 + 1e4 * COT * np.abs(lateral_m + weave.lateral_at_phase_m(PHASE))


@pytest.mark.parametrize("k", [-0.9, -0.3, 0.0, 0.2, 0.6, 1.0])
def test_the_harmonics_in_a_v_are_those_of_the_closed_form(k):
    wave = signature().read(PHASE, current(k * A))
    scale = 1e4 * COT * A
    root = np.sqrt(1 - k * k)
    assert wave.first_a == pytest.approx(scale * 2 / np.pi * (k * root + np.arcsin(k)), abs=1e-3 * scale)  # 500 samples
    assert wave.second_a == pytest.approx(scale * 4 / (3 * np.pi) * root**3, abs=1e-3 * scale)
    assert wave.mean_a == pytest.approx(230 + scale * 2 / np.pi * (root + k * np.arcsin(k)), abs=1e-3 * scale)


@pytest.mark.parametrize("detector", ["projection", "half-periods"])
@pytest.mark.parametrize("shape", ["sine", "triangle"])
@pytest.mark.parametrize("lateral_m", [-1.5e-3, -4e-4, 0.0, 1e-4, 1.2e-3])
def test_without_noise_the_offset_is_read_exactly_left_of_travel_positive(detector, shape, lateral_m):
    weave = Weave(amplitude_m=A, frequency_hz=2.0, shape=shape, dwell_ratio=0.1)
    read = signature(detector=detector, weave=weave)
    found = read.lateral_m(read.read(PHASE, current(lateral_m, weave)).first_a)
    assert found == pytest.approx(lateral_m, abs=2e-5)  # m: half-periods of 500 samples see an edge to 1/250 of A


@pytest.mark.parametrize("lateral_m", [0.004, -0.007])
def test_beyond_the_weave_it_still_tells_the_side(lateral_m):
    found = signature().lateral_m(signature().read(PHASE, current(lateral_m)).first_a)
    assert found == pytest.approx(np.sign(lateral_m) * A, rel=0.02)


@pytest.mark.parametrize("detector", ["projection", "half-periods"])
def test_an_arc_that_answers_late_and_unevenly_is_read_as_exactly(detector):
    """The current is filtered here in the time domain, weave after weave, until it repeats itself."""
    response = CurrentResponse()
    lateral_m, dt_s = 7e-4, 1e-3
    drive = np.tile(COT * np.abs(lateral_m + WEAVE.lateral_at_phase_m(PHASE)), 6)
    settled, choked = drive[0], drive[0]  # H = lead/settle + (1 - lead/settle) / (1 + settle s), then the choke
    out = []
    for value in drive:
        settled += dt_s / response.settle_s * (value - settled)
        fast = response.lead_s / response.settle_s
        choked += dt_s / (response.choke_s + dt_s / 2) * (fast * value + (1 - fast) * settled - choked)
        out.append(230 + response.static_a_per_m * choked)
    read = signature(response, detector)
    found = read.lateral_m(read.read(PHASE, np.array(out[-500:])).first_a)
    assert found == pytest.approx(lateral_m, rel=0.03)  # Euler steps of 1 ms against 6.5 and 93 ms


@pytest.mark.parametrize(("detector", "factor"), [("projection", np.sqrt(2) * np.pi / 4), ("half-periods", 1.0)])
def test_white_noise_of_the_distance_gives_the_sigma_of_the_paper(detector, factor):
    """sigma = factor sqrt(N / T) tan(h), N = variance x sampling time; 400 weaves: 3.5 % a sigma."""
    rng, sigma_m = np.random.default_rng(7), 2e-4
    read = signature(detector=detector)
    noise_a = 1e4 * sigma_m * rng.standard_normal((400, 500))
    found = [read.lateral_m(read.read(PHASE, current(0.0) + row).first_a) for row in noise_a]
    predicted = factor * np.sqrt(sigma_m**2 * 1e-3 / 0.5) / COT
    assert np.std(found) == pytest.approx(predicted, rel=0.12)
    assert abs(np.mean(found)) < 4 * predicted / 20


def test_missing_samples_do_not_shift_the_projection():
    rng = np.random.default_rng(3)
    kept = rng.uniform(size=500) > 0.1
    kept[100:120] = False
    read = signature()
    assert read.lateral_m(read.read(PHASE[kept], current(5e-4)[kept]).first_a) == pytest.approx(5e-4, abs=3e-5)


def test_samples_of_a_short_circuit_or_no_arc_and_just_after_are_not_quiet():
    time_s = np.arange(100) * 1e-3
    amperes = np.full(100, 230.0)
    amperes[20:23], amperes[60] = 400.0, 0.0
    quiet = quiet_samples(time_s, amperes, 230.0, 0.0045, (0.6, 1.5))
    assert np.flatnonzero(~quiet).tolist() == [*range(20, 27), *range(60, 65)]

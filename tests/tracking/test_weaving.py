"""Weaves in closed form: left first, right amplitude, derivative, dwell."""

import numpy as np
import pytest

from weldcell.cell.errors import BadInput
from weldcell.tracking.weaving import Weave


@pytest.mark.parametrize("shape", ["sine", "triangle"])
@pytest.mark.parametrize("dwell_ratio", [0.0, 0.3])
def test_a_weave_starts_to_the_left_and_reaches_its_amplitude_on_both_sides(shape, dwell_ratio):
    weave = Weave(amplitude_m=0.002, frequency_hz=2.0, shape=shape, dwell_ratio=dwell_ratio)
    quarters = weave.lateral_m(np.array([0.0, 0.125, 0.25, 0.375, 0.5]))
    np.testing.assert_allclose(quarters, [0, 0.002, 0, -0.002, 0], atol=1e-12)
    assert weave.lateral_speed_m_s(np.array([0.0]))[0] > 0
    assert weave.period_s == 0.5


@pytest.mark.parametrize("shape", ["sine", "triangle"])
def test_the_speed_is_the_derivative(shape):
    weave = Weave(amplitude_m=0.002, frequency_hz=2.0, shape=shape, dwell_ratio=0.2)
    time_s = np.linspace(0.003, 1.9, 400)
    numeric = (weave.lateral_m(time_s + 1e-7) - weave.lateral_m(time_s - 1e-7)) / 2e-7
    away_from_corners = np.abs(np.abs(weave.lateral_m(time_s)) - 0.002) > 1e-6
    found = weave.lateral_speed_m_s(time_s)
    np.testing.assert_allclose(found[away_from_corners], numeric[away_from_corners], atol=1e-7)  # m/s


@pytest.mark.parametrize("dwell_ratio", [0.0, 0.25, 0.6])
def test_the_dwell_is_the_share_of_time_at_the_ends(dwell_ratio):
    weave = Weave(amplitude_m=0.002, frequency_hz=1.0, shape="triangle", dwell_ratio=dwell_ratio)
    lateral_m = weave.lateral_m((np.arange(10_000) + 0.5) / 10_000)
    assert np.mean(np.abs(lateral_m) == 0.002) == pytest.approx(dwell_ratio, abs=1e-3)  # of 10 000 samples
    assert np.mean(np.abs(lateral_m)) == pytest.approx(0.002 * (1 + dwell_ratio) / 2, rel=1e-3)  # ramps and ends


def test_no_weave_stands_still():
    weave = Weave(amplitude_m=0.002, frequency_hz=1.0, shape="none")
    assert not weave.lateral_m(np.linspace(0, 3, 50)).any()
    assert not weave.lateral_speed_m_s(np.linspace(0, 3, 50)).any()


@pytest.mark.parametrize("wrong", [{"amplitude_m": -1.0}, {"frequency_hz": np.nan}, {"dwell_ratio": 1.0}])
def test_what_is_no_weave_is_refused(wrong):
    with pytest.raises(BadInput, match=next(iter(wrong))):
        Weave(**{"amplitude_m": 0.002, "frequency_hz": 2.0} | wrong)

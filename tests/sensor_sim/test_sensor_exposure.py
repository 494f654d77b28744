"""Bits, exposure and gain of whole pictures: levels, noise and stripe are what one another imply."""

from dataclasses import replace

import numpy as np
import pytest

from sensor_sim.rigs import rig
from weldcell.cell.configuration import SensorConfig
from weldcell.sensor_sim.line_sensor import Exposure, LineSensor
from weldcell.tracking.stripe import find_stripe

PLATE = '<geom type="box" size=".2 .2 .001" euler="4 -6 0" rgba=".5 .5 .5 1"/>'
CONFIG = SensorConfig(speckle_ratio=0.0, gain_spread_ratio=0.0, offset_spread_electrons=0.0)
"""Without speckle and fixed pattern: what differs from picture to picture is noise."""


@pytest.fixture(scope="module")
def pictures(scene):
    """Pictures of the plate by a sensor of these settings."""
    model, data = scene(PLATE)

    def take(config, count=1, exposure=None):
        own = rig(config)
        with LineSensor(config, own.camera, own.fan.plane, own.fan.source_camera, model) as sensor:
            light = sensor.light(data, own.T_base_camera(), exposure=exposure)
            return np.array([sensor.picture(light, np.random.default_rng(k), exposure) for k in range(count)])

    return take


def test_12_bits_show_the_same_light_in_steps_of_a_sixteenth(pictures):
    eight, twelve = (pictures(replace(CONFIG, noise=False, bits=bits))[0] for bits in (8, 12))
    assert (eight.dtype, twelve.dtype) == (np.uint8, np.uint16)
    assert 255 < twelve.max() < 4095
    # half a step of each
    np.testing.assert_allclose(twelve * (255 / 4095), eight, atol=0.5 + 0.5 * 255 / 4095 + 1e-4)
    assert len(np.unique(twelve)) > 4 * len(np.unique(eight))


def test_the_stripe_of_12_bits_is_the_one_of_8_bits_and_finer(pictures):
    found = {
        (bits, noise): find_stripe(pictures(replace(CONFIG, noise=noise, bits=bits))[0])
        for bits in (8, 12)
        for noise in (False, True)
    }
    exact = found[12, False]
    assert all(np.array_equal(stripe.u_px, exact.u_px) for stripe in found.values()) and len(exact.u_px) > 1400
    coarse, eight, twelve = (np.std(found[key].v_px - exact.v_px) for key in ((8, False), (8, True), (12, True)))
    assert 0 < coarse < 0.01  # px: 1/12 level^2 on a peak of 90 levels
    assert twelve < eight < 0.03
    sigma_px = np.sqrt(np.mean(found[12, True].sigma_px ** 2))
    assert twelve == pytest.approx(sigma_px, rel=0.12)  # 1440 centres: 2 %, the noise's own estimate 5 %


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_levels_go_with_the_exposure_and_electrons_too(pictures, factor):
    """Variance of a level over its mean is the gain, 1/41: photon noise has as many electrons as levels say."""
    config = replace(CONFIG, bits=12, exposure_ms=factor)
    clean = [pictures(replace(c, noise=False))[0].astype(float) for c in (replace(CONFIG, bits=12), config)]
    np.testing.assert_allclose(clean[1], factor * clean[0], atol=0.5 * (1 + factor) + 1e-3)
    levels = pictures(config, 12) * (255 / 4095)
    mean, variance = levels.mean(axis=0), levels.var(axis=0, ddof=1)
    bright = mean > 15 * factor
    read = 0.5**2 + (255 / 4095) ** 2 / 12
    # some 5000 pixels of 12 pictures: sqrt(2 / 11 / 5000) = 0.6 %
    assert (variance - read)[bright].sum() / mean[bright].sum() == pytest.approx(1 / 41, rel=0.03)


@pytest.mark.parametrize("gain_db", [6.0206, 12.0412])
def test_gain_multiplies_levels_and_noise(pictures, gain_db):
    factor = 10 ** (gain_db / 20)
    config = replace(CONFIG, bits=12, peak_grey=50.0)
    plain, gained = pictures(config, 8), pictures(replace(config, gain_db=gain_db), 8)
    assert gained.max() < 4095
    bright = plain.mean(axis=0) > 200
    assert gained[:, bright].mean() == pytest.approx(factor * plain[:, bright].mean(), rel=1e-3)
    assert gained[:, bright].std(axis=0).mean() == pytest.approx(factor * plain[:, bright].std(axis=0).mean(), rel=0.01)


def test_an_exposure_for_one_picture_is_that_of_a_sensor_set_to_it(pictures):
    """The same numbers in the same order: the bytes are equal."""
    asked = Exposure(exposure_ms=0.4, gain_db=3.0, ambient_grey=7.0)
    of_one = pictures(CONFIG, 1, asked)[0]
    of_all = pictures(replace(CONFIG, exposure_ms=0.4, gain_db=3.0, ambient_grey=7.0))[0]
    np.testing.assert_allclose(of_one.astype(int), of_all, atol=1)  # float32, rounded the other way
    assert np.mean(of_one != of_all) < 1e-3


def test_too_long_an_exposure_saturates_at_white_and_the_stripe_stays_in_place(pictures):
    exact = find_stripe(pictures(replace(CONFIG, noise=False, bits=12))[0])
    for bits, white in ((8, 255), (12, 4095)):
        picture = pictures(replace(CONFIG, bits=bits, exposure_ms=5.0))[0]
        assert picture.max() == white
        stripe = find_stripe(picture)
        common, first, second = np.intersect1d(exact.u_px, stripe.u_px, return_indices=True)
        assert len(common) > 1300
        assert abs(np.mean(stripe.v_px[second] - exact.v_px[first])) < 0.02  # px: clipped evenly to both sides

"""Noise against its laws: variance by mean, contrast, grain, no bias, same seed same bytes."""

import dataclasses

import cv2
import numpy as np
import pytest

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.noise import NoiseModel, expose, noise_model, speckle

DARK = LaserLight(first_row=0, grey=np.zeros((0, 640), np.float32))
QUIET = NoiseModel(electrons_per_grey=41.0, read_noise_grey=0.5, speckle_contrast=0.0, grain_px=0.8)


def flat(grey: float):
    return np.full((480, 640), grey, np.float32)


@pytest.mark.parametrize("grey", [5.3, 18.0, 60.7, 200.0])
def test_variance_grows_with_the_mean_as_photons_do(grey):
    picture = expose(flat(grey), DARK, QUIET, np.random.default_rng(1)).astype(float)
    # 307200 pixels: the mean is known to 0.004 grey levels, the variance to 0.26 % (one sigma)
    assert picture.mean() == pytest.approx(grey, abs=0.02)
    expected = grey / 41.0 + 0.5**2 + 1 / 12  # photons, read noise, quantisation
    assert picture.var() == pytest.approx(expected, rel=0.015)


def test_noise_differs_from_pixel_to_pixel_and_from_picture_to_picture():
    rng = np.random.default_rng(1)
    first, second = (expose(flat(100), DARK, QUIET, rng).astype(float) - 100 for _ in range(2))
    for a, b in ((first, second), (first[:, 1:], first[:, :-1]), (first[1:], first[:-1])):
        assert abs(np.mean(a * b)) / first.var() < 0.01  # five sigma of 307200 products


@pytest.mark.parametrize("contrast", [0.1, 0.45, 0.6])
def test_speckle_has_mean_one_and_the_contrast_asked_for(contrast):
    factors = speckle((1000, 1000), contrast, 0.8, np.random.default_rng(2))
    assert factors.min() >= 0
    assert factors.mean() == pytest.approx(1, abs=0.005)  # Wilson-Hilferty, and 5e5 independent grains
    assert factors.std() == pytest.approx(contrast, rel=0.015)
    skewness = np.mean((factors - 1) ** 3) / factors.std() ** 3
    assert skewness == pytest.approx(2 * contrast, rel=0.05)  # gamma distribution


def test_speckle_grain_is_correlated_as_asked():
    factors = speckle((1000, 1000), 0.3, 0.8, np.random.default_rng(3)) - 1
    for distance in (1, 2):
        correlation = np.mean(factors[distance:] * factors[:-distance]) / factors.var()
        assert correlation == pytest.approx(np.exp(-(distance**2) / (2 * 0.8**2)), abs=0.02)


def test_only_the_lasers_light_has_speckle():
    laser = LaserLight(first_row=100, grey=np.full((50, 640), 80, np.float32))
    noise = dataclasses.replace(QUIET, speckle_contrast=0.3)
    picture = expose(flat(40), laser, noise, np.random.default_rng(4)).astype(float)
    assert picture[100:150].std() == pytest.approx(24, rel=0.05)
    assert picture[:100].std() < 1.3 and picture[150:].std() < 1.3
    assert picture[100:150].mean() == pytest.approx(120, abs=0.7)


def test_speckle_moves_the_stripe_centre_as_much_as_published():
    """Baribeau and Rioux (Applied Optics 30, 1991): sigma_z = C lambda / (2 pi sin u sin theta), here in pixels.

    A Gaussian stripe and a grey centroid; the formula is for the lens alone, so a half to one and a half is agreement.
    """
    config = SensorConfig()
    rows = np.arange(-8, 9)
    light = np.exp(-0.5 * (rows / 0.81) ** 2)[:, None]
    lit = light * speckle((17, 20000), config.speckle_contrast, noise_model(config).grain_px, np.random.default_rng(5))
    sigma_px = (rows @ lit / lit.sum(axis=0)).std()
    sin_u = (config.focal_mm / config.f_number / 2) / config.working_distance_mm
    sigma_z_mm = config.speckle_contrast * 0.658e-3 / (2 * np.pi * sin_u * np.sin(np.pi / 4))
    published_px = sigma_z_mm * np.sin(np.pi / 4) * (config.focal_mm / 0.00345) / config.working_distance_mm
    assert 0.5 < sigma_px / published_px < 1.5


def test_without_noise_the_picture_is_only_rounded():
    ramp = np.linspace(-3, 260, 480 * 640, dtype=np.float32).reshape(480, 640)
    picture = expose(ramp, DARK, None, np.random.default_rng(0))
    np.testing.assert_array_equal(picture, np.clip(np.rint(ramp), 0, 255).astype(np.uint8))


def test_same_seed_same_bytes_whatever_opencv_did_before():
    laser = LaserLight(first_row=7, grey=np.full((30, 640), 80, np.float32))
    noise = dataclasses.replace(QUIET, speckle_contrast=0.4)

    def take(seed):
        return expose(flat(20), laser, noise, np.random.default_rng(seed)).tobytes()

    first, threads = take(6), cv2.getNumThreads()
    cv2.randn(np.empty((3, 3), np.float32), 0, 1)
    cv2.setNumThreads(1)
    try:
        assert take(6) == first
    finally:
        cv2.setNumThreads(threads)
    assert take(7) != first


def test_the_ambient_picture_is_left_as_it_was():
    ambient = flat(20)
    expose(ambient, LaserLight(first_row=0, grey=flat(50)), QUIET, np.random.default_rng(0))
    assert (ambient == 20).all()


@pytest.mark.parametrize("field", ["electrons_per_grey", "read_noise_grey", "speckle_contrast", "grain_px"])
@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
def test_noise_that_is_none_is_refused(field, value):
    with pytest.raises(BadInput, match=f"noise: {field}"):
        dataclasses.replace(QUIET, **{field: value})


def test_no_noise_is_no_model():
    assert noise_model(SensorConfig(noise=False)) is None

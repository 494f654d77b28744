"""Predicted scatter of stripe centres against what the extractor finds in pictures."""

import dataclasses

import numpy as np
import pytest

from weldcell.cell.configuration import SensorConfig
from weldcell.sensor_sim.centre_noise import CentreSigma, centre_noise
from weldcell.sensor_sim.chip import camera_chip, expose
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.speckle import nominal_speckle, with_speckle
from weldcell.tracking.stripe import find_stripe

WIDTH, HEIGHT = 1440, 120


def sensor(contrast, **settings):
    config = SensorConfig(height_px=HEIGHT, width_px=WIDTH, **settings)
    speckle = dataclasses.replace(nominal_speckle(config), contrast=contrast)
    return camera_chip(config), speckle, centre_noise(camera_chip(config), speckle)


def errors_in_pictures(chip, speckle, amplitude, sigma_px, ambient=15.0, pictures=5):
    """Error of the centre in each picture and column (NaN where none was found)."""
    columns, rows = np.arange(WIDTH), np.arange(20, 100)
    centre = 55 + 0.013 * columns
    grey = amplitude * np.exp(-0.5 * ((rows[:, None] - centre) / sigma_px) ** 2)
    light = LaserLight(first_row=20, grey=grey.astype(np.float32))
    errors = np.full((pictures, WIDTH), np.nan)
    for picture in range(pictures):
        rng = np.random.default_rng(picture)
        lit = with_speckle(light, speckle, rng)
        stripe = find_stripe(expose(np.full((HEIGHT, WIDTH), ambient, np.float32), lit, chip, rng))
        errors[picture, stripe.u_px.astype(int)] = stripe.v_px - centre[stripe.u_px.astype(int)]
    return errors


@pytest.mark.parametrize(
    ("contrast", "amplitude", "sigma_px", "settings"),
    [
        (0.0, 150.0, 0.9, {}),
        (0.0, 60.0, 1.5, {"bits": 12}),
        (0.0, 40.0, 3.0, {"read_noise_grey": 1.5, "gain_db": 6.0, "exposure_ms": 0.5}),
        (0.3, 60.0, 1.2, {}),
        (0.6, 40.0, 0.9, {}),
        (0.6, 60.0, 1.5, {"laser_line_um": 420.0}),
        (0.6, 50.0, 3.0, {}),
    ],
)
def test_centres_scatter_in_pictures_as_predicted(contrast, amplitude, sigma_px, settings):
    chip, speckle, model = sensor(contrast, **settings)
    errors = errors_in_pictures(chip, speckle, amplitude, sigma_px)
    predicted = model.sigma(np.array([amplitude]), np.array([sigma_px]), np.array([15.0]))
    assert np.nanstd(errors) == pytest.approx(predicted.total_px[0], rel=0.1)  # 7000 centres: 1 to 2 %


def test_neighbouring_centres_are_correlated_as_in_pictures():
    chip, speckle, model = sensor(0.4)
    errors = errors_in_pictures(chip, speckle, 120.0, 1.0)
    sigma = model.sigma(np.full(WIDTH, 120.0), np.full(WIDTH, 1.0), np.full(WIDTH, 15.0))
    drawn = np.array([model.draw_px(np.arange(WIDTH), sigma, np.random.default_rng(seed)) for seed in range(5)])
    assert drawn.std() == pytest.approx(sigma.total_px[0], rel=0.03)
    for lag in (1, 2, 5):
        found = np.nanmean(errors[:, lag:] * errors[:, :-lag]) / np.nanvar(errors)
        assert np.mean(drawn[:, lag:] * drawn[:, :-lag]) / drawn.var() == pytest.approx(found, abs=0.06)


def test_centres_of_one_column_have_speckle_of_their_own():
    _, _, model = sensor(0.4)
    columns = np.tile(np.arange(WIDTH), 2)
    only_speckle = CentreSigma(noise_px=np.zeros(2 * WIDTH), speckle_px=np.ones(2 * WIDTH))
    upper, lower = model.draw_px(columns, only_speckle, np.random.default_rng(1)).reshape(2, WIDTH)
    assert abs(np.corrcoef(upper, lower)[0, 1]) < 0.15  # 700 independent grains: four sigma
    turned = model.draw_px(
        np.arange(WIDTH)[::-1],
        CentreSigma(noise_px=np.zeros(WIDTH), speckle_px=np.ones(WIDTH)),
        np.random.default_rng(1),
    )
    assert np.corrcoef(turned[1:], turned[:-1])[0, 1] > 0.3


def test_noise_falls_with_light_and_speckle_does_not():
    _, _, model = sensor(0.5)
    dim, bright = (model.sigma(np.array([a]), np.array([1.2]), np.array([10.0])) for a in (20.0, 200.0))
    assert bright.noise_px < dim.noise_px / 3
    assert bright.speckle_px == pytest.approx(dim.speckle_px, rel=0.1)
    rough = model.sigma(np.array([200.0]), np.array([1.2]), np.array([10.0]), np.array([0.25]))
    assert rough.speckle_px == pytest.approx(bright.speckle_px / 2 * (1 + 0.3 / 16) / (1 + 0.3 / 4), rel=0.02)


def test_without_noise_only_rounding_is_left():
    config = SensorConfig(noise=False)
    model = centre_noise(camera_chip(config), nominal_speckle(config))
    sigma = model.sigma(np.array([100.0]), np.array([1.2]), np.array([10.0]))
    assert sigma.speckle_px == 0
    assert 0 < sigma.noise_px < 0.005


def test_no_centres_no_errors():
    _, _, model = sensor(0.4)
    none = np.zeros(0)
    assert model.draw_px(np.zeros(0, np.int64), model.sigma(none, none, none), np.random.default_rng(0)).size == 0

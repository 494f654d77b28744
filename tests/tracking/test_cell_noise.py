"""The noise of a picture's cells, told by themselves."""

import numpy as np
import pytest

from weldcell.tracking.cell_noise import cell_noise


@pytest.mark.parametrize("seed", range(3))
def test_the_noise_grows_with_the_level_as_it_was_made_whatever_slope_the_light_has(seed):
    rng = np.random.default_rng(seed)
    level = np.linspace(20, 200, 300)[:, None] + np.linspace(0, 40, 400)
    picture = np.clip(np.rint(rng.normal(level, np.sqrt(1.0 + 0.02 * level))), 0, 255).astype(np.uint8)
    model = cell_noise(picture).model()
    at = np.array([30.0, 100.0, 200.0])
    # Some 900 differences in each of eight classes of level tell a deviation to 3 %; trimming takes 2 to 5 %.
    np.testing.assert_allclose(model.sigma(at), np.sqrt(1.0 + 0.02 * at + 1 / 12), rtol=0.12)


@pytest.mark.parametrize("sigma_grey", [0.5, 3.0, 20.0])
def test_a_stripe_and_an_edge_do_not_count_as_noise(sigma_grey):
    rng = np.random.default_rng(1)
    picture = 60 + sigma_grey * rng.standard_normal((270, 720))
    picture[100:] += 40
    picture[150:152] += 120
    noise = cell_noise(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
    # 2600 differences tell a deviation to 1.4 %; rounding adds 1/12, and trimming takes 2 to 5 %.
    assert noise.sigma() == pytest.approx(np.sqrt(sigma_grey**2 + 1 / 12), rel=0.1)


def test_a_picture_without_noise_has_none_and_the_model_keeps_that_of_rounding():
    noise = cell_noise(np.full((270, 720), 7, np.uint8))
    assert noise.sigma() == 0
    assert noise.model().sigma(np.array([0.0, 200.0])) == pytest.approx(1 / np.sqrt(12))

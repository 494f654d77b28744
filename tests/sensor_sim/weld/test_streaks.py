"""Streaks hold exactly their light, whatever their length and direction."""

import numpy as np
import pytest

from weldcell.sensor_sim.weld.streaks import Streaks, draw_streaks


def streak(start, stop, sigma_px=1.4, light=1e5) -> Streaks:
    return Streaks(
        start_px=np.array([start], float),
        stop_px=np.array([stop], float),
        sigma_px=np.array([sigma_px]),
        light_grey=np.array([light]),
    )


def drawn(streaks: Streaks, shape=(240, 320)) -> np.ndarray:
    picture = np.zeros(shape, np.float32)
    draw_streaks(picture, streaks)
    return picture


@pytest.mark.parametrize("length_px", [0.0, 0.3, 5.0, 40.0, 180.0])
@pytest.mark.parametrize("angle_deg", [0, 17, 45, 73, 90, 200])
def test_the_light_of_a_streak_does_not_depend_on_its_length_and_direction(length_px, angle_deg):
    half = length_px / 2 * np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    middle = np.array([160.3, 120.8])
    picture = drawn(streak(middle - half, middle + half))
    assert picture.sum(dtype=float) == pytest.approx(1e5, rel=5e-4)  # cut at 4 sigma: 6e-5 across, and at the ends
    rows, columns = np.indices(picture.shape)
    centre = np.array([(columns * picture).sum(dtype=float), (rows * picture).sum(dtype=float)]) / picture.sum()
    np.testing.assert_allclose(centre, middle, atol=2e-3)  # px


@pytest.mark.parametrize("stop", [(60.0, 47.0), (42.0, 80.0), (30.4, 41.0)])
def test_a_streak_is_the_sum_of_the_spots_along_it(stop):
    start, sigma_px = np.array([40.2, 40.7]), 1.7
    rows, columns = np.indices((120, 120))
    expected = np.zeros((120, 120))
    for share in (np.arange(400) + 0.5) / 400:
        u, v = start + share * (np.array(stop) - start)
        expected += np.exp(-0.5 * ((columns - u) ** 2 + (rows - v) ** 2) / sigma_px**2)
    expected *= 1e5 / 400 / (2 * np.pi * sigma_px**2)
    picture = drawn(streak(start, stop, sigma_px), (120, 120))
    np.testing.assert_allclose(picture, expected, atol=1e-3 * expected.max())  # cut at 4 sigma: 3e-4


def test_what_lies_beyond_the_border_is_cut_off():
    inside, whole = drawn(streak((-30, 20), (60, 80)), (100, 100)), drawn(streak((20, 70), (110, 130)), (200, 200))
    np.testing.assert_allclose(inside, whole[50:150, 50:150], atol=1e-3)


def test_streaks_add_up_and_faint_ones_are_left_out():
    a, b = streak((20, 20), (90, 40)), streak((30, 90), (35, 20), 4.0)
    both = Streaks(**{name: np.concatenate([getattr(a, name), getattr(b, name)]) for name in vars(a)})
    np.testing.assert_allclose(drawn(both), drawn(a) + drawn(b), atol=1e-2)
    assert not drawn(streak((20, 20), (90, 40), light=10.0)).any()

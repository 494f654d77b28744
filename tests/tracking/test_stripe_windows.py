"""The light under weights about the stripe's centre: against sums written out in double precision."""

import numpy as np
import pytest

from weldcell.tracking.stripe_pieces import in_long_pieces
from weldcell.tracking.stripe_windows import Windows, flat_light, gaussian_light

HALF, COUNT = 14, 50
RELATIVE = 1e-4  # single precision, 30 rows of offsets squared up to 200


@pytest.fixture(params=range(3))
def case(request) -> tuple[Windows, np.ndarray, np.ndarray]:
    """Windows about a stripe, and the centre and variance of a weight in each column."""
    rng = np.random.default_rng(request.param)
    offset = np.arange(-HALF, HALF + 1)[:, None]
    centre, variance = rng.uniform(-2, 2, COUNT), rng.uniform(1, 6, COUNT)
    signal = 100 * np.exp(-((offset - centre) ** 2) / 2 / variance) + rng.normal(0, 2, (len(offset), COUNT))
    windows = Windows(
        height_px=400,
        row=np.full(COUNT, 200, np.float32),
        powers=np.stack([offset[:, 0] ** n for n in range(3)]).astype(np.float32),
        signal=signal.astype(np.float32),
        noise_grey=np.full(COUNT, 2, np.float32),
        background_step=np.zeros(COUNT, np.float32),
        background_apart_px=40.0,
    )
    about = (centre + rng.uniform(-0.5, 0.5, COUNT)).astype(np.float32)
    return windows, about, variance.astype(np.float32)


def _offset_and_gaussian(windows: Windows, about: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.arange(-HALF, HALF + 1)[:, None] - about.astype(float)
    return x, np.exp(-(x**2) / 2 / variance.astype(float))


def _agree(found: np.ndarray, expected: np.ndarray) -> None:
    terms = expected.sum(axis=0)
    np.testing.assert_allclose(found, terms, rtol=RELATIVE, atol=RELATIVE * np.abs(expected).sum(axis=0).max())


def test_sums_under_a_flat_weight_are_what_they_say(case):
    windows, about, variance = case
    x, g = _offset_and_gaussian(windows, about, variance)
    w, light = g / (0.03 + g), windows.signal.astype(float)
    found = flat_light(windows, about, variance, np.full(COUNT, 0.03, np.float32))
    _agree(found.total, w * light)
    _agree(found.shift, x * w * light)
    _agree(found.second, x**2 * w * light)
    _agree(found.ww, w**2)
    _agree(found.wg, w * g)
    _agree(found.second_w, x**2 * w)
    _agree(found.second_ww, x**2 * w**2)
    _agree(found.second_wwi, x**2 * w**2 * light)
    _agree(found.second_wwii, x**2 * w**2 * light**2)


def test_sums_under_a_gaussian_are_what_they_say(case):
    windows, about, variance = case
    x, g = _offset_and_gaussian(windows, about, variance)
    light = windows.signal.astype(float)
    found = gaussian_light(windows, about, variance)
    _agree(found.total, g * light)
    _agree(found.shift, x * g * light)
    _agree(found.second, x**2 * g * light)
    _agree(found.ww, g**2)
    _agree(found.second_ww, x**2 * g**2)
    _agree(found.second_wwii, x**2 * g**2 * light**2)


def test_a_piece_is_long_with_so_many_places_between_its_breaks():
    broken = np.array([0, 0, 1, 0, 1, 1, 0, 0, 0], bool)  # pieces of 3, 2, 1 and 4 places
    assert in_long_pieces(broken, 3).tolist() == [True] * 3 + [False] * 3 + [True] * 4
    assert in_long_pieces(np.zeros(0, bool), 1).tolist() == [True]
    assert in_long_pieces(np.zeros(0, bool), 2).tolist() == [False]

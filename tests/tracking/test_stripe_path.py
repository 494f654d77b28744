"""The best path through a picture, and what it is made from."""

from itertools import product

import numpy as np
import pytest

from tracking.line_pictures import noisy_line
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.stripe_path import best_states, over_slopes


@pytest.mark.parametrize("count", [1, 2, 3, 6])
@pytest.mark.parametrize("seed", range(3))
def test_the_best_states_are_those_of_trying_all(count, seed):
    rng = np.random.default_rng(seed)
    worth, costs = rng.normal(size=(count, 3)), rng.normal(size=(count - 1, 3, 3))

    def total(states):
        return sum(worth[k, s] for k, s in enumerate(states)) - sum(
            costs[k, a, b] for k, (a, b) in enumerate(zip(states[:-1], states[1:], strict=True))
        )

    best = max(product(range(3), repeat=count), key=total)
    assert best_states(worth, costs).tolist() == list(best)


def test_nothing_stands_out_of_a_slope_or_of_an_edge():
    slope = np.repeat(np.arange(0, 240, 4, dtype=np.uint8)[:, None], 30, axis=1)
    assert over_slopes(slope)[6:-6].max() <= 1  # rounding
    edge = np.where(np.arange(60)[:, None] < 30, 200, 20).astype(np.uint8).repeat(30, axis=1)
    assert over_slopes(edge).max() == 0


def test_a_line_stands_out_of_a_slope_as_of_a_level():
    slope = np.repeat(np.arange(0, 240, 4, dtype=np.uint8)[:, None], 30, axis=1)
    slope[30] += 50
    assert np.all(over_slopes(slope)[30] >= 49)


def _glaring(centre_px, rng, height_px=480):
    """A dim stripe below glare like an arc's, and a wedge below it that is brighter than the stripe, and as thin."""
    rows, columns = np.arange(height_px)[:, None], np.arange(len(centre_px))
    glare = 230 * np.exp(-rows / 120.0) + 10
    wedge = 90.0 * (np.abs(rows - 300 - 1.2 * (columns - 200)) < 2) * ((columns > 200) & (columns < 250))
    light = noisy_line(centre_px, height_px=height_px, peak_grey=18.0, sigma_px=1.2, background=0.0, rng=rng)
    noise = np.sqrt(0.8 + 0.03 * glare) * rng.standard_normal((height_px, len(columns)))
    return np.clip(np.rint(glare + wedge + light + noise), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(4))
def test_a_dim_stripe_is_followed_past_glare_and_brighter_edges(seed):
    centre_px = 190 + 25 * np.sin(np.arange(700) / 150)
    stripe = find_stripe(_glaring(centre_px, np.random.default_rng(seed)))
    error_px = np.abs(stripe.v_px - centre_px[stripe.u_px.astype(int)])
    assert len(error_px) > 600
    assert np.mean(error_px > 4 * np.maximum(stripe.sigma_px, 0.2)) < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_there_is_no_path_through_glare_alone(seed):
    stripe = find_stripe(_glaring(np.full(700, -50.0), np.random.default_rng(seed)))
    off_wedge = np.abs(stripe.v_px - 300 - 1.2 * (stripe.u_px - 200)) > 6
    assert not off_wedge.any()


@pytest.mark.parametrize("seed", range(3))
def test_an_arc_is_followed_to_its_steep_ends(seed):
    """As on a sphere: the path's sums of level columns end sooner than the light does."""
    rng = np.random.default_rng(seed)
    columns, rows = np.arange(700), np.arange(400)[:, None]
    lit = np.abs(columns - 350) <= 200
    centre_px = 320 - 1.2 * np.sqrt(np.maximum(210**2 - (columns - 350.0) ** 2, 0))
    light = 70 * np.exp(-0.5 * ((rows - centre_px) / 1.2) ** 2) * lit
    picture = np.clip(np.rint(light + 8 + 1.5 * rng.standard_normal(light.shape)), 0, 255).astype(np.uint8)
    stripe = find_stripe(picture)
    assert stripe.u_px.min() <= 154
    assert stripe.u_px.max() >= 546
    on_arc = lit[stripe.u_px.astype(int)]
    assert on_arc.sum() > 390
    assert np.abs(stripe.v_px - centre_px[stripe.u_px.astype(int)])[on_arc].max() < 1.0

"""What is too faint to stand out in its own column, but lies where the stripe beside it leads."""

import numpy as np
import pytest

from tracking.line_pictures import noisy_line
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.stripe_faint import path_at

SPECKLED = {"sigma_px": 0.9, "peak_grey": 150.0, "read_grey": 20.0}
"""A stripe as thin and a noise as strong as in the hardest pictures of the detectors' benchmark."""


def _picture(rng, centre_px, dark=slice(0, 0)):
    speckle = np.repeat(rng.gamma(2, 0.5, (1, len(centre_px))), 300, axis=0)  # contrast 0.7 from column to column
    speckle[:, dark] = 0
    return noisy_line(centre_px, speckle=speckle, rng=rng, **SPECKLED)


def _centre_px(columns=1000):
    return 140 + 15 * np.sin(np.arange(columns) / 90)


@pytest.mark.parametrize("seed", range(3))
def test_most_columns_of_a_noisy_speckled_stripe_are_found_and_lie_on_it(seed):
    centre_px = _centre_px()
    stripe = find_stripe(_picture(np.random.default_rng(seed), centre_px))
    error_px = stripe.v_px - centre_px[stripe.u_px.astype(int)]
    # Of gamma-distributed light of this contrast, half the peak that clear columns need leaves 3 of 4 columns.
    assert len(error_px) > 650
    assert np.mean(np.abs(error_px) > 1.5) < 0.01
    assert np.median(np.abs(error_px / stripe.sigma_px)) < 0.75  # 0.67 of normal errors; sigma may be on the safe side


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_invented_where_the_stripe_is_dark(seed):
    dark = slice(480, 540)
    stripe = find_stripe(_picture(np.random.default_rng(seed), _centre_px(), dark))
    inside = (stripe.u_px >= dark.start) & (stripe.u_px < dark.stop)
    assert inside.sum() <= 1  # within 12 columns of either end noise of 4 sigma may lie on the path once in a while


def test_noise_alone_has_no_faint_stripe():
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(20, 20, (600, 800)).clip(0, 255).astype(np.uint8)
        assert len(find_stripe(noise).u_px) == 0


def test_a_path_is_interpolated_where_its_ends_join_and_else_the_nearer_one():
    known, places = np.array([10, 20, 30]), np.array([100.0, 110.0, 200.0], np.float32)
    path = path_at(np.array([0, 15, 24, 26, 60]), known, places, reach=12)
    # 10 columns rise by 10 px: joined. From 20 to 30 it is a step of 90 px: no stripe of slope 3 goes there.
    assert path.at.tolist() == [100.0, 105.0, 110.0, 200.0, 200.0]
    assert path.near.tolist() == [True, True, True, True, False]

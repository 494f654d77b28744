"""Where a stripe ends: from the light that blur leaves in its last columns, through speckle; the columns of a step."""

import numpy as np
import pytest
from scipy.special import ndtr

from tracking.line_pictures import line_shape
from weldcell.tracking.curve_end import curve_end
from weldcell.tracking.curves import line_curve
from weldcell.tracking.section import Section
from weldcell.tracking.stripe import find_stripe

COLUMN_M = 8e-5
NOISE_M = 2e-5
SPECKLE = 0.5  # standard deviation of the light's logarithm
FAINTEST = 0.05  # of the stripe's light
BLUR = 0.7  # columns


def _ended(edge, rng, *, blur=BLUR, below=True, lit=True):
    """A plate of 100 columns up to `edge` (columns), then another surface 8 mm below it, or nothing."""
    column = np.arange(130)
    speckle = np.exp(SPECKLE * rng.normal(size=130))
    share = ndtr((edge - column) / blur) if blur else (column < edge) * 1.0
    plate, other = 100 * share * speckle, 60 * (1 - share) * speckle * below
    on = plate > other
    light = np.maximum(plate, other)
    seen = light > 100 * FAINTEST
    z = np.where(on, 0.2, 0.208) + NOISE_M * rng.normal(size=130)
    return Section(
        x_m=column[seen] * COLUMN_M,
        z_m=z[seen],
        sigma_m=np.full(seen.sum(), NOISE_M),
        noise_slope=np.zeros(seen.sum()),
        amplitude_grey=light[seen] if lit else np.full(seen.sum(), np.nan),
    )


def _errors(seed, count=150, **how):
    rng = np.random.default_rng(seed)
    errors, sigmas = [], []
    for edge in rng.uniform(90, 100, count):
        end = curve_end(_ended(edge, rng, **how), line_curve(0.0, 0.2), 30 * COLUMN_M, 125 * COLUMN_M)
        errors.append(end.corner.x_m / COLUMN_M - edge)
        sigmas.append(end.corner.sigma_m / COLUMN_M)
    return np.array(errors), np.array(sigmas)


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_end_is_where_the_light_is_a_half_and_not_where_the_last_column_is_seen(seed, below):
    errors, sigmas = _errors(seed, below=below)
    assert abs(np.median(errors)) < 0.15  # columns; the last one that is seen lies 0.8 beyond on average if all is dark
    assert np.std(errors) < 0.6
    # columns; a sharp end tells more than the model dares to say, for a column beside it may be lost
    assert 0.4 < np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(sigmas))) < 1.1


def test_light_without_any_blur_ends_within_half_a_column_of_its_last():
    errors, _ = _errors(3, blur=0.0)
    assert abs(np.median(errors)) < 0.3
    assert np.abs(errors).max() < 1.2  # columns


def test_an_end_of_unknown_light_is_midway_between_two_columns():
    rng = np.random.default_rng(4)
    section = _ended(95.2, rng, blur=0.0, lit=False)
    end = curve_end(section, line_curve(0.0, 0.2), 30 * COLUMN_M, 125 * COLUMN_M)
    # 95.2 lies between the columns 95 and 96; columns: a run of strays just before 95 stays possible
    assert end.corner.x_m / COLUMN_M == pytest.approx(95.5, abs=0.1)
    assert end.corner.sigma_m / COLUMN_M == pytest.approx(np.sqrt(1 / 12), rel=0.6)


def test_a_brighter_last_column_puts_the_end_further_out():
    ends = []
    for share in (0.1, 0.3, 0.6, 1.0):
        section = _ended(95.0, np.random.default_rng(5))
        last = np.flatnonzero(section.z_m < 0.204)[-1]
        section.amplitude_grey[last] = 100 * share
        ends.append(curve_end(section, line_curve(0.0, 0.2), 30 * COLUMN_M, 125 * COLUMN_M).corner.x_m)
    assert np.all(np.diff(ends) > 0)


def test_a_stripe_tells_its_height():
    rng = np.random.default_rng(6)
    peak = np.linspace(40, 180, 300)
    grey = 15 + peak * line_shape(150 + 0.1 * np.sin(np.arange(300)), 2.0, 300) + rng.normal(0, 1, (300, 300))
    stripe = find_stripe(np.rint(np.clip(grey, 0, 255)).astype(np.uint8))
    error = stripe.amplitude_grey / peak[stripe.u_px.astype(int)] - 1
    assert abs(np.median(error)) < 0.03
    assert np.std(error) < 0.06


@pytest.mark.parametrize("edge_px", [150, 151, 152, 153])
def test_both_columns_of_a_pair_that_a_step_parts_are_found(edge_px):
    rows = np.where(np.arange(300) < edge_px, 100.3, 190.6)
    grey = 15 + 120 * line_shape(rows, 1.3, 300) + np.random.default_rng(7).normal(0, 1, (300, 300))
    stripe = find_stripe(np.rint(np.clip(grey, 0, 255)).astype(np.uint8))
    beside = np.abs(stripe.u_px - edge_px + 0.5) < 4
    assert np.array_equal(stripe.u_px[beside], np.arange(edge_px - 4, edge_px + 4))
    assert np.abs(stripe.v_px[beside] - rows[edge_px - 4 : edge_px + 4]).max() < 0.5  # px


@pytest.mark.parametrize("seed", range(1, 4))
def test_ends_that_are_left_out_as_unlikely_change_nothing(seed, monkeypatch):
    section = _ended(100.3, np.random.default_rng(seed))
    some = curve_end(section, line_curve(0.0, 0.2), 30 * COLUMN_M, 125 * COLUMN_M)
    monkeypatch.setattr("weldcell.tracking.curve_end._NEGLIGIBLE_NATS", np.inf)
    every = curve_end(section, line_curve(0.0, 0.2), 30 * COLUMN_M, 125 * COLUMN_M)
    assert abs(some.corner.x_m - every.corner.x_m) < 1e-6 * every.corner.sigma_m
    assert some.corner.sigma_m == pytest.approx(every.corner.sigma_m, rel=1e-5)
    assert some.nats == pytest.approx(every.nats, abs=1e-3)  # what is left of the blur beyond its reach

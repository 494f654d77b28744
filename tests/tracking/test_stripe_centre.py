"""The stripe's centre: unbiased, as precise as it says, and never invented."""

import numpy as np
import pytest

from tracking.fabricated_profiles import stripe_picture
from weldcell.cell.errors import BadInput
from weldcell.tracking.stripe import find_stripe


def _errors(picture, centre_px):
    stripe = find_stripe(picture)
    return stripe, stripe.v_px - centre_px[stripe.u_px.astype(int)]


@pytest.mark.parametrize("sigma_px", [1.0, 1.5, 2.0, 3.0, 4.0])
def test_noise_free_stripe_is_found_to_the_picture_rounding(sigma_px):
    centre_px = 200 + np.linspace(0, 40, 1440)
    stripe, error_px = _errors(stripe_picture(centre_px, peak_grey=200, sigma_px=sigma_px), centre_px)
    assert len(stripe.u_px) == 1440
    # px; rounding to 8 bits alone scatters the centre by 0.29 / 200 * sqrt(2 sigma / sqrt(pi)) <= 0.003
    assert np.sqrt(np.mean(error_px**2)) < 0.005
    phase = np.floor(np.mod(centre_px, 1) * 8).astype(int)
    by_phase_px = [error_px[phase == k].mean() for k in range(8)]
    assert np.abs(by_phase_px).max() < 0.002  # px, whatever the sub-pixel phase


@pytest.mark.parametrize("background", [18.0, 60.0])
def test_an_even_background_does_not_move_the_centre(background):
    centre_px = 200 + np.linspace(0, 40, 600)
    plain = find_stripe(stripe_picture(centre_px, sigma_px=2.0))
    lit = find_stripe(stripe_picture(centre_px, sigma_px=2.0, background=background))
    assert np.abs(lit.v_px - plain.v_px).max() < 1e-4  # px; float32 sums


def test_a_sloping_background_does_not_move_the_centre():
    centre_px = 200 + np.linspace(0, 40, 600)
    slope = 0.1 * np.arange(400)[:, None]  # grey levels a row: 40 over the picture
    stripe, error_px = _errors(stripe_picture(centre_px, peak_grey=180, background=slope), centre_px)
    assert abs(error_px.mean()) < 0.002 and len(stripe.u_px) == 600  # px


def test_background_edges_are_no_stripe():
    background = np.where(np.arange(600)[:, None] < 250, 18.0, 0.0) + np.where(np.arange(800) < 300, 40.0, 0.0)
    picture = stripe_picture(np.full(800, np.nan), height_px=600, background=background)
    assert len(find_stripe(picture).u_px) == 0


def test_a_background_edge_beside_the_stripe_is_told_in_its_sigma():
    centre_px = np.full(400, 200.0)
    edge = np.where(np.arange(400)[:, None] < 206, 18.0, 0.0)
    stripe, error_px = _errors(stripe_picture(centre_px, peak_grey=100, background=edge), centre_px)
    assert np.abs(error_px).max() < 3 * stripe.sigma_px.min()


@pytest.mark.parametrize(
    ("peak_grey", "sigma_px", "noise_grey", "contrast"),
    [(30, 2, 2.5, 0), (60, 1, 2.5, 0), (120, 4, 0.5, 0), (120, 2, 1, 0.45), (60, 4, 2.5, 0.45), (200, 1, 1, 0.45)],
)
def test_centres_scatter_as_predicted(peak_grey, sigma_px, noise_grey, contrast):
    centre_px = 200 + 60 * np.sin(np.linspace(0, 6, 1440))
    errors_px, variances_px2 = [], []
    for seed in range(4):
        picture = stripe_picture(
            centre_px,
            peak_grey=peak_grey,
            sigma_px=sigma_px,
            background=18,
            noise_grey=noise_grey,
            speckle_contrast=contrast,
            rng=np.random.default_rng(seed),
        )
        stripe, error_px = _errors(picture, centre_px)
        assert len(stripe.u_px) > 1400
        assert abs(error_px.mean()) < 4 * error_px.std() / np.sqrt(1440)  # four standard errors
        errors_px.append(error_px)
        variances_px2.append(stripe.sigma_px**2)
    # 1440 columns fix a standard deviation to 2 %; 15 % is left for the speckle's own shape, and for the roughness of
    # a picture without speckle, of which the part above zero counts as some.
    scatter_px = np.std(np.concatenate(errors_px))
    assert scatter_px == pytest.approx(np.sqrt(np.mean(np.concatenate(variances_px2))), rel=0.15)


def test_speckle_of_contrast_045_costs_a_quarter_of_a_pixel():
    # Centroid of a Gaussian under multiplicative noise: C sqrt(sigma / (4 sqrt(pi))) = 0.239 px for sigma 2.
    centre_px = np.full(1440, 200.0)
    picture = stripe_picture(centre_px, sigma_px=2.0, speckle_contrast=0.45, rng=np.random.default_rng(1))
    _, error_px = _errors(picture, centre_px)
    assert error_px.std() == pytest.approx(0.239, rel=0.15)


def test_a_given_speckle_contrast_is_used():
    centre_px = np.full(300, 200.0)
    picture = stripe_picture(centre_px, sigma_px=2.0)
    smooth, rough = find_stripe(picture, speckle_contrast=0.0), find_stripe(picture, speckle_contrast=0.45)
    # 0.239 px for an endless window; the edge of the window at 2.6 sigma costs a tenth
    assert rough.sigma_px.mean() == pytest.approx(0.239 * 1.1, rel=0.05)
    assert smooth.sigma_px.max() < 0.02


def test_saturated_stripe_keeps_its_centre():
    centre_px = 200 + np.linspace(0, 40, 800)
    _, error_px = _errors(stripe_picture(centre_px, peak_grey=600, sigma_px=2.5), centre_px)
    assert np.sqrt(np.mean(error_px**2)) < 0.02  # px; clipping adds harmonics of the pixel grid


# Eight rows are whole cells of the search, seven are not: the background then comes from other rows, and its noise
# moves the centre by less than its sigma of 0.013.
@pytest.mark.parametrize(("rows", "tolerance_px"), [(8, 1e-3), (7, 0.013)])
def test_the_stripe_moves_with_the_picture(rows, tolerance_px):
    rng = np.random.default_rng(2)
    picture = stripe_picture(100 + np.linspace(0, 20, 300), noise_grey=1, background=18, rng=rng)
    moved = np.roll(picture, rows, axis=0)
    first, second = find_stripe(picture), find_stripe(moved)
    assert np.abs(second.v_px - first.v_px - rows).max() < tolerance_px


def test_a_mirrored_picture_gives_the_mirrored_stripe():
    rng = np.random.default_rng(2)
    picture = stripe_picture(100 + np.linspace(0, 20, 300), noise_grey=1, background=18, rng=rng)
    stripe, mirrored = find_stripe(picture), find_stripe(np.ascontiguousarray(picture[::-1, ::-1]))
    assert np.array_equal(299 - mirrored.u_px[::-1], stripe.u_px)
    # px; one sigma, for where the stripe lies between two cells of the search the background comes from other rows
    assert np.abs(399 - mirrored.v_px[::-1] - stripe.v_px).max() < 0.013


def test_the_strongest_of_two_stripes_is_kept():
    centre_px = np.full(300, 120.0)
    strong = stripe_picture(centre_px, peak_grey=120)
    weak = stripe_picture(centre_px + 150, peak_grey=60)
    stripe = find_stripe(np.maximum(strong, weak))
    assert np.abs(stripe.v_px - 120).max() < 0.01 and len(stripe.u_px) == 300  # px


def test_columns_without_a_stripe_are_left_out():
    centre_px = np.full(600, 200.0)
    centre_px[200:320] = np.nan
    picture = stripe_picture(centre_px, noise_grey=2, background=18, rng=np.random.default_rng(0))
    u_px = find_stripe(picture).u_px
    # The search averages three columns: one more column at an end may be taken or lost.
    assert not np.any((u_px >= 201) & (u_px < 319)) and len(u_px) >= 476


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((1080, 1440), np.uint8),
        np.full((1080, 1440), 255, np.uint8),
        np.random.default_rng(0).normal(18, 2.5, (1080, 1440)).clip(0, 255).astype(np.uint8),
        np.random.default_rng(0).normal(0, 2.5, (1080, 1440)).clip(0, 255).astype(np.uint8),
        np.random.default_rng(0).integers(0, 256, (400, 300)).astype(np.uint8),
        stripe_picture([200.0]),
        np.zeros((1, 1), np.uint8),
        np.full((1, 900), 77, np.uint8),
        np.full((900, 1), 77, np.uint8),
    ],
    ids=["black", "white", "noise", "dark noise", "random", "one column", "one pixel", "one row", "column"],
)
def test_no_points_are_invented(picture):
    assert len(find_stripe(picture).u_px) == 0


def test_spatter_leaves_the_other_columns_alone():
    rng = np.random.default_rng(3)
    centre_px = 300 + np.linspace(0, 40, 900)
    picture = stripe_picture(centre_px, height_px=600, background=18, noise_grey=1, rng=rng)
    for column in rng.choice(900, 270, replace=False):
        row = rng.integers(20, 560)
        picture[row : row + 6, column] = 255
    _, error_px = _errors(picture, centre_px)
    good = np.abs(error_px) < 0.5
    assert good.sum() > 500 and good.mean() > 0.85
    assert np.sqrt(np.mean(error_px[good] ** 2)) < 0.1  # px


@pytest.mark.parametrize("picture", [np.zeros((10, 10), np.float32), np.zeros((10, 10, 3), np.uint8)])
def test_other_than_a_grey_picture_of_8_or_16_bits_is_refused(picture):
    with pytest.raises(BadInput, match="8 or 16 bits"):
        find_stripe(picture)

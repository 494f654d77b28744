"""How precise the stripe's centre is: against the Cramer-Rao bound, and under speckle against a plain centroid."""

import numpy as np
import pytest

from tracking.line_pictures import centre_bound_px, grained_speckle, line_shape, noisy_line
from weldcell.tracking.stripe import find_stripe

NOISE_LEVELS = [  # grey levels; a bright and a dim stripe of a quiet camera, and pictures of noisy ones
    {"peak_grey": 200.0, "read_grey": 0.5, "electrons_per_grey": 41.0},
    {"peak_grey": 60.0, "read_grey": 1.0, "electrons_per_grey": 41.0},
    {"peak_grey": 60.0, "read_grey": 4.0, "electrons_per_grey": 41.0},
    {"peak_grey": 50.0, "read_grey": 2.0, "electrons_per_grey": np.inf},
]


def _centre_px(rng, columns=1440):
    """All sub-pixel phases, many times."""
    return 150 + rng.random() + 40 * np.linspace(0, 1, columns)


def _errors(picture, centre_px):
    stripe = find_stripe(picture)
    return stripe, stripe.v_px - centre_px[stripe.u_px.astype(int)]


def _flat_centroid(light, start_px, half_px):
    """The centroid of a flat window that is centred on itself."""
    rows, centre_px = np.arange(len(light))[:, None], start_px
    for _ in range(30):
        share = np.clip(half_px + 0.5 - np.abs(rows - centre_px), 0, 1) * light  # pixels at its ends count in part
        centre_px = (share * rows).sum(axis=0) / share.sum(axis=0)
    return centre_px


@pytest.mark.parametrize("sigma_px", [1.2, 2.0, 3.5])
@pytest.mark.parametrize("level", NOISE_LEVELS)
def test_without_speckle_the_centre_is_within_13_tenths_of_the_cramer_rao_bound(level, sigma_px):
    rng = np.random.default_rng(1)
    errors_px, bounds_px, predicted_px = [], [], []
    for _ in range(2):
        centre_px = _centre_px(rng)
        stripe, error_px = _errors(noisy_line(centre_px, sigma_px=sigma_px, rng=rng, **level), centre_px)
        assert len(error_px) > 0.995 * len(centre_px)
        errors_px.append(error_px)
        predicted_px.append(stripe.sigma_px)
        bounds_px.append(centre_bound_px(centre_px[::30], sigma_px=sigma_px, **level))
    rms_px, bound_px, sigma_pred_px = (
        np.sqrt(np.mean(np.concatenate(part) ** 2)) for part in (errors_px, bounds_px, predicted_px)
    )
    # 2880 columns fix the ratio to 1.3 %. The variance, too, is within 1.3 times its bound.
    assert rms_px**2 < 1.3 * bound_px**2
    assert sigma_pred_px == pytest.approx(rms_px, rel=0.1)


@pytest.mark.parametrize("sigma_px", [0.8, 1.0, 1.5, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("peak_grey", [40.0, 200.0])
def test_the_sub_pixel_phase_leaves_no_bias(sigma_px, peak_grey):
    rng = np.random.default_rng(2)
    phases_px = np.repeat(np.linspace(-0.5, 0.5, 20, endpoint=False), 72)
    picture = noisy_line(150 + phases_px, peak_grey=peak_grey, sigma_px=sigma_px, rng=rng)
    stripe, error_px = _errors(picture, 150 + phases_px)
    column_phase = phases_px[stripe.u_px.astype(int)]
    bias_px = [error_px[column_phase == phase].mean() for phase in np.unique(phases_px)]
    standard_error_px = np.median(stripe.sigma_px) / np.sqrt(72)
    assert np.max(np.abs(bias_px)) < 0.005 + 3.5 * standard_error_px  # px; the largest of 20 averages
    assert np.sqrt(np.mean(np.square(bias_px))) < 0.004 + 1.3 * standard_error_px


@pytest.mark.parametrize(("contrast", "grain_px"), [(0.5, 0.8), (0.5, 0.3), (0.25, 0.8)])
def test_under_speckle_the_centre_scatters_no_more_than_a_plain_centroid(contrast, grain_px):
    rng = np.random.default_rng(3)
    centre_px = _centre_px(rng, columns=900)
    speckle = grained_speckle((300, 900), contrast, grain_px, rng)
    picture = noisy_line(centre_px, peak_grey=120.0, speckle=speckle, rng=rng)
    stripe, error_px = _errors(picture, centre_px)
    assert len(error_px) == 900
    centroid_px = _flat_centroid(picture - 18.0, centre_px, half_px=2.7 * 2.0)
    assert error_px.std() < 1.03 * (centroid_px - centre_px).std()  # the two differ by 1 % at random
    assert np.sqrt(np.mean(stripe.sigma_px**2)) == pytest.approx(
        error_px.std(), rel=0.12
    )  # also where grains are alike


def test_a_dim_stripe_under_speckle_is_weighed_like_a_noisy_one():
    # 25 grey levels in a noise of 2.5: the camera's noise rules, and a flat window would let in a third more.
    rng = np.random.default_rng(4)
    level = {"peak_grey": 25.0, "sigma_px": 2.0, "read_grey": 2.5}
    centre_px = _centre_px(rng)
    speckle = rng.gamma(100, 1 / 100, (300, 1440))  # contrast 0.1
    _, error_px = _errors(noisy_line(centre_px, speckle=speckle, rng=rng, **level), centre_px)
    bound_px = np.sqrt(np.mean(centre_bound_px(centre_px[::30], **level) ** 2))
    of_speckle_px = 0.1 * np.sqrt(2.0 / (4 * np.sqrt(np.pi)))  # of a centroid in an endless window
    assert error_px.std() < 1.15 * np.hypot(bound_px, of_speckle_px)


@pytest.mark.parametrize("most", [1023, 4095, 65535])
def test_more_bits_give_a_finer_centre(most):
    # Rounding by one part in `most`: without noise the centre's error falls with it.
    centre_px = _centre_px(np.random.default_rng(5))
    level = {"electrons_per_grey": np.inf, "read_grey": 0.0, "rng": np.random.default_rng(0)}
    fine = most / 255
    coarse_px = _errors(noisy_line(centre_px, peak_grey=150.0, background=10.0, **level), centre_px)[1]
    finer = noisy_line(centre_px, peak_grey=150.0 * fine, background=10.0 * fine, most=most, **level)
    finer_px = _errors(finer, centre_px)[1]
    assert finer.dtype == np.uint16 and len(finer_px) == len(centre_px)
    assert np.sqrt(np.mean(finer_px**2)) < max(1.5 / fine * np.sqrt(np.mean(coarse_px**2)), 2e-4)  # px; float32


@pytest.mark.parametrize("factor", [16, 256, 257])
def test_bits_written_into_higher_places_do_not_matter(factor):
    rng = np.random.default_rng(6)
    picture = noisy_line(_centre_px(rng), rng=rng)
    plain, shifted = find_stripe(picture), find_stripe(picture.astype(np.uint16) * np.uint16(factor))
    assert np.array_equal(plain.u_px, shifted.u_px) and np.array_equal(plain.v_px, shifted.v_px)


def test_a_transposed_picture_gives_the_transposed_stripe():
    rng = np.random.default_rng(7)
    picture = noisy_line(_centre_px(rng, columns=601), rng=rng)
    by_rows, by_columns = find_stripe(picture), find_stripe(np.ascontiguousarray(picture.T), along="columns")
    assert len(by_rows.u_px) == 601  # an odd width: the last column counts as well
    assert np.array_equal(by_columns.v_px, by_rows.u_px) and np.array_equal(by_columns.u_px, by_rows.v_px)
    assert np.array_equal(by_columns.sigma_px, by_rows.sigma_px)


@pytest.mark.parametrize("along", ["rows", "columns"])
def test_a_diagonal_stripe_is_found_either_way(along):
    rng = np.random.default_rng(8)
    columns, rows = np.arange(600), np.arange(600)[:, None]
    distance_px = (rows - columns) / np.sqrt(2)  # 45 degrees
    grey = 18 + 120 * np.exp(-(distance_px**2) / 2 / 2.0**2) + rng.normal(0, 1, (600, 600))
    stripe = find_stripe(np.clip(np.rint(grey), 0, 255).astype(np.uint8), along=along)
    assert len(stripe.u_px) > 570  # all but the picture's corners
    assert np.sqrt(np.mean((stripe.v_px - stripe.u_px) ** 2)) < 0.03  # px


def test_a_glow_behind_the_stripe_does_not_move_it():
    # As an arc's: steep enough to change by 1.4 grey levels a row, and noisier where it is bright.
    rng = np.random.default_rng(9)
    centre_px = _centre_px(rng)
    rows, columns = np.arange(300)[:, None], np.arange(1440)
    glow = 150 * np.exp(-((rows - 80) ** 2 + (columns - 700) ** 2) / 2 / 65.0**2)
    _, error_px = _errors(noisy_line(centre_px, peak_grey=90.0, background=10 + glow, rng=rng), centre_px)
    assert len(error_px) > 1430
    assert abs(error_px[600:800].mean()) < 0.02  # px, where the glow is steepest
    assert np.sqrt(np.mean(error_px**2)) < 0.05


# 40 streaks of 40 px, brighter than the stripe, stand in two thirds of the columns.
def test_streaks_of_spatter_take_little_of_the_stripe_and_add_little():
    rng = np.random.default_rng(10)
    centre_px = 350 + 40 * np.linspace(0, 1, 1440)
    grey = noisy_line(centre_px, height_px=700, peak_grey=100.0, rng=rng).astype(float)
    for _ in range(40):
        start, angle, length = rng.uniform((0, 0), (1440, 700)), rng.uniform(0, np.pi), rng.uniform(10, 70)
        along = np.arange(0, length, 0.5)
        u, v = (start[:, None] + along * np.array([[np.cos(angle)], [np.sin(angle)]])).round().astype(int)
        inside = (u > 0) & (u < 1439) & (v > 0) & (v < 699)
        grey[v[inside], u[inside]] = grey[v[inside] + 1, u[inside]] = 255
    _, error_px = _errors(grey.astype(np.uint8), centre_px)
    good = np.abs(error_px) < 0.3  # px
    assert good.sum() > 0.85 * 1440 and (~good).sum() < 0.1 * 1440


def test_a_chessboard_of_squares_is_no_stripe():
    rng = np.random.default_rng(11)
    rows, columns = np.arange(700)[:, None], np.arange(900)
    board = np.where((rows // 60 + columns // 60) % 2 == 0, 190.0, 25.0) + rng.normal(0, 2, (700, 900))
    assert len(find_stripe(board.clip(0, 255).astype(np.uint8)).u_px) == 0


def test_the_shape_of_the_line_is_what_the_bound_assumes():
    # Light is kept: the pixels' sum is the Gaussian's integral.
    assert np.allclose(line_shape([100.3, 99.5], 2.0, 200).sum(axis=0), 2.0 * np.sqrt(2 * np.pi), rtol=1e-9)
    # Closed form for white noise and fine pixels: sqrt(2 sigma / sqrt(pi)) noise / peak.
    level = {"peak_grey": 100.0, "sigma_px": 4.0, "read_grey": 2.0, "electrons_per_grey": np.inf}
    closed_px = np.sqrt(2 * 4.0 / np.sqrt(np.pi)) * np.sqrt(2.0**2 + 1 / 12) / 100
    assert centre_bound_px([150.2], **level)[0] == pytest.approx(closed_px, rel=0.01)

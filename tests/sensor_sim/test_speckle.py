"""Speckle against theory: exact integrals over the Airy pattern, closed forms, and coherent light imaged by FFT."""

import dataclasses

import numpy as np
import pytest
from scipy.special import j1

from weldcell.cell.configuration import SENSOR_PRESETS, SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.speckle import (
    Speckle,
    correlated_normals,
    gamma_factors,
    nominal_speckle,
    pixel_covariance,
    speckle_contrast,
    with_speckle,
)

FINE = Speckle(contrast=0.45, along_px=0.7, across_px=0.8, stripe_along="rows")
MONOCHROME = SensorConfig(laser_linewidth_nm=0.0)
PAINT = np.array(True), np.array(10e-6)


def airy_um(config):
    """lambda times the working f-number c / aperture, by the thin lens."""
    aperture_mm = 1 / (1 / config.focal_mm + 1 / config.working_distance_mm) / config.f_number
    return config.wavelength_nm * 1e-3 * config.focal_mm / aperture_mm


def airy_correlation(distance, airy):
    x = np.pi * distance / airy + 1e-12
    return (2 * j1(x) / x) ** 2


def averaged_airy(lag_px, airy_px, *, across):
    """Covariance of two pixels' averages along a line (and across it), by quadrature."""
    d = np.linspace(-1, 1, 401)
    triangle = (1 - np.abs(d)) * (d[1] - d[0])
    if not across:
        return triangle @ airy_correlation(np.abs(lag_px + d), airy_px)
    return triangle @ airy_correlation(np.hypot(lag_px + d, d[:, None]), airy_px) @ triangle


def with_sheet(config, sheet_px):
    """The sensor with a line whose geometric image has that standard deviation."""
    seen = config.focal_mm / config.working_distance_mm * np.cos(np.deg2rad(config.triangulation_deg))
    return dataclasses.replace(config, laser_line_um=4 * sheet_px * config.pixel_um / seen)


def stripe_sigma_px(sheet_px, airy_px):
    return float(np.sqrt(sheet_px**2 + (0.42 * airy_px) ** 2 + 1 / 12))


def stripe(sigma_px, columns=12000):
    rows = np.arange(-int(6 * sigma_px) - 2, int(6 * sigma_px) + 3)
    profile = np.exp(-0.5 * (rows / sigma_px) ** 2).astype(np.float32)
    return rows, LaserLight(first_row=0, grey=np.repeat(profile[:, None], columns, axis=1))


def centroid_spread(speckle, sigma_px, seed=1):
    rows, light = stripe(sigma_px)
    grey = with_speckle(light, speckle, np.random.default_rng(seed)).grey
    return (rows @ grey / grey.sum(axis=0)).std()


def flat_field(speckle, shape=(600, 1000)):
    """Speckle of even light, its repetitions cut off."""
    blocks = [
        with_speckle(LaserLight(first_row=0, grey=np.ones((60, 1000), np.float32)), speckle, np.random.default_rng(k))
        for k in range(shape[0] // 60)
    ]
    return [block.grey for block in blocks]


@pytest.mark.parametrize("contrast", [0.1, 0.45, 0.6])
def test_speckle_has_mean_one_and_the_contrast_asked_for(contrast):
    field = correlated_normals((1000, 1000), FINE, np.random.default_rng(2))
    factors = gamma_factors(field, np.float32(contrast))
    assert factors.min() >= 0
    assert factors.mean() == pytest.approx(1, abs=0.005)  # Wilson-Hilferty, and 5e5 independent grains
    assert factors.std() == pytest.approx(contrast, rel=0.015)
    skewness = np.mean((factors - 1) ** 3) / factors.std() ** 3
    assert skewness == pytest.approx(2 * contrast, rel=0.05)  # gamma distribution


def test_pixels_average_is_the_integral_of_a_triangle_over_the_correlation():
    d = np.linspace(-1, 1, 20001)
    for grain in (0.1, 0.4, 0.7, 3.0):
        for lag in (0, 1, 2):
            expected = np.trapezoid((1 - np.abs(d)) * np.exp(-((lag + d) ** 2) / (2 * grain**2)), d)
            assert pixel_covariance(np.array(float(lag)), grain) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("f_number", "wavelength_nm"), [(5.6, 658), (8, 450), (8, 658), (16, 658)])
def test_contrast_and_grain_are_those_of_a_round_lens_opening(f_number, wavelength_nm):
    config = dataclasses.replace(MONOCHROME, f_number=f_number, wavelength_nm=wavelength_nm)
    airy_px = airy_um(config) / config.pixel_um
    speckle = nominal_speckle(with_sheet(config, 4 * airy_px))  # a wide line: the same grain along and across
    fields = flat_field(speckle)
    exact = averaged_airy(0, airy_px, across=True)
    assert np.mean([field.std() / field.mean() for field in fields]) == pytest.approx(np.sqrt(exact / 2), rel=0.1)
    lags = np.arange(-4, 5)
    width = sum(averaged_airy(lag, airy_px, across=True) for lag in lags) / exact  # grain: the correlation's sum
    for turned in (False, True):
        correlations = []
        for lag in np.abs(lags):
            pairs = [(f.T if turned else f) - 1 for f in fields]
            products = np.mean([np.mean(p[: len(p) - lag] * p[lag:]) for p in pairs])
            correlations.append(products / np.mean([p.var() for p in pairs]))
        assert sum(correlations) == pytest.approx(width, rel=0.1)


def test_paint_halves_the_squared_contrast_and_a_broad_spectrum_takes_more():
    metal = np.array(False), np.array(10e-6)
    mono = speckle_contrast(MONOCHROME, *PAINT)
    assert speckle_contrast(MONOCHROME, *metal) == pytest.approx(np.sqrt(2) * mono)
    assert speckle_contrast(dataclasses.replace(MONOCHROME, speckle_ratio=0.3), *PAINT) == pytest.approx(0.3 * mono)
    contrasts = [speckle_contrast(dataclasses.replace(MONOCHROME, laser_linewidth_nm=w), *PAINT) for w in (0, 1, 5, 30)]
    assert (np.diff(contrasts) < 0).all()


def test_spectral_factor_is_the_mean_over_pairs_of_wavelengths():
    """C^2 = E |E exp(i dq h)|^2 over pairs of wavelengths and heights: drawn, not integrated."""
    config = dataclasses.replace(MONOCHROME, laser_linewidth_nm=4.0, triangulation_deg=5.0)  # hardly askew
    height_sigma_m = 20e-6
    rng = np.random.default_rng(1)
    wavelengths_nm = 658 + 4 / np.sqrt(8 * np.log(2)) * rng.standard_normal((2, 4000))
    phase_per_m = np.diff(2 * np.pi / (wavelengths_nm * 1e-9), axis=0)[0] * (1 + np.cos(np.deg2rad(5)))
    heights = height_sigma_m * rng.standard_normal(2000)
    expected = np.mean(np.abs(np.exp(1j * phase_per_m[:, None] * heights).mean(axis=1)) ** 2)
    pixel = speckle_contrast(dataclasses.replace(MONOCHROME, triangulation_deg=5.0), *PAINT)
    ratio = speckle_contrast(config, np.array(True), np.array(height_sigma_m)) / pixel
    assert ratio**2 == pytest.approx(expected, rel=0.05)  # 4000 pairs: 2 %


@pytest.mark.parametrize("across_px", [0.6, 1.2, 2.5])
@pytest.mark.parametrize("sigma_px", [1.0, 2.0, 4.0])
def test_centroid_scatters_by_the_closed_form(sigma_px, across_px):
    speckle = dataclasses.replace(FINE, contrast=0.3, across_px=across_px)
    exact = 0.3 * np.sqrt(across_px * sigma_px**4 / (2 * sigma_px**2 + across_px**2) ** 1.5)
    assert centroid_spread(speckle, sigma_px) == pytest.approx(exact, rel=0.05)  # 3 % of 2000 grains, second order
    if sigma_px > 3 * across_px:
        assert exact == pytest.approx(0.3 * np.sqrt(across_px * sigma_px * np.sqrt(2) / 4), rel=0.1)


def coherent_spread(sheet, pixel, seed):
    """Spread of the centroids of pixel-wide columns of a rough line in laser light; lengths in units of lambda N'.

    Two polarisations, each a circular complex normal field on the object, of a Gaussian sheet's brightness, imaged by a
    round pupil.
    """
    step, along, across = 1 / 8, 4096, 256
    rng = np.random.default_rng(seed)
    pupil = np.hypot(np.fft.fftfreq(across, step)[:, None], np.fft.fftfreq(along, step)) <= 0.5
    v = (np.arange(across) - across // 2) * step
    brightness = np.zeros((across, along))
    for _ in range(2):
        field = rng.standard_normal((across, along)) + 1j * rng.standard_normal((across, along))
        field *= np.exp(-((v / sheet) ** 2) / 4)[:, None]
        brightness += np.abs(np.fft.ifft2(np.fft.fft2(field) * pupil)) ** 2
    taken = round(pixel / step)
    columns = brightness[:, : along // taken * taken].reshape(across, -1, taken).mean(axis=2)
    near = np.abs(v) < 5 * np.hypot(sheet, 0.42)  # the Airy pattern's rings go on for ever
    return (v[near] @ columns[near] / columns[near].sum(axis=0)).std()


@pytest.mark.parametrize("sheet", [0.225, 0.61, 1.2])  # p2's own line, one as wide as the Airy disc, a wide one
def test_stripe_centre_scatters_as_in_coherent_light_imaged_through_a_lens(sheet):
    airy_px = 1 / 0.625  # so that a pixel is five steps of the simulation
    config = dataclasses.replace(MONOCHROME, pixel_um=airy_um(MONOCHROME) / airy_px)
    speckle = nominal_speckle(with_sheet(config, sheet * airy_px))
    fast = centroid_spread(speckle, stripe_sigma_px(sheet * airy_px, airy_px))
    slow = np.mean([coherent_spread(sheet, 0.625, seed) for seed in range(3)]) * airy_px
    assert fast == pytest.approx(slow, rel=0.15)  # 2.5 % from 800 independent columns; Airy disc as a Gaussian


DESIGNS = [
    *(
        dataclasses.replace(MONOCHROME, f_number=n, wavelength_nm=w)
        for n, w in ((5.6, 658), (8, 658), (11, 450), (16, 658))
    ),
    *(dataclasses.replace(preset, laser_linewidth_nm=0.0) for preset in SENSOR_PRESETS.values()),
]


@pytest.mark.parametrize("config", DESIGNS)
def test_centre_of_a_line_as_wide_as_the_airy_disc_scatters_as_published(config):
    """Dorsch, Häusler, Herrmann (Applied Optics 33, 1994): sigma_z = C lambda / (2 pi sin u sin theta)."""
    airy_px = airy_um(config) / config.pixel_um
    sheet_px = 2.44 * airy_px / 4  # full width at 1/e^2 = diameter of the Airy disc
    speckle = nominal_speckle(with_sheet(config, sheet_px))
    contrast = np.sqrt(averaged_airy(0, airy_px, across=False) / 2)  # two polarisations, pixels along the line
    aperture_mm = 1 / (1 / config.focal_mm + 1 / config.working_distance_mm) / config.f_number
    sin_u, sin_theta = aperture_mm / 2 / config.working_distance_mm, np.sin(np.deg2rad(config.triangulation_deg))
    sigma_z_mm = contrast * config.wavelength_nm * 1e-6 / (2 * np.pi * sin_u * sin_theta)
    published_px = sigma_z_mm * sin_theta * config.focal_mm * 1e3 / config.pixel_um / config.working_distance_mm
    assert centroid_spread(speckle, stripe_sigma_px(sheet_px, airy_px)) == pytest.approx(published_px, rel=0.15)


def test_centre_of_a_line_that_the_lens_cannot_resolve_stands_nearly_still():
    airy_px = airy_um(MONOCHROME) / MONOCHROME.pixel_um
    spreads = [
        centroid_spread(nominal_speckle(with_sheet(MONOCHROME, sheet_px)), stripe_sigma_px(sheet_px, airy_px))
        for sheet_px in (0.05 * airy_px, 0.2 * airy_px, 0.6 * airy_px)
    ]
    assert spreads[0] < 0.4 * spreads[1] < 0.4 * 0.7 * spreads[2]


def test_stripe_along_columns_has_the_same_speckle_turned():
    _, light = stripe(1.5, columns=500)
    turned = LaserLight(first_row=0, first_column=7, grey=np.ascontiguousarray(light.grey.T))
    upright = dataclasses.replace(FINE, across_px=2.0)
    lying = dataclasses.replace(upright, stripe_along="columns")
    expected = with_speckle(light, upright, np.random.default_rng(3))
    found = with_speckle(turned, lying, np.random.default_rng(3))
    np.testing.assert_array_equal(found.grey.T, expected.grey)
    assert found.first_column == 7


@pytest.mark.parametrize("along", ["rows", "columns"])
def test_contrast_can_differ_from_column_to_column(along):
    light = LaserLight(first_row=0, grey=np.full((150, 900), 80, np.float32))
    contrast = np.where(np.arange(900) < 450, 0.1, 0.5)[None]
    if along == "columns":
        light, contrast = dataclasses.replace(light, grey=light.grey.T.copy()), contrast.T
    speckle = dataclasses.replace(FINE, stripe_along=along)
    grey = with_speckle(light, speckle, np.random.default_rng(4), contrast).grey
    halves = np.split(grey, 2, axis=1 if along == "rows" else 0)
    assert [half.std() / 80 for half in halves] == pytest.approx([0.1, 0.5], rel=0.05)


def test_same_seed_same_speckle_and_the_light_is_left_as_it_was():
    _, light = stripe(1.2, columns=300)
    before = light.grey.copy()
    first, again, other = (with_speckle(light, FINE, np.random.default_rng(seed)).grey for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    np.testing.assert_array_equal(light.grey, before)


def test_no_noise_and_no_light_have_no_speckle():
    _, light = stripe(1.2, columns=50)
    quiet = nominal_speckle(SensorConfig(noise=False))
    assert with_speckle(light, quiet, np.random.default_rng(0)) is light
    dark = LaserLight(first_row=0, grey=np.zeros((0, 50), np.float32))
    assert with_speckle(dark, FINE, np.random.default_rng(0)) is dark


@pytest.mark.parametrize("field", ["contrast", "along_px", "across_px"])
@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
def test_speckle_that_is_none_is_refused(field, value):
    with pytest.raises(BadInput, match=f"speckle: {field}"):
        dataclasses.replace(FINE, **{field: value})

"""The camera chip against its laws: photon transfer, saturation, blooming, fixed pattern, same seed same bytes."""

import dataclasses

import cv2
import numpy as np
import pytest

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import BadInput
from weldcell.sensor_sim.chip import CameraChip, camera_chip, expose, fixed_pattern, spilled
from weldcell.sensor_sim.drawing import LaserLight

HEIGHT, WIDTH = 480, 640
SMALL = SensorConfig(height_px=HEIGHT, width_px=WIDTH)
EVEN = dataclasses.replace(SMALL, gain_spread_ratio=0.0, offset_spread_electrons=0.0)
DARK = LaserLight(first_row=0, grey=np.zeros((0, WIDTH), np.float32))


def flat(grey):
    return np.full((HEIGHT, WIDTH), grey, np.float32)


def frames(chip, grey, count, seed=0):
    rng = np.random.default_rng(seed)
    return np.array([expose(flat(grey), DARK, chip, rng) for _ in range(count)], dtype=float)


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize(("gain_db", "exposure_ms"), [(0.0, 1.0), (6.0, 0.5), (18.0, 0.1)])
def test_photon_transfer_curve_has_the_gain_as_slope_and_the_read_noise_as_intercept(bits, gain_db, exposure_ms):
    """EMVA 1288: with two frames of a flat field, half the difference's variance is K mean + (K read)^2 + 1/12."""
    config = dataclasses.replace(SMALL, bits=bits, gain_db=gain_db, exposure_ms=exposure_ms, read_noise_grey=0.7)
    chip = camera_chip(config)
    means, variances = [], []
    for grey in np.linspace(45, 200, 8):
        first, second = frames(chip, grey, 2, seed=int(grey))
        means.append((first.mean() + second.mean()) / 2)
        variances.append((first - second).var() / 2)
    slope, intercept = np.polyfit(means, variances, 1, w=1 / np.array(variances))
    levels_per_grey = (2**bits - 1) / 255
    gain = 10 ** (gain_db / 20) * levels_per_grey / 41.0
    assert slope == pytest.approx(gain, rel=0.02)  # 0.26 % a variance: 0.4 % of the slope
    expected = (gain * 0.7 * 41.0) ** 2 + 1 / 12
    assert intercept == pytest.approx(expected, rel=0.1)  # what is left of the line at 0: 2 to 3 %
    np.testing.assert_allclose(means, np.linspace(45, 200, 8) * exposure_ms * gain * 41.0, rtol=0.002)


def test_noise_is_normal_and_independent_in_space_and_time():
    first, second = frames(camera_chip(dataclasses.replace(EVEN, bits=12)), 100, 2) - 100 * 4095 / 255
    sigma = first.std()
    assert np.mean((first / sigma) ** 3) == pytest.approx(0, abs=0.02)  # 4.5 sigma of 307200
    assert np.mean((first / sigma) ** 4) == pytest.approx(3, abs=0.04)
    beyond = np.mean(np.abs(np.stack([first, second])) > 4 * sigma)
    assert 2e-5 < beyond < 1.2e-4  # 6.3e-5 of a normal: 39 of 614400 pixels
    pairs = [(first, second), (first[:, 1:], first[:, :-1])]
    pairs += [(first[lag:], first[:-lag]) for lag in (1, 16, 32, 64)]  # the chip is read in strips of rows
    for a, b in pairs:
        assert abs(np.mean(a * b)) / sigma**2 < 0.01  # five sigma of 307200 products


def test_response_differs_by_a_pattern_that_all_pictures_share():
    config = dataclasses.replace(SMALL, bits=12, gain_spread_ratio=0.02, offset_spread_electrons=0.0)
    chip = camera_chip(config)
    pictures = frames(chip, 150, 40)
    mean = pictures.mean(axis=0)
    temporal = pictures.var(axis=0, ddof=1).mean()
    assert np.sqrt(mean.var() - temporal / 40) / mean.mean() == pytest.approx(0.02, rel=0.02)
    again = frames(camera_chip(config), 150, 40, seed=9).mean(axis=0)
    assert np.corrcoef(mean.ravel(), again.ravel())[0, 1] > 0.97
    other = frames(camera_chip(config, seed=1), 150, 40, seed=10).mean(axis=0)
    assert abs(np.corrcoef(mean.ravel(), other.ravel())[0, 1]) < 0.01


def test_pattern_has_nothing_in_common_with_the_noise_of_the_same_seed():
    pattern = camera_chip(SMALL, seed=0).pattern
    for picture in frames(camera_chip(dataclasses.replace(EVEN, bits=12)), 100, 3, seed=0):
        for part in (pattern.response, pattern.offset_electrons):
            assert abs(np.corrcoef(picture.ravel(), part.ravel())[0, 1]) < 0.01  # five sigma of 307200 products


def test_dark_level_differs_by_the_spread_in_electrons():
    chip = camera_chip(dataclasses.replace(SMALL, bits=12, gain_spread_ratio=0.0, offset_spread_electrons=15.0))
    pictures = frames(chip, 10, 40)
    spatial = pictures.mean(axis=0).var() - pictures.var(axis=0, ddof=1).mean() / 40
    assert np.sqrt(spatial) == pytest.approx(15 * chip.levels_per_electron, rel=0.03)


@pytest.mark.parametrize(("bits", "white"), [(8, 255), (12, 4095)])
def test_light_beyond_white_saturates(bits, white):
    chip = camera_chip(dataclasses.replace(SMALL, bits=bits))
    picture = expose(flat(400), DARK, chip, np.random.default_rng(0))
    assert picture.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert (picture == white).all()


def test_full_well_holds_no_more_and_is_read_with_read_noise_alone():
    chip = camera_chip(dataclasses.replace(EVEN, bits=12, full_well_electrons=6000.0))
    levels = frames(chip, 220, 1)[0]
    gain = chip.levels_per_electron
    assert levels.mean() == pytest.approx(6000 * gain, abs=0.1)
    assert levels.var() == pytest.approx((gain * 0.5 * 41) ** 2 + 1 / 12, rel=0.02)
    below = frames(chip, 130, 1)[0]  # 5330 electrons, nine sigma below
    assert below.var() == pytest.approx(gain**2 * (5330 + (0.5 * 41) ** 2) + 1 / 12, rel=0.02)


@pytest.mark.parametrize("ratio", [0.0, 0.4, 1.0])
def test_spilled_charge_goes_up_and_down_and_none_is_made_or_lost(ratio):
    charge = np.full((400, 3), 1000.0)
    charge[195:206, 0] = 60_000.0
    charge[200, 1] = 12_000.0
    charge[100:103, 2] = charge[297:300, 2] = 40_000.0
    held = spilled(charge, 10_000.0, ratio)
    assert held.max() <= 10_000 + 1e-6
    over = np.maximum(charge - 10_000, 0)
    np.testing.assert_allclose(held.sum(axis=0), (charge - over).sum(axis=0) + ratio * over.sum(axis=0))
    np.testing.assert_allclose(held[1:, 0], held[1:, 0][::-1])  # symmetric about row 200
    assert (held >= np.minimum(charge, 10_000) - 1e-9).all()
    if ratio == 1.0:  # 550 000 electrons, 275 000 each way, 9000 for each pixel: 30.6 pixels
        assert (held[:, 0] > 9_999).sum() == 11 + 2 * 30


def test_charge_that_reaches_the_pictures_edge_is_lost():
    charge = np.zeros((50, 1))
    charge[2] = 100_000.0
    held = spilled(charge, 10_000.0, 1.0)
    np.testing.assert_allclose(held[:7, 0], [10_000] * 7)  # 45 000 down: rows 3 to 6 full, half of row 7
    assert held[7, 0] == pytest.approx(5_000)
    assert held.sum() == pytest.approx(75_000)  # 25 000 of the 45 000 that went up found no room


def test_blooming_lengthens_what_is_too_bright_along_the_column():
    laser = LaserLight(first_row=200, first_column=300, grey=np.full((4, 2), 1500, np.float32))
    heights = []
    for ratio in (0.0, 0.5, 1.0):
        chip = camera_chip(dataclasses.replace(EVEN, blooming_ratio=ratio, noise=False))
        picture = expose(flat(20), laser, chip, np.random.default_rng(0))
        assert (np.delete(picture, [300, 301], axis=1) == 20).all()
        heights.append((picture[:, 300] == 255).sum())
    # 51 000 electrons too many in each pixel, 9680 find room in each of the others
    assert heights == [4, 4 + 2 * int(0.5 * 2 * 51_000 / 9_680), 4 + 2 * int(2 * 51_000 / 9_680)]


@pytest.mark.parametrize(("bits", "white"), [(8, 255), (12, 4095)])
def test_without_noise_the_picture_is_only_rounded(bits, white):
    chip = camera_chip(dataclasses.replace(SMALL, bits=bits, noise=False, full_well_electrons=1e6))
    ramp = np.linspace(0, 300, HEIGHT * WIDTH).reshape(HEIGHT, WIDTH)
    picture = expose(ramp.astype(np.float32), DARK, chip, np.random.default_rng(0)).astype(float)
    levels = np.minimum(ramp * white / 255, white)
    assert np.abs(picture - levels).max() < 0.501  # half a level, and float32


def test_both_lights_add_up_wherever_the_lasers_is():
    chip = camera_chip(dataclasses.replace(EVEN, noise=False))
    for first_row, first_column, rows, columns in ((3, 0, 100, WIDTH), (0, 20, HEIGHT, 50), (470, 600, 10, 40)):
        laser = LaserLight(
            first_row=first_row, first_column=first_column, grey=np.full((rows, columns), 70, np.float32)
        )
        picture = expose(flat(20), laser, chip, np.random.default_rng(0)).astype(int)
        expected = np.full((HEIGHT, WIDTH), 20)
        expected[first_row : first_row + rows, first_column : first_column + columns] += 70
        np.testing.assert_array_equal(picture, expected)


def test_exposure_and_gain_scale_the_picture():
    for exposure_ms, gain_db, factor in ((0.5, 0.0, 0.5), (3.0, 0.0, 3.0), (1.0, 20.0, 10.0)):
        chip = camera_chip(dataclasses.replace(EVEN, exposure_ms=exposure_ms, gain_db=gain_db))
        assert frames(chip, 20, 1).mean() == pytest.approx(20 * factor, rel=0.002)


def test_same_seed_same_bytes_whatever_opencv_did_before():
    laser = LaserLight(first_row=7, grey=np.full((30, WIDTH), 80, np.float32))
    chip = camera_chip(SMALL)

    def take(seed):
        return expose(flat(20), laser, chip, np.random.default_rng(seed)).tobytes()

    first, threads = take(6), cv2.getNumThreads()
    cv2.randn(np.empty((3, 3), np.float32), 0, 1)
    cv2.setNumThreads(1)
    try:
        assert take(6) == first
    finally:
        cv2.setNumThreads(threads)
    assert take(7) != first


def test_light_is_left_as_it_was():
    ambient, laser = flat(20), LaserLight(first_row=0, grey=flat(500))
    for chip in (camera_chip(SMALL), camera_chip(dataclasses.replace(SMALL, blooming_ratio=0.5))):
        expose(ambient, laser, chip, np.random.default_rng(0))
        assert (ambient == 20).all() and (laser.grey == 500).all()


def test_a_pattern_of_another_size_is_refused():
    with pytest.raises(BadInput, match="pixels"):
        expose(np.zeros((10, 10), np.float32), DARK, camera_chip(SMALL), np.random.default_rng(0))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(
            (name, value)
            for name in ("electrons_per_light", "levels_per_electron", "full_well_electrons")
            for value in (np.nan, 0.0, -1.0, np.inf)
        ),
        *(("read_noise_electrons", value) for value in (np.nan, -1.0, np.inf)),
        *(("blooming_ratio", value) for value in (np.nan, -0.1, 1.1)),
        ("bits", 10),
    ],
)
def test_a_chip_that_cannot_be_is_refused(field, value):
    chip = camera_chip(EVEN)
    assert isinstance(chip, CameraChip)
    with pytest.raises(BadInput, match=f"chip: {field}"):
        dataclasses.replace(chip, **{field: value})


def test_pattern_is_the_same_for_the_same_seed():
    first, again, other = (fixed_pattern(50, 40, 0.01, 2.0, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.response, again.response)
    assert not np.array_equal(first.offset_electrons, other.offset_electrons)
    assert first.response.shape == (40, 50)

"""The seam point by morphology."""

import cv2
import numpy as np
import pytest

from weldcell.cell.errors import BadInput
from weldcell.tracking.morphology import MorphologyParameters, seam_point

SEAM_U = 470.0
ROWS, COLUMNS = 400, 800


def _picture(kind, *, gap=30, depth=0.0, mismatch=0.0, seed=0, sigma=2.0):
    """A curved stripe with the seam at column 470; speckle of contrast 0.5, noise of 3 levels."""
    rng, u = np.random.default_rng(seed), np.arange(COLUMNS)
    v = 180 + 60 * np.sin(u / 300)
    inside = np.abs(u - SEAM_U) < gap / 2
    if kind == "dark":
        v = np.where(inside, np.nan, v)
    elif kind == "lit":
        v = np.where(inside, v + depth, v)
    elif kind == "dip":
        v = v + depth * np.clip(1 - ((u - SEAM_U) / (gap / 2)) ** 2, 0, None)
    v = np.where(u > SEAM_U, v + mismatch, v)
    light = np.nan_to_num(150 * np.exp(-0.5 * ((np.arange(ROWS)[:, None] - v) / sigma) ** 2))
    light = light * rng.gamma(4, 0.25, light.shape)
    return np.clip(light + 15 + rng.normal(0, 3, light.shape), 0, 255).astype(np.uint8)


def _surface_v(u):
    return 180 + 60 * np.sin(u / 300)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("gap", [8, 30, 80])
def test_a_dark_gap_of_a_curved_stripe_gives_its_middle(gap, seed):
    found = seam_point(_picture("dark", gap=gap, seed=seed))
    assert found.valid
    assert abs(found.point_px[0] - SEAM_U) < 1.0  # px: the ends of the pieces are ragged by speckle
    assert abs(found.point_px[1] - _surface_v(SEAM_U)) < 2.0  # px: a third of the stripe's width


@pytest.mark.parametrize(("kind", "gap", "depth"), [("lit", 30, 25), ("lit", 60, 70), ("dip", 30, 12), ("dip", 20, 6)])
def test_shallow_and_deep_seams_are_found_where_they_are(kind, gap, depth):
    for seed in range(3):
        found = seam_point(_picture(kind, gap=gap, depth=depth, seed=seed))
        assert found.valid
        assert abs(found.point_px[0] - SEAM_U) < 2.0  # px
        across = found.point_px[1] - _surface_v(SEAM_U)
        assert -2.0 < across < depth + 2.0  # px: between the surface and the seam's bottom


def test_the_steps_follow_one_from_another():
    found = seam_point(_picture("dark"))
    steps, parameters = found.steps, found.parameters
    square = np.ones((2 * parameters.dilations + 1,) * 2, np.uint8)  # n dilations by 3 x 3 are one by 2n + 1
    assert np.array_equal(steps.dilated, cv2.dilate(steps.pieces, square))
    assert np.all(steps.eroded >= steps.pieces)  # closing only adds
    assert np.array_equal(steps.difference, cv2.subtract(steps.eroded, steps.pieces))
    assert np.all(steps.seam <= steps.difference)
    rows, columns = np.nonzero(steps.seam)
    assert np.allclose(found.point_px, [columns.mean(), rows.mean()])  # px; the centroid
    beside = np.ones((2 * parameters.thicken_px + 1, 2 * round(found.width_px) + 1), np.uint8)
    assert np.all(steps.pieces <= cv2.dilate(steps.bright, beside))  # thickened across, mended along, never new


def test_a_stripe_along_columns_is_the_same_transposed():
    picture = _picture("dark")
    across, along = seam_point(picture), seam_point(np.ascontiguousarray(picture.T), along="columns")
    assert along.valid and np.allclose(along.point_px, across.point_px[::-1])
    assert np.array_equal(along.steps.eroded, across.steps.eroded.T)


def test_parameters_grow_with_the_stripe_and_the_gap():
    thin, thick = (seam_point(_picture("dark", sigma=sigma)) for sigma in (1.5, 4.0))
    assert thick.width_px > 1.8 * thin.width_px
    assert thick.parameters.block_px > thin.parameters.block_px
    assert seam_point(_picture("dark", gap=80)).parameters.dilations > thin.parameters.dilations


def test_light_thicker_than_any_stripe_is_left_out():
    # A weld's glow on both edges of a groove, across the stripe: brighter than the stripe, and joined to it.
    for seed in range(3):
        picture = _picture("dark", gap=60, seed=seed)
        for u in (SEAM_U - 32, SEAM_U + 30):
            picture[60:330, int(u) - 8 : int(u) + 8] = 250
        found = seam_point(picture)
        assert found.valid and np.abs(found.point_px - [SEAM_U - 1, _surface_v(SEAM_U)]).max() < 3.0  # px


def test_given_parameters_are_used_as_they_are():
    given = MorphologyParameters(
        median_px=5, block_px=61, above_grey=20, least_region_px=100, dilations=20, least_seam_px=30
    )
    found = seam_point(_picture("dark"), parameters=given)
    assert found.valid and found.parameters == given


def test_without_a_gap_there_is_no_seam_point():
    for seed in range(3):
        found = seam_point(_picture("dip", depth=0.0, seed=seed))
        assert not found.valid and "no gap" in found.reason and np.isnan(found.point_px).all()


@pytest.mark.parametrize("mismatch", [8, -10])
def test_a_mismatch_or_a_leaning_stripe_is_bridged_halfway(mismatch):
    for seed in range(3):
        found = seam_point(_picture("dark", gap=60, mismatch=mismatch, seed=seed))
        assert found.valid and found.parameters.thicken_px > abs(mismatch) / 2 - 1
        assert abs(found.point_px[0] - SEAM_U) < 1.5  # px
        assert abs(found.point_px[1] - _surface_v(SEAM_U) - mismatch / 2) < 2.5  # px: half a stripe's width


def test_a_mismatch_steeper_than_a_leaning_stripe_is_no_seam():
    # The method's own limit: what is so far off the stripe's level does not belong to it.
    assert not seam_point(_picture("dark", mismatch=25)).valid


@pytest.mark.parametrize(("gap", "depth"), [(60, 40), (130, 90), (30, 60)])
def test_the_lit_bottom_of_a_deep_groove_does_not_draw_the_bridge_down(gap, depth):
    for seed in range(3):
        picture = _picture("lit", gap=gap, depth=depth, seed=seed)
        bottom = np.round(_surface_v(SEAM_U) + depth).astype(int)
        picture[bottom - 12 : bottom + 12, int(SEAM_U) : int(SEAM_U) + gap // 4] = 15  # half of it, as walls hide it
        found = seam_point(picture)
        assert found.valid and not found.steps.pieces[bottom - 3 : bottom + 3].any()
        assert np.abs(found.point_px - [SEAM_U, _surface_v(SEAM_U)]).max() < 2.0  # px


def test_a_glow_neither_hides_the_stripe_nor_widens_it():
    picture, column, row = _picture("dark"), np.arange(COLUMNS), np.arange(ROWS)[:, None]
    glow = 1.5 * 255 * np.exp(-0.5 * (np.hypot(column - 300, row - 20) / 70) ** 2)
    lit = np.clip(picture + glow, 0, 255).astype(np.uint8)
    plain, found = seam_point(picture), seam_point(lit)
    assert abs(found.width_px - plain.width_px) <= 1 and np.abs(found.point_px - plain.point_px).max() < 1.0  # px


def test_noise_alone_is_no_stripe():
    grey = np.clip(np.random.default_rng(1).normal(20, 3, (300, 400)), 0, 255).astype(np.uint8)
    found = seam_point(grey)
    assert not found.valid and "stripe" in found.reason


def test_two_like_gaps_are_ambiguous_until_the_last_point_tells():
    picture = _picture("dark")
    picture[:, 520:550] = 15
    found = seam_point(picture)
    assert not found.valid and "2 gaps" in found.reason
    near = seam_point(picture, near_px=np.array([480.0, 240.0]), reach_px=40.0)
    assert near.valid and abs(near.point_px[0] - SEAM_U) < 1.0  # px


def test_twelve_bits_give_what_eight_bits_give():
    picture = _picture("dark")
    assert np.allclose(seam_point(picture.astype(np.uint16) * 16).point_px, seam_point(picture).point_px, atol=0.5)


@pytest.mark.parametrize("picture", [np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4)), np.zeros((0, 4), np.uint8)])
def test_what_is_no_grey_picture_is_refused(picture):
    with pytest.raises(BadInput, match="expected a grey picture"):
        seam_point(picture)

"""Stripe and joint in pictures of which nothing is known."""

import cv2
import numpy as np
import pytest

from tracking.groove_pictures import (
    CORNERS_PX,
    SHAPE,
    board_grey,
    colour_picture,
    grey_picture,
    stripe_light,
    turned,
)
from weldcell.cell.profile import Stripe
from weldcell.tracking.picture_joint import joint_in_picture
from weldcell.tracking.picture_stripe import stripes_in_picture
from weldcell.tracking.stripe import find_stripe


def _joint(picture, **known):
    """The joint on the first way of following the stripe that shows one, and that way."""
    ways = stripes_in_picture(picture, **known)
    found = [(joint_in_picture(way.stripe, "v", direction_rad=way.direction_rad), way) for way in ways]
    return next((one for one in found if one[0].valid), found[0])


def _error_px(joint, corners_px):
    """Largest distance from the true corners, from left to right in the picture."""
    leftwards = corners_px[3, 0] < corners_px[1, 0]
    return np.linalg.norm(
        joint.points_px - corners_px[3:0:-1] if leftwards else joint.points_px - corners_px[1:4], axis=1
    ).max()


@pytest.mark.parametrize("angle_deg", [0, 10, 30, 45, -38, 60, 180, 150])
def test_a_groove_is_found_however_the_picture_is_turned(angle_deg):
    corners_px = turned(CORNERS_PX, np.deg2rad(angle_deg))
    joint, _ = _joint(grey_picture(corners_px, rng=np.random.default_rng(angle_deg % 7)))
    assert joint.valid and joint.names == ("left", "root", "right")
    assert joint.points_px[0, 0] < joint.points_px[2, 0]  # left is left in the picture
    assert _error_px(joint, corners_px) < 5 * joint.sigma_px.max()  # five sigma, some 0.2 px


def test_a_quarter_turn_turns_the_features():
    picture = grey_picture(rng=np.random.default_rng(1))
    straight, _ = _joint(picture)
    upright, way = _joint(np.ascontiguousarray(np.rot90(picture)))  # u' = v, v' = width - 1 - u
    assert way.direction_rad == np.pi / 2
    expected = np.column_stack([straight.points_px[:, 1], SHAPE[1] - 1 - straight.points_px[:, 0]])[::-1]
    assert np.abs(upright.points_px - expected).max() < 0.05  # px; the search starts from other cells
    assert np.all(np.diff(upright.points_px[:, 1]) > 0)  # left is above


@pytest.mark.parametrize("deeper", [1, -1])
def test_exact_points_give_the_exact_corners_whichever_way_is_deeper(deeper):
    corners_px = CORNERS_PX * [1, deeper] + [0, 0 if deeper > 0 else 600]
    u_px = np.arange(0.0, 760.0)
    stripe = Stripe(u_px=u_px, v_px=np.interp(u_px, *corners_px.T), sigma_px=np.full(760, 0.01))
    joint = joint_in_picture(stripe, "v")
    assert joint.valid
    assert np.abs(joint.points_px - corners_px[1:4]).max() < 1e-6  # px; solver precision


@pytest.mark.parametrize("known", [{"colour": "auto"}, {}])
@pytest.mark.parametrize(("channel", "colour"), [(0, "red"), (1, "green"), (2, "blue")])
def test_a_coloured_laser_is_told_from_a_board(channel, colour, known):
    joint, way = _joint(colour_picture(channel, rng=np.random.default_rng(channel)), **known)
    assert way.colour == colour and joint.valid
    assert _error_px(joint, CORNERS_PX) < 1.0  # px; the board's squares reflect 1.04 and 0.4 of the light


def test_a_core_too_bright_for_all_channels_keeps_its_centre():
    rng = np.random.default_rng(4)
    joint, way = _joint(colour_picture(0, rng=rng, peak_grey=1200.0, spill=0.3), colour="red")
    assert joint.valid and _error_px(joint, CORNERS_PX) < 1.0  # px
    on_plate = (way.stripe.u_px > 560) & (way.stripe.u_px < 740)
    truth_px = np.interp(way.stripe.u_px, *CORNERS_PX.T)
    assert abs(np.mean((way.stripe.v_px - truth_px)[on_plate])) < 0.05  # px


def test_a_board_behind_the_stripe_takes_little_of_it():
    rng = np.random.default_rng(5)
    light = stripe_light(CORNERS_PX) * rng.gamma(10, 0.1, SHAPE)
    picture = np.clip(0.5 * board_grey() + 150 * light + rng.normal(0, 1.5, SHAPE), 0, 255).astype(np.uint8)
    # px; right is what no edge of the board beside the stripe has moved
    plain, cleared = (
        np.abs(stripe.v_px - np.interp(stripe.u_px, *CORNERS_PX.T)) < 0.5
        for stripe in (find_stripe(picture), stripes_in_picture(picture)[0].stripe)
    )
    assert cleared.sum() > 0.8 * SHAPE[1] and cleared.sum() > 1.1 * plain.sum()


@pytest.mark.parametrize("square_px", [20.0, 34.0, 45.0, 60.0])
def test_a_board_alone_has_no_stripe(square_px):
    board = board_grey(square_px=square_px) + np.random.default_rng(6).normal(0, 2, SHAPE)
    for way in stripes_in_picture(np.clip(board, 0, 255).astype(np.uint8)):
        assert len(way.stripe.u_px) == 0


def test_a_wide_stripe_is_found_in_a_smaller_picture_and_given_in_the_large_one():
    small = grey_picture(rng=np.random.default_rng(7), sigma_px=2.5)
    large = cv2.resize(small, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC)
    joint, way = _joint(large)
    assert way.shrinking > 1 and joint.valid
    assert _error_px(joint, CORNERS_PX * 5 + 2) < 1.5  # px of the large picture, pixel 0 of the small one lies at 2


def test_taking_off_the_surroundings_costs_little_precision():
    rng = np.random.default_rng(8)
    level = np.array([[-100.0, 200.3], [900.0, 240.9]])
    picture = grey_picture(level, rng=rng, contrast=0.05)
    way = stripes_in_picture(picture, along="rows")[0]
    error_px = way.stripe.v_px - np.interp(way.stripe.u_px, *level.T)
    assert len(error_px) == SHAPE[1]
    assert error_px.std() == pytest.approx(np.sqrt(np.mean(way.stripe.sigma_px**2)), rel=0.15)
    assert abs(error_px.mean()) < 0.005  # px; 760 columns of 0.05 px each fix it to 0.002


def test_an_empty_picture_has_one_way_without_points():
    ways = stripes_in_picture(np.zeros(SHAPE, np.uint8))
    assert len(ways[0].stripe.u_px) == 0
    assert joint_in_picture(ways[0].stripe, "v").reason == "no stripe in the picture"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_dark_columns_as_speckle_on_bare_metal_leaves_them_do_not_break_the_stripe_to_crumbs(seed):
    """Six dark columns in every thirty: no stretch between two holes is as long as the shortest piece that counts."""
    rng = np.random.default_rng(seed)
    dark = (np.arange(SHAPE[1]) + 7 * seed) % 30 < 6
    light = stripe_light(CORNERS_PX) * np.where(dark, 0.0, 1.0)
    picture = np.clip(90 * light + rng.normal(6, 0.8, SHAPE), 0, 255).astype(np.uint8)
    found = stripes_in_picture(picture)[0].stripe
    assert len(found.u_px) > 0.7 * SHAPE[1]

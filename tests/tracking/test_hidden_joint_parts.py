"""Joints of which spatter and glare hide a part: found where the rest determines them, refused or doubted where not."""

import numpy as np
import pytest

from tracking.joint_sections import JOINTS, PLANE, errors_m, measured, placed, seen_stripe
from weldcell.tracking.curve_end import curve_end
from weldcell.tracking.curves import line_curve
from weldcell.tracking.joint import find_joint
from weldcell.tracking.pieces import Piece, bridged
from weldcell.tracking.section import Section

COLUMN_M = 6e-5
END_COLUMN_M = 8e-5
NOISE_M = 1e-5


def _found(kind, drawn, seed, *, hidden_m=(), extra=(), previous=None):
    parts, truth = placed(drawn, z_m=0.185)
    stripe = seen_stripe([*parts, *extra])
    profile = measured(stripe, noise_m=NOISE_M, hidden_m=list(hidden_m), rng=np.random.default_rng(seed))
    return find_joint(profile, kind, PLANE, previous=previous), truth


@pytest.mark.parametrize("seed", [1])
def test_a_bevel_in_two_pieces_with_spatter_between_them_is_one(seed):
    drop = np.array([[0.007, 0.165], [0.0095, 0.163]])  # m, laser frame: 20 mm in front of the plates
    features, truth = _found("bevel", JOINTS["bevel"](thickness=0.02), seed, hidden_m=[(0.0065, 0.0105)], extra=[drop])
    assert features.valid, features.reason
    assert errors_m(features, truth).max() < 3 * COLUMN_M


def test_pieces_of_one_line_are_bridged_and_others_are_not():
    line = [Piece(start_m=a, end_m=b, slope=-1.0, intercept_m=0.2, count=20) for a, b in ((0.0, 0.004), (0.008, 0.012))]
    stray = Piece(start_m=0.005, end_m=0.007, slope=0.0, intercept_m=0.16, count=20)
    (union,) = bridged([line[0], stray, line[1]], 1e-4, 0.005)
    assert (union.start_m, union.end_m, union.count) == (0.0, 0.012, 40)
    assert union.slope == pytest.approx(-1.0)
    assert bridged([line[0], stray, line[1]], 1e-4, 0.003) == []  # 4 mm apart


@pytest.mark.parametrize("hidden_mm", [1.0, 4.0])
def test_a_u_grooves_edge_is_where_its_wall_leads_if_the_plates_end_is_hidden(hidden_mm):
    drawn = JOINTS["u"](thickness=0.02)
    edge_m = drawn[1]["left"][0]
    features, truth = _found("u", drawn, 3, hidden_m=[(edge_m - 5e-4, edge_m + 1e-3 * hidden_mm)])
    assert features.valid, features.reason
    assert errors_m(features, truth)[0] < min(COLUMN_M, 5 * features.sigma_m[0])


def test_a_v_with_gap_whose_lower_half_is_hidden_is_refused():
    drawn = JOINTS["v-gap"](gap=0.002, thickness=0.02)
    features, _ = _found("v-gap", drawn, 5, hidden_m=[(-0.006, 0.006)])
    assert not features.valid and "hidden" in features.reason


def test_a_v_with_gap_keeps_its_depth_while_both_its_ends_are_hidden():
    drawn = JOINTS["v-gap"](gap=0.002, thickness=0.02)
    features, truth = _found("v-gap", drawn, 6)
    for seed in range(7, 10):
        features, _ = _found("v-gap", drawn, seed, hidden_m=[(-1.3e-3, 1.3e-3)], previous=features)  # 0.5 mm of depth
        assert features.valid, features.reason
        assert errors_m(features, truth)[1] < 3 * features.sigma_m[1] < 4e-4  # m


@pytest.mark.parametrize("gap_mm", [0.8, 1.2, 2.0])
def test_a_bevels_gap_is_doubted_until_it_is_seen_again(gap_mm):
    drawn = JOINTS["bevel"](gap=1e-3 * gap_mm, thickness=0.02)
    first, truth = _found("bevel", drawn, 13)
    again, _ = _found("bevel", drawn, 14, previous=first)
    assert errors_m(first, truth)[1] < 3 * first.sigma_m[1]
    assert errors_m(again, truth)[1] < 1.5 * COLUMN_M


def test_a_gap_as_narrow_as_what_an_edge_hides_stays_doubted():
    drawn = JOINTS["bevel"](gap=0.3e-3, thickness=0.02)
    features, truth = _found("bevel", drawn, 13)
    for seed in (14, 15):
        features, _ = _found("bevel", drawn, seed, previous=features)
        # The root of a gap of 0.3 mm and that of none are 0.34 mm apart at 45 degrees: midway it errs by half of that.
        assert errors_m(features, truth)[1] < min(0.17e-3 + COLUMN_M, 3 * features.sigma_m[1])


def _lost(edge, lost, rng, in_front=False):
    """A plate of 100 columns up to `edge` whose last `lost` ones are missing, or seen far in front of it."""
    column = np.arange(110.0)
    seen = column < edge - lost
    z = 0.2 + 2e-5 * rng.normal(size=110)
    front = (column >= edge - lost) & (column < edge + 3) & in_front
    keep = seen | front
    return Section(
        x_m=column[keep] * END_COLUMN_M,
        z_m=np.where(front, 0.17, z)[keep],
        sigma_m=np.full(keep.sum(), 2e-5),
        noise_slope=np.zeros(keep.sum()),
        amplitude_grey=np.full(keep.sum(), np.nan),
    )


@pytest.mark.parametrize("in_front", [False, True])
def test_ends_that_lost_columns_now_and_then_are_as_certain_as_they_say(in_front):
    rng = np.random.default_rng(17)
    share, errors, plain, sigmas = 0.1, [], [], []
    for edge in rng.uniform(85, 95, 250):
        lost = int(rng.integers(1, 8)) if rng.random() < share else 0
        section = _lost(edge, lost, rng, in_front)
        ends = [
            curve_end(section, line_curve(0.0, 0.2), 30 * END_COLUMN_M, 105 * END_COLUMN_M, lost_share=p)
            for p in (share, 0.0)
        ]
        errors.append(ends[0].corner.x_m / END_COLUMN_M - edge)
        plain.append(ends[1].corner.x_m / END_COLUMN_M - edge)
        sigmas.append(ends[0].corner.sigma_m / END_COLUMN_M)
    # columns; a tenth of the ends is 4 columns short on average: 0.4
    assert np.mean(errors) - np.mean(plain) == pytest.approx(0.35, abs=0.1)
    assert abs(np.mean(errors)) < abs(np.mean(plain))
    assert 0.6 < np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(sigmas))) < 1.6


def test_no_column_is_lost_where_the_next_surface_is_seen():
    rng = np.random.default_rng(18)
    section = _lost(90, 0, rng)
    x = np.arange(90.0, 105.0) * END_COLUMN_M
    below = Section(
        x_m=np.append(section.x_m, x),
        z_m=np.append(section.z_m, np.full(15, 0.208)),
        sigma_m=np.append(section.sigma_m, np.full(15, 2e-5)),
        noise_slope=np.zeros(len(section.x_m) + 15),
        amplitude_grey=np.full(len(section.x_m) + 15, np.nan),
    )
    sure, may_lose = (
        curve_end(below, line_curve(0.0, 0.2), 30 * END_COLUMN_M, 104 * END_COLUMN_M, lost_share=p) for p in (0.0, 0.1)
    )
    assert abs(may_lose.corner.x_m - sure.corner.x_m) < 0.1 * END_COLUMN_M

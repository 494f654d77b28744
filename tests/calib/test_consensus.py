import numpy as np
import pytest

from weldcell.calib.consensus import agreeing, most_wrong


def to_mean(points):
    """The simplest model: all rows are one point."""
    return lambda chosen: np.linalg.norm(points - points[chosen].mean(axis=0), axis=1)


@pytest.mark.parametrize(("count", "expected"), [(0, 0), (3, 0), (4, 0), (5, 1), (6, 1), (7, 2), (10, 3), (20, 6)])
def test_three_in_ten_may_be_wrong_while_four_are_left(count, expected):
    assert most_wrong(count) == expected


@pytest.mark.parametrize("count", [5, 10, 40])  # 40: subsets by chance
def test_three_in_ten_alike_and_wrong_are_told(count):
    rng = np.random.default_rng(count)
    points = rng.normal(0, 1e-3, (count, 3))
    wrong = rng.permutation(count) < most_wrong(count)
    points[wrong] += 0.1  # all of them to one place: the hardest case
    assert np.array_equal(agreeing(to_mean(points), count), ~wrong)


def test_good_rows_stay():
    """200 clean sets of 10 rows: none loses a row, since 4 times the seventh of ten lies beyond 6 sigma."""
    for seed in range(200):
        points = np.random.default_rng(seed).normal(0, 1e-3, (10, 3))
        assert agreeing(to_mean(points), 10).all()


def test_exact_rows_agree_within_rounding():
    points = np.zeros((6, 3))
    points[2] = 1e-5
    assert np.array_equal(agreeing(to_mean(points), 6), [True, True, False, True, True, True])


def test_four_rows_are_too_few_to_tell():
    points = np.zeros((4, 3))
    points[2] = 1.0
    assert agreeing(to_mean(points), 4).all()

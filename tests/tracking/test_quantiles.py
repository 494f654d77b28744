"""Quantiles against NumPy's."""

import numpy as np
import pytest

from weldcell.tracking.quantiles import median, quantile, upper_median


@pytest.mark.parametrize("count", [1, 2, 3, 10, 101])
@pytest.mark.parametrize("share", [0.0, 0.16, 0.2, 0.5, 1.0])
def test_quantiles_are_numpys(count, share):
    values = np.random.default_rng(count).normal(size=count)
    assert quantile(values, share) == pytest.approx(np.quantile(values, share), abs=1e-14)  # rounding
    assert median(values) == pytest.approx(np.median(values), abs=1e-14)


def test_values_keep_their_order():
    values = np.array([3.0, 1.0, 2.0])
    quantile(values, 0.2)
    assert values.tolist() == [3.0, 1.0, 2.0]


@pytest.mark.parametrize("count", [1, 2, 5, 10])
def test_the_upper_median_is_one_of_the_values(count):
    values = np.random.default_rng(count).normal(size=count)
    assert upper_median(values.copy()) == np.sort(values)[count // 2]

"""The prior of a part's drift."""

import numpy as np
import pytest

from tracking.seam_plant import path
from weldcell.tracking.drift import DriftBasis
from weldcell.tracking.seam_model import SeamPriors, seam_model

MODES = 5  # four exponentials and the steady one


def _basis(**change) -> DriftBasis:
    given = {"size_m": 1e-3, "shortest_s": 5.0, "wander_m_s": 0.1e-3, "memory_s": 12.0, "knot_s": 5.0} | change
    return DriftBasis(**given).reaching(40.0)


def test_the_wandering_has_the_variance_of_its_formula():
    time_s = np.arange(0, 41, 5.0)  # the knots; between them a little variance is left out
    wandering = _basis().at(time_s)[:, MODES:]
    expected = 2 * 0.1e-3**2 * 12 * (time_s - 12 * (1 - np.exp(-time_s / 12)))
    assert np.allclose((wandering**2).sum(axis=1), expected, rtol=1e-10)


def test_the_wandering_has_the_covariance_of_integrated_paths():
    rng = np.random.default_rng(5)
    step_s, count = 0.05, 4000
    left = np.exp(-step_s / 12)
    rate = np.empty((800, count))
    rate[0] = rng.normal(0, 0.1e-3, count)
    for k in range(1, 800):
        rate[k] = left * rate[k - 1] + rng.normal(0, 0.1e-3 * np.sqrt(1 - left**2), count)
    drift = np.cumsum(rate, axis=0) * step_s
    wandering = _basis().at(np.array([10.0, 40.0]))[:, MODES:]
    # 8 %: the correlation of 4000 walks is known to 1 / sqrt(4000), each of two variances to 2 / sqrt(8000)
    assert np.cov(drift[199], drift[799])[0, 1] == pytest.approx(wandering[0] @ wandering[1], rel=0.08)


def test_a_later_interval_changes_nothing_before_it():
    time_s = np.linspace(0, 39, 50)
    short, long = _basis(), _basis().reaching(80.0)
    assert long.count > short.count
    assert np.allclose(long.at(time_s)[:, : short.count], short.at(time_s), atol=1e-18)
    assert np.allclose(long.at(time_s)[:, short.count :], 0, atol=1e-18)


def test_nothing_drifts_before_the_arc_is_lit():
    assert np.array_equal(_basis().at(np.array([-3.0, 0.0])), np.zeros((2, _basis().count)))


@pytest.mark.parametrize("constant_s", [5.5, 7.0, 14.0, 28.0, 60.0])
def test_the_modes_hold_any_exponential_between_them(constant_s):
    """2 mm of drift to 10 um, with numbers that the prior expects (one sigma on the average)."""
    time_s = np.linspace(0, 40, 200)
    modes = _basis(size_m=0.8e-3).at(time_s)[:, :MODES]
    wanted = 2e-3 * (1 - np.exp(-time_s / constant_s))
    numbers = np.linalg.solve(modes.T @ modes + (10e-6) ** 2 * np.eye(MODES), modes.T @ wanted)
    assert np.abs(modes @ numbers - wanted).max() < 20e-6
    assert np.sqrt((numbers**2).mean()) < 1.5


def test_the_prior_expects_about_two_millimetres_within_half_a_minute():
    drift = seam_model(path("straight"), SeamPriors()).drift.reaching(30.0).at(np.array([30.0]))
    assert 1e-3 < np.sqrt((drift**2).sum()) < 3e-3

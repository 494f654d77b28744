"""A section's points by their x, and the curves that bend only where they must."""

import numpy as np
import pytest

from weldcell.tracking.curves import fit_curve, line_curve
from weldcell.tracking.section import Section

SIGMA_M = 1e-5


def section(x_m, z_m=None):
    count = len(x_m)
    return Section(
        x_m=np.asarray(x_m, float),
        z_m=np.zeros(count) if z_m is None else z_m,
        sigma_m=np.full(count, SIGMA_M),
        noise_slope=np.full(count, 0.3),
        amplitude_grey=np.full(count, np.nan),
    )


@pytest.mark.parametrize("x_m", [[0.0, 1.0, 1.0, 2.0, 3.0, 4.0], [0.0, 2.0, 1.0, 1.0, 4.0, 3.0]], ids=["sorted", "not"])
@pytest.mark.parametrize("span", [(1.0, 3.0), (0.5, 3.5), (-1.0, 9.0), (5.0, 9.0), (3.0, 1.0)])
def test_points_between_two_x_are_those_of_a_mask(x_m, span):
    points = section(x_m)
    x, (low, high) = points.x_m, span
    assert points.only(points.between(low, high)).x_m.tolist() == x[(x >= low) & (x <= high)].tolist()
    inner = points.only(points.between(low, high, ends=False)).x_m
    assert inner.tolist() == x[(x > low) & (x < high)].tolist()


def test_spacing_is_the_usual_one_whatever_hole_there_is():
    x_m = np.concatenate([np.arange(50), np.arange(90, 140)]) * 1e-4
    assert section(x_m).spacing_m == pytest.approx(1e-4, rel=1e-9)  # rounding of the differences


@pytest.mark.parametrize("seed", range(1, 4))
def test_a_clear_bend_is_fitted_and_a_straight_plate_stays_straight(seed):
    x_m = np.linspace(-0.01, 0.01, 200)
    noise_m = np.random.default_rng(seed).normal(0, SIGMA_M, len(x_m))
    lean = 1 - 0.1 * 0.3  # of the noise's direction out of the line z = 0.1 x
    straight = fit_curve(section(x_m, 0.1 * x_m + lean * noise_m), line_curve(0.1, 0.0), highest_degree=3)
    # The coefficient of t^2 has a sigma of about 3.4 / sqrt(200) of a point's: 10 um are four of these.
    bent = fit_curve(
        section(x_m, 0.1 * x_m + lean * noise_m + 1e-5 * (x_m / 0.01) ** 2), line_curve(0.1, 0.0), highest_degree=3
    )
    assert len(straight.coefficients_m) == 2
    assert len(bent.coefficients_m) == 3
    assert abs(bent.coefficients_m[2] - 1e-5) < 4 * np.sqrt(bent.covariance[2, 2])

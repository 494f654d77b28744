"""The drawing of a round groove against points on circles and lines, and against a solver of its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from weldcell.tracking.groove_drawing import Drawing, fit_drawing
from weldcell.tracking.section import Section

NOISE_M = 2e-5
U, GAPPED, J = (
    np.array([3e-4, 0.013, 0.006, 0.18, 0.25, 0.0]),
    np.array([-2e-4, 0.012, 0.004, 0.2, 0.15, 7e-4]),
    np.array([5e-4, 0.013, 0.006, 0.3, 0.27, 0.0]),
)


def _outline(numbers, *, square=False):
    """The groove's outline by the circle's angle and along the walls: a polyline from right to left."""
    middle, depth, radius, *walls, half = numbers
    arms = []
    for side, tangent in zip((-1, 1), walls, strict=True):
        turn = np.linspace(0, np.pi / 2 - np.arctan(tangent), 3000)
        arc = np.column_stack([half + radius * np.sin(turn), depth - radius + radius * np.cos(turn)])
        up = np.linspace(0, arc[-1, 1], 1000)[1:]
        arm = np.vstack([arc, arc[-1] + np.column_stack([up * tangent, -up])])
        arms.append([middle, 0] + arm * [side, 1])
    right = np.array([[0.0, depth], arms[1][0]]) if square else arms[0][::-1]
    return np.vstack([right, arms[1]])


def _points(numbers, rng=None, *, square=False, count=180):
    line = _outline(numbers, square=square)
    s = np.linspace(line[0, 0], line[-1, 0], count)
    d = np.interp(s, *line.T)
    return Section(
        x_m=s,
        z_m=d if rng is None else d + NOISE_M * rng.normal(size=count),
        sigma_m=np.full(count, NOISE_M),
        noise_slope=np.zeros(count),
        amplitude_grey=np.full(count, np.nan),
    )


def _fit(section, square=False):
    drawing = fit_drawing(section, section.x_m[0], section.x_m[-1], sides=(not square, True))
    assert isinstance(drawing, Drawing), drawing
    return drawing


@pytest.mark.parametrize(("numbers", "square"), [(U, False), (GAPPED, False), (J, True)])
def test_points_without_noise_recover_the_drawing(numbers, square):
    off = np.abs(_fit(_points(numbers, square=square), square).numbers - numbers)
    assert off[[0, 1, 2, 5]].max() < 2e-8  # m; the outline's chords are as far off its circle
    assert off[[4] if square else [3, 4]].max() < 1e-5


@pytest.mark.parametrize(("numbers", "square"), [(U, False), (GAPPED, False), (J, True)])
def test_errors_are_as_large_as_their_covariance_says(numbers, square):
    squares, free = [], [0, 1, 2, 4] if square else [0, 1, 2, 3, 4]
    for seed in range(20):
        drawing = _fit(_points(numbers, np.random.default_rng(seed), square=square), square)
        error = (drawing.numbers - numbers)[free]
        squares.append(error @ np.linalg.solve(drawing.covariance[np.ix_(free, free)], error))
    assert 0.6 < np.mean(squares) / len(free) < 1.5  # a mean of 80 squares or more, each of variance 2


def test_the_fit_is_that_of_least_squares_to_the_weights_efficiency():
    section = _points(U, np.random.default_rng(7))

    def residuals(numbers):
        return (section.z_m - np.interp(section.x_m, *_outline([*numbers, 0.0]).T)) / NOISE_M

    best = least_squares(residuals, U[:5], x_scale=[1e-3, 1e-3, 1e-3, 0.1, 0.1], diff_step=1e-6).x
    drawing = _fit(section)
    sigma = np.sqrt(np.diag(drawing.covariance))[:5]
    # 95 % efficiency: Tukey's estimate lies sqrt(1 / 0.95 - 1) = 0.23 sigma from that of least squares
    assert (np.abs(drawing.numbers[:5] - best) / sigma).max() < 3 * 0.23


def test_strays_do_not_matter():
    rng = np.random.default_rng(3)
    clean = _points(GAPPED, rng)
    at = rng.choice(len(clean.x_m), 25, replace=False)
    z = clean.z_m.copy()
    z[at] -= rng.uniform(1e-3, 6e-3, 25)
    without, drawing = _fit(clean), _fit(replace(clean, z_m=z))
    sigma = np.sqrt(np.diag(without.covariance))
    assert (np.abs(drawing.numbers - without.numbers) / sigma).max() < 2  # of the others, an eighth fewer


@pytest.mark.parametrize("side", [-1, 1])
def test_a_walls_gradient_is_that_of_its_place(side):
    drawing = replace(_fit(_points(GAPPED)), higher_m=4e-4)
    for at, derivative in enumerate(drawing.wall_gradient(side, 1e-3)):
        step = 1e-6 * np.eye(6)[at]
        ahead, behind = (replace(drawing, numbers=drawing.numbers + h).wall_at(side, 1e-3) for h in (step, -step))
        assert derivative == pytest.approx((ahead - behind) / 2e-6, abs=1e-6)  # of 1, or of 1 m per tangent


def test_a_wall_goes_on_where_the_outline_ends():
    drawing, line = _fit(_points(GAPPED)), _outline(GAPPED)
    assert drawing.wall_at(1, 0.0) == pytest.approx(line[-1, 0], abs=1e-7)  # m: the outline ends at d = 0
    assert drawing.wall_at(-1, 0.0) == pytest.approx(line[0, 0], abs=1e-7)

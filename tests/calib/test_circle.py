import numpy as np
import pytest

from weldcell.calib.circle import agreeing_points, algebraic_circle, circle_residuals, circles_through, radial_distance


def test_circles_through_three_points():
    found = circles_through(np.array([[3.0, 2.0], [1.0, 4.0], [-1.0, 2.0]]), *np.array([[0], [1], [2]]))
    assert found == pytest.approx(np.array([[1.0, 2.0, 2.0]]), abs=1e-14)  # centre (1, 2), radius 2 by hand
    assert len(circles_through(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]), *np.array([[0], [1], [2]]))) == 0


def test_algebraic_circle_of_exact_points():
    angles = np.linspace(0, 2, 20)
    points = 0.02 * np.column_stack([np.cos(angles), np.sin(angles)]) + [0.3, -0.2]
    assert algebraic_circle(points) == pytest.approx([0.3, -0.2, 0.02], abs=1e-12)


def test_points_agree_with_the_circle_they_lie_on():
    points = np.array([[2.0, 0.0], [0.0, 2.0], [-2.05, 0.0], [0.0, -2.5]])
    circles = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 2.5]])
    assert agreeing_points(points, np.full(4, 0.1), circles) == pytest.approx([3, 1])  # by hand
    assert radial_distance(points, circles[0]) == pytest.approx([0, 0, 0.05, 0.5], abs=1e-12)


def test_residuals_derivatives_agree_with_differences():
    rng = np.random.default_rng(0)
    points, sigma, circle = rng.normal(size=(6, 2)), np.full(6, 0.5), np.array([0.1, 0.2, 0.9])
    step = 1e-6
    columns = [
        (circle_residuals(points, sigma, circle + d)[0] - circle_residuals(points, sigma, circle - d)[0]) / (2 * step)
        for d in step * np.eye(3)
    ]
    assert circle_residuals(points, sigma, circle)[1] == pytest.approx(np.stack(columns, axis=-1), abs=1e-8)

import numpy as np
import pytest
from scipy.optimize import check_grad, minimize

from weldcell.calib.least_squares import _Damped, covariance, fit, robust_spread


def line_model(x, y, sigma):
    design = np.column_stack([x, np.ones_like(x)])
    return lambda p: (((design @ p - y) / sigma)[:, None], (design / sigma)[:, None])


def test_covariance_of_a_straight_line_is_the_textbook_one():
    x = np.array([-1.0, 0.0, 1.0])
    found = fit(line_model(x, 2 * x + 1, 0.1), np.zeros(2), robust=False)
    assert found.parameters == pytest.approx([2, 1], abs=1e-12)
    # slope: sigma^2 / sum x^2 = 0.01 / 2; offset: sigma^2 / n = 0.01 / 3
    assert found.covariance == pytest.approx(np.diag([0.005, 0.01 / 3]), abs=1e-15)


def test_loss_is_the_pseudo_huber_function_of_whole_vectors():
    rng = np.random.default_rng(0)
    points, loss = rng.normal(0, 0.5, (9, 3)) + [[5, 0, 0]] * (np.arange(9) == 0)[:, None], 3.0
    model = lambda p: (p - points, np.broadcast_to(np.eye(3), (9, 3, 3)))  # noqa: E731

    def cost(p):
        return np.sum(np.sqrt(1 + np.sum((p - points) ** 2, axis=1) / loss**2))

    best = minimize(cost, np.zeros(3), tol=1e-14).x
    found = fit(model, np.zeros(3))
    assert robust_spread(found.residuals, 3) < 1  # or the loss would have been widened
    assert found.parameters == pytest.approx(best, abs=1e-6)  # the minimiser's own precision
    damped = _Damped(model, loss)
    start = np.array([0.3, -1.0, 2.0])
    half = lambda p: np.sum(damped.residuals(p) ** 2)  # noqa: E731
    slope = lambda p: 2 * damped.jacobian(p).T @ damped.residuals(p)  # noqa: E731
    assert half(start) == pytest.approx(2 * loss**2 * (cost(start) - 9), rel=1e-12)
    assert check_grad(half, slope, start) < 1e-5  # finite differences


def test_one_gross_outlier_moves_the_mean_by_less_than_a_sigma():
    values = np.append(np.random.default_rng(1).normal(size=30), 1e4)
    model = lambda p: ((p - values)[:, None], np.ones((31, 1, 1)))  # noqa: E731
    assert abs(fit(model, np.zeros(1)).parameters[0] - values[:-1].mean()) < 0.3
    assert fit(model, np.zeros(1), robust=False).parameters[0] == pytest.approx(values.mean(), abs=1e-9)
    assert fit(model, np.zeros(1)).weights[-1] < 1e-3


def test_sigmas_promised_too_small_are_made_up_for():
    rng = np.random.default_rng(2)
    x = np.linspace(-1, 1, 400)
    found = fit(line_model(x, rng.normal(0, 0.7, 400), 0.1), np.zeros(2))
    honest = 0.7**2 / np.sum(x**2)
    assert found.covariance[0, 0] == pytest.approx(honest, rel=0.3)  # 400 points: 7 % and the loss's few per cent


@pytest.mark.parametrize("components", [1, 2, 3])
def test_predicted_covariance_of_a_mean_is_its_scatter_under_normal_noise(components):
    count, trials = 40, 600
    rng = np.random.default_rng(components)
    errors, predicted = [], []
    for values in rng.normal(size=(trials, count, components)):
        slopes = np.broadcast_to(np.eye(components), (count, components, components))
        found = fit(lambda p, values=values, slopes=slopes: (p - values, slopes), np.zeros(components))
        errors.append(found.parameters)
        predicted.append(np.diag(found.covariance))
    ratio = np.mean(np.square(errors)) / np.mean(predicted)
    # variance of 600 squares: 6 %; the inflation counts only upwards, which adds some per cent at 40 observations
    assert 0.82 < ratio < 1.1


def test_open_directions_have_infinite_covariance():
    jacobian = np.ones((5, 1, 2))
    assert np.all(np.isinf(covariance(jacobian, np.ones(5))))


def test_spread_of_normal_vectors_is_their_sigma():
    rng = np.random.default_rng(3)
    for components in (1, 2, 3):
        assert robust_spread(rng.normal(0, 2.0, (20000, components))) == pytest.approx(2, rel=0.03)  # 20000: 1 %

"""The model of a misplaced, drifting seam against geometry and closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracking.seam_plant import Plant, path, steady
from weldcell.tracking.seam_model import SeamModel, SeamPriors, seam_model

PLACES_M = np.array([0.01, 0.08, 0.17, 0.29])
TIMES_S = np.array([0.0, 3.0, 11.0, 24.0])


def _model(kind: str = "s", **priors) -> SeamModel:
    return seam_model(path(kind), SeamPriors(**priors)).reaching(30.0)


def _unknowns(model: SeamModel, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=model.count)


@pytest.mark.parametrize("seed", range(3))
def test_jacobians_are_the_derivatives(seed):
    model = _model()
    x = _unknowns(model, seed)
    crossing = model.crossing(x, PLACES_M, TIMES_S)
    points = model.taught.place(PLACES_M, *crossing.deviations_m.T)
    seen = model.seen(x, points, TIMES_S, PLACES_M)
    for k in range(model.count):
        step = np.zeros(model.count)
        step[k] = 1e-3
        ahead, behind = (model.crossing(x + sign * step, PLACES_M, TIMES_S).deviations_m for sign in (1, -1))
        # m; small turns are not taken apart: half of 5 degrees in the second axis, on 8 mm a sigma
        assert np.allclose((ahead - behind) / 2e-3, crossing.jacobian_m[..., k], atol=4e-5)
        ahead, behind = (model.seen(x + sign * step, points, TIMES_S, PLACES_M).deviations_m for sign in (1, -1))
        assert np.allclose((behind - ahead) / 2e-3, seen.jacobian_m[..., k], atol=4e-5)


@pytest.mark.parametrize("seed", range(3))
def test_a_point_of_the_modelled_seam_is_seen_on_it(seed):
    model = _model()
    x = _unknowns(model, seed)
    points = model.taught.place(PLACES_M, *model.crossing(x, PLACES_M, TIMES_S).deviations_m.T)
    assert np.abs(model.seen(x, points, TIMES_S, PLACES_M + 4e-3).deviations_m).max() < 1e-7  # m; two Newton steps


def test_the_crossing_is_where_a_plane_cuts_the_moved_path():
    """Against a fine polyline: half a micrometre, chords of 0.25 mm in bends of 100 mm."""
    rates = np.array([0.05e-3, -0.03e-3, 0.02e-3])
    model, priors = _model(), SeamPriors()
    shift, turn = np.array([6e-3, -5e-3, 3e-3]), np.array([0.002, -0.004, 0.05])
    x = np.zeros(model.count)
    x[:3] = shift / priors.place_m
    x[3:6] = turn / [priors.tilt_rad, priors.tilt_rad, priors.yaw_rad]
    plant = Plant(taught=model.taught, shift_m=shift, turn_rad=turn, drift=steady(rates, 1.0))
    starts = model.count - 3 * model.drift.count
    x[starts:].reshape(-1, 3)[4] = rates * 20 / priors.drift_m  # the steady mode: its size within half of 40 s
    assert np.allclose(model.drift_m(x, TIMES_S), TIMES_S[:, None] * rates, atol=1e-15)
    truth = [plant.truth(place, time) for place, time in zip(PLACES_M, TIMES_S, strict=True)]
    assert np.abs(model.crossing(x, PLACES_M, TIMES_S).deviations_m - np.array(truth)).max() < 0.5e-6


def test_the_slope_known_from_the_run_in_is_that_of_a_straight_line():
    """sigma sqrt(12 / N) / L, whatever the priors: they are much wider."""
    noise_m, run_in_m, count = 0.05e-3, 0.060, 60
    model = _model("straight", shape_m=1e-9, tilt_rad=0.2, drift_m=0.0)
    x = np.zeros(model.count)
    at_m = (np.arange(count) + 0.5) / count * run_in_m
    rows = model.crossing(x, at_m, np.zeros(count)).jacobian_m.reshape(-1, model.count)
    covariance = np.linalg.inv(np.eye(model.count) + rows.T @ rows / noise_m**2)
    two = model.crossing(x, np.array([0.1, 0.2]), np.zeros(2)).jacobian_m
    apart = two[1] - two[0]
    slope_sigma = np.sqrt(np.diag(apart @ covariance @ apart.T)) / 0.1
    assert slope_sigma == pytest.approx(noise_m * np.sqrt(12 / count) / run_in_m, rel=0.01)


def test_the_shape_has_the_prior_it_was_given():
    model = _model(shape_m=0.2e-3, shape_length_m=30e-3)
    basis = model.shape.at(np.linspace(0.0, 0.3, 40))
    # between knots half a length apart some variance is left out: at most 6 %
    assert np.all(np.abs((basis**2).sum(axis=1) / 0.2e-3**2 - 1) < 0.06)


def test_a_turned_cell_is_tracked_in_the_same_way():
    """Deviations do not depend on where the base's axes point, but for the prior of the tilts."""
    turn = Rotation.from_euler("z", 70, degrees=True)
    model = _model(tilt_rad=0.05, yaw_rad=0.05)
    taught = model.taught
    turned = seam_model(
        type(taught)(
            arc_length_m=taught.arc_length_m,
            points_base=turn.apply(taught.points_base),
            lefts_base=turn.apply(taught.lefts_base),
            ups_base=turn.apply(taught.ups_base),
        ),
        model.priors,
    ).reaching(30.0)
    x = _unknowns(model, 4)
    y = x.copy()
    y[:3], y[3:6] = turn.apply(x[:3]), turn.apply(x[3:6])
    starts = model.count - 3 * model.drift.count
    y[starts:] = turn.apply(x[starts:].reshape(-1, 3)).ravel()
    one, other = (m.crossing(z, PLACES_M, TIMES_S).deviations_m for m, z in ((model, x), (turned, y)))
    assert np.allclose(one, other, atol=1e-12)

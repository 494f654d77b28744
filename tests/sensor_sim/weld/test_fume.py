"""Fume obeys Beer and Lambert's law; what it scatters agrees with integrals done by other means."""

import numpy as np
import pytest
from scipy.integrate import quad

from weldcell.sensor_sim.stripe import stripe_optics
from weldcell.sensor_sim.weld.coarse_view import CoarseView
from weldcell.sensor_sim.weld.fume import ALBEDO, EXTINCTION_PER_M, FumeCloud, light_sheet, pieces_of, scattered_arc

START = np.array([0.2, 0.0, 0.17])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_extinction_at_the_arc_is_what_it_claims_on_average(seed):
    times_s = np.arange(0, 400, 0.7)
    cloud = FumeCloud(seed)
    mean = np.mean([cloud.extinction_per_m(np.zeros((1, 3)), t)[0] for t in times_s])
    assert mean == pytest.approx(EXTINCTION_PER_M, rel=0.15)  # 570 draws of contrast 0.8, with some correlation


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_few_pieces_of_a_way_give_the_integral_along_it(seed):
    cloud = FumeCloud(seed)
    stop = np.array([[0.06, 0.01, 0.0], [0.05, -0.05, 0.0], [0.02, 0.0, 0.0]])
    places, piece_m = pieces_of(START, stop)
    depth = cloud.extinction_per_m(places, 1.3).sum(axis=1) * piece_m
    shares = (np.arange(4000) + 0.5) / 4000
    finely = START + shares[:, None, None] * (stop - START)
    exact = cloud.extinction_per_m(finely, 1.3).mean(axis=0) * np.linalg.norm(stop - START, axis=1)
    np.testing.assert_allclose(depth, exact, rtol=0.1)  # the finest wisps are as short as a piece


def test_scattered_light_of_an_even_cloud_is_the_integral_over_the_ray():
    stops = np.array([[0.06, 0.01, 0.0], [0.02, -0.01, 0.0]])
    extinction = np.full((2, 60), 1.5)
    found = scattered_arc(extinction, START, stops, intensity=2.0)
    for k in range(2):
        length_m = np.linalg.norm(stops[k] - START)
        ray = (stops[k] - START) / length_m

        def piece(s, ray=ray):
            return 1.5 * np.exp(-1.5 * s) * ALBEDO / (4 * np.pi) * 2.0 / np.sum((START + s * ray) ** 2)

        assert found[k] == pytest.approx(quad(piece, 0, length_m)[0], rel=2e-3)  # 60 pieces


def test_the_cloud_depends_on_seed_and_time_alone_and_drifts():
    places = np.random.default_rng(1).uniform(-0.1, 0.1, (50, 3))
    cloud = FumeCloud(4)
    later = cloud.extinction_per_m(places, 2.0)
    cloud.extinction_per_m(places, 1.0)
    np.testing.assert_array_equal(FumeCloud(4).extinction_per_m(places, 2.0), later)
    now, soon, much_later = (np.log(cloud.extinction_per_m(places, t)) for t in (2.0, 2.001, 4.0))
    assert np.corrcoef(now, soon)[0, 1] > 0.99 > 0.7 > abs(np.corrcoef(now, much_later)[0, 1])


def test_haze_at_the_reference_by_hand(config, camera, fan):
    """White shows unblurred * s sqrt(2 pi) = P' / pi; a crossing at 45 deg scatters P' w / (4 pi sin 45 deg)."""
    optics = stripe_optics(config, camera, fan)
    sheet = light_sheet(fan, optics, np.array([[0.0, 0.0, 1.0]]))
    sigma_m = 160e-6 / 4
    power = np.pi * optics.unblurred_grey * sigma_m * np.sqrt(2 * np.pi)
    assert sheet.haze_grey_m[0] == pytest.approx(power * ALBEDO / (4 * np.pi) * np.sqrt(2), rel=1e-3)


def test_there_is_no_haze_outside_the_fan(config, camera, fan):
    sheet = light_sheet(fan, stripe_optics(config, camera, fan), CoarseView(camera).directions_camera)
    frame = fan.plane.T_camera_laser.inv()
    across, _, along = (frame.apply(sheet.points_camera) - frame.apply(fan.source_camera)).T
    inside = np.abs(across / along) < np.tan(np.deg2rad(config.laser_fan_deg / 2))
    np.testing.assert_array_equal(sheet.haze_grey_m > 0, inside)

"""Disturbances through the whole sensor: what pictures show of them, between their times and not outside."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensor_sim.rigs import rig
from weldcell.cell.configuration import Disturbance, SensorConfig
from weldcell.cell.frames import difference, rigid_from
from weldcell.sensor_sim.line_sensor import LineSensor, Moment
from weldcell.tracking.stripe import find_stripe

PLATE = '<geom type="box" size=".2 .2 .01" pos="0 0 -.01" rgba=".5 .5 .5 1"/>'
T_BASE_TORCH = rigid_from(Rotation.from_matrix(np.diag([1.0, -1.0, -1.0])), np.array([-0.06, 0.0, 0.0]))
CONFIG = SensorConfig(second_bounce=False)
RIG = rig(CONFIG)
BEFORE_S, DURING_S, AFTER_S = 0.5, 1.5, 2.0
"""The scripts act from 1 s up to before 2 s."""


@pytest.fixture
def sensor_with(scene):
    """Opens a sensor over the plate whose script holds one entry; gives its `light` at a time."""
    model, data = scene(PLATE)
    opened = []

    def build(kind, strength=1.0):
        script = (Disturbance(kind=kind, strength=strength, start_s=1.0, end_s=2.0),)
        sensor = LineSensor(
            CONFIG, RIG.camera, RIG.fan.plane, RIG.fan.source_camera, model, script=script, seed=4
        )  # fmt: skip
        opened.append(sensor)
        return sensor, lambda time_s: sensor.light(
            data, RIG.T_base_camera(), Moment(time_s=time_s, T_base_torch=T_BASE_TORCH)
        )

    yield build
    for sensor in opened:
        sensor.close()


def rng():
    return np.random.default_rng(7)


@pytest.mark.parametrize("kind", ["arc", "spatter", "fume", "stripe-lost", "sensor-knocked", "stuck-exposure"])
def test_pictures_differ_between_start_and_end_only(sensor_with, scene, kind):
    model, data = scene(PLATE)
    with LineSensor(CONFIG, RIG.camera, RIG.fan.plane, RIG.fan.source_camera, model, seed=4) as undisturbed:
        plain = undisturbed.capture(data, RIG.T_base_camera(), rng())
    sensor, light = sensor_with(kind)
    before, during, after = (sensor.picture(light(t), rng()) for t in (BEFORE_S, DURING_S, AFTER_S))
    np.testing.assert_array_equal(before, plain)
    np.testing.assert_array_equal(after, plain)
    assert np.mean(during != plain) > 1e-3


def test_an_arc_adds_light_and_leaves_the_stripes_own_light_alone(sensor_with):
    sensor, light = sensor_with("arc")
    before, during = light(BEFORE_S), light(DURING_S)
    assert (during.ambient_grey - before.ambient_grey).min() >= 0
    assert (during.ambient_grey - before.ambient_grey).mean() > 3  # levels
    np.testing.assert_array_equal(during.laser.grey, before.laser.grey)
    for of in (before, during):
        unlit = of.laser.grey.max(axis=1) < 0.01  # rows of the laser's band
        beside = np.setdiff1d(np.arange(1080), of.laser.first_row + np.flatnonzero(~unlit))
        picture = sensor.picture(of, rng())[beside].astype(float)
        expected = np.minimum(of.ambient_grey[beside], 255).mean()  # the arc itself saturates
        assert picture.mean() == pytest.approx(expected, rel=0.01, abs=0.05)


@pytest.mark.parametrize(("strength", "ratio"), [(0.02, 0.16), (0.25, 2.0), (1.0, 8.0)])
def test_a_stuck_exposure_scales_all_light(sensor_with, strength, ratio):
    sensor, light = sensor_with("stuck-exposure", strength)
    during = light(DURING_S)
    assert during.exposure_ratio == pytest.approx(ratio)
    beside = np.s_[:200, :]  # clear of the stripe
    dark = sensor.picture(light(BEFORE_S), rng())[beside].astype(float).mean()
    assert sensor.picture(during, rng())[beside].astype(float).mean() == pytest.approx(ratio * dark, rel=0.02, abs=0.05)


def test_a_lost_stripe_leaves_no_stripe_and_no_label_and_half_of_it_half(sensor_with):
    sensor, light = sensor_with("stripe-lost")
    during = light(DURING_S)
    assert not during.laser_on and not during.section.lit.any() and len(during.stripe.cut_px) == 0
    assert len(find_stripe(sensor.picture(during, rng())).u_px) == 0
    assert len(find_stripe(sensor.picture(light(AFTER_S), rng())).u_px) > 1400
    _, half = sensor_with("stripe-lost", 0.5)
    assert half(DURING_S).laser_on
    np.testing.assert_allclose(half(DURING_S).laser.grey, 0.5 * half(BEFORE_S).laser.grey, rtol=1e-5)


def test_a_knock_moves_picture_and_truth_together(sensor_with):
    sensor, light = sensor_with("sensor-knocked")
    before, during = light(BEFORE_S), light(DURING_S)
    angle_rad, distance_m = difference(during.T_base_camera, before.T_base_camera)
    assert (np.degrees(angle_rad), distance_m) == pytest.approx((0.5, 1e-3), rel=1e-6)
    assert difference(before.T_base_camera, RIG.T_base_camera()) == (0.0, 0.0)
    lit_base = during.T_base_camera.apply(during.section.points_camera[during.section.seen])
    assert np.abs(lit_base[:, 2]).max() < 1e-9  # on the plate's top, which stood still
    stripe = find_stripe(sensor.picture(during, rng()))
    exact = np.interp(stripe.u_px, during.stripe.cut_px, during.stripe.centre_px)
    old = np.interp(stripe.u_px, before.stripe.cut_px, before.stripe.centre_px)
    assert abs(np.mean(stripe.v_px - exact)) < 0.03  # px: 0.2 of speckle over 700 grains
    assert abs(np.mean(exact - old)) > 1


@pytest.mark.parametrize("kind", ["stripe-lost", "sensor-knocked", "fume"])
def test_profiles_without_pictures_are_dimmed_and_knocked_alike(sensor_with, scene, kind):
    _, data = scene(PLATE)
    sensor, light = sensor_with(kind)
    moment = Moment(time_s=DURING_S, T_base_torch=T_BASE_TORCH)
    stripe, truth = sensor.profile(data, RIG.T_base_camera(), rng(), moment), light(DURING_S).stripe
    if kind == "stripe-lost":
        assert len(stripe.u_px) == 0
    else:
        assert len(stripe.u_px) > 1400
        assert abs(np.mean(stripe.v_px - np.interp(stripe.u_px, truth.cut_px, truth.centre_px))) < 0.03  # px

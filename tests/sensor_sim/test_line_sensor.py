"""Whole pictures: the stripe is where truth says, and only there; same seed, same bytes."""

import dataclasses
from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.errors import NotReady
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.line_sensor import LineSensor

WHITE = 'rgba="1 1 1 1"'
SCENE = f'<geom type="plane" size="0 0 1" pos="0 0 -.04" {WHITE}/><geom size=".02" pos=".006 .004 -.005" {WHITE}/>'
SMALL = SensorConfig(width_px=480, height_px=360, pixel_um=10.35)  # a third of the pixels, the same view


def sensor(config, model) -> LineSensor:
    return LineSensor(config, nominal_camera(config), nominal_plane(config), nominal_source_camera(config), model)


@pytest.fixture(scope="module")
def noiseless():
    return dataclasses.replace(SensorConfig(), noise=False, ambient_grey=0.0)


@pytest.mark.parametrize(
    "world",
    ['<geom type="box" size=".2 .2 .001"/>', '<geom type="box" size=".2 .2 .001" euler="20 -15 0"/>', SCENE],
    ids=["plane", "tilted plane", "sphere"],
)
def test_stripe_centre_of_a_noise_free_picture_is_the_truth(scene, overhead, noiseless, world):
    model, data = scene(world)
    with sensor(noiseless, model) as line_sensor:
        picture = line_sensor.capture(data, overhead(), np.random.default_rng(0)).astype(float)
        _, pieces = line_sensor.truth(data, overhead())
    alone = np.bincount(pieces.u_px, minlength=1440)[pieces.u_px] == 1
    kept = alone & (pieces.coverage > 0.999) & (pieces.amplitude_grey > 60) & (pieces.v_px < 1070)
    assert kept.sum() > 800
    rows = np.arange(1080)[:, None]
    columns = picture[:, pieces.u_px[kept]]
    error_px = (rows * columns).sum(axis=0) / columns.sum(axis=0) - pieces.v_px[kept]
    # rounding to whole grey levels leaves sqrt(sum(row^2) / 12) / sum(grey) = 0.01 px on the faintest columns
    assert np.sqrt(np.mean(error_px**2)) < 0.02


def test_same_seed_same_bytes_and_another_seed_others(scene, overhead):
    model, data = scene(SCENE)
    pictures = []
    for seed in (1, 1, 2):
        with sensor(SMALL, model) as line_sensor:
            pictures.append(line_sensor.capture(data, overhead(), np.random.default_rng(seed)).tobytes())
    assert pictures[0] == pictures[1] != pictures[2]


def test_a_picture_does_not_depend_on_the_pictures_before(scene, overhead):
    model, data = scene(SCENE)
    with sensor(SMALL, model) as line_sensor:
        alone = line_sensor.capture(data, overhead(), np.random.default_rng(1))
        line_sensor.capture(data, overhead((0.0, 0.01, 0.01), 0.4), np.random.default_rng(2))
        np.testing.assert_array_equal(line_sensor.capture(data, overhead(), np.random.default_rng(1)), alone)


def test_two_threads_with_a_sensor_each_give_the_bytes_of_one(scene, overhead):
    model, _ = scene(SCENE)

    def pictures(seeds):
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        with sensor(SMALL, model) as own:
            return {seed: own.capture(data, overhead(), np.random.default_rng(seed)).tobytes() for seed in seeds}

    alone = pictures(range(8))
    with ThreadPoolExecutor(2) as pool:
        even, odd = pool.map(pictures, (range(0, 8, 2), range(1, 8, 2)))
    assert even | odd == alone


def test_a_visual_only_workpiece_gives_the_same_picture(scene, overhead):
    mesh = '<mesh name="tetra" vertex="-.04 -.03 0  .03 -.03 0  0 .04 0  0 0 .03"/>'
    pictures = []
    for properties in ("", 'contype="0" conaffinity="0"'):
        model, data = scene(
            '<body><geom type="box" size=".001 .001 .001" pos=".3 .3 0"/>'
            f'<geom type="mesh" mesh="tetra" {properties}/></body>',
            mesh,
        )
        with sensor(SMALL, model) as line_sensor:
            pictures.append(line_sensor.capture(data, overhead((0, 0, 0.005)), np.random.default_rng(1)))
    assert pictures[0].max() > 100
    np.testing.assert_array_equal(*pictures)


@pytest.mark.parametrize(
    "world",
    ['<geom size=".6"/>', '<geom type="plane" size="0 0 1" pos="0 0 -3"/>', '<geom size=".01" pos="3 3 3"/>'],
    ids=["inside metal", "out of range", "nothing there"],
)
def test_no_stripe_is_a_picture_without_one(scene, overhead, world):
    model, data = scene(world)
    with sensor(SMALL, model) as line_sensor:
        picture = line_sensor.capture(data, overhead(), np.random.default_rng(1))
        section, pieces = line_sensor.truth(data, overhead())
    assert picture.shape == (360, 480) and picture.dtype == np.uint8 and picture.max() < 30
    assert not section.seen.any() and len(pieces.u_px) == 0


def test_a_sensor_asked_before_the_scene_is_ready_says_so(scene, overhead):
    model, data = scene(SCENE)
    data.geom_xmat[:] = 0
    with sensor(SMALL, model) as line_sensor, pytest.raises(NotReady, match="mj_kinematics"):
        line_sensor.capture(data, overhead(), np.random.default_rng(1))


def test_nothing_beyond_the_truth_is_lit(scene, overhead):
    """Bright pixels lie within four sigma of a piece of the true stripe."""
    model, data = scene(SCENE)
    with sensor(SensorConfig(), model) as line_sensor:
        picture = line_sensor.capture(data, overhead(), np.random.default_rng(3))
        _, pieces = line_sensor.truth(data, overhead())
    v, u = np.nonzero(picture > 40)
    away = np.full(len(u), np.inf)
    for column, row, sigma in zip(pieces.u_px, pieces.v_px, pieces.sigma_px, strict=True):
        same = u == column
        away[same] = np.minimum(away[same], np.abs(v[same] - row) / sigma)
    assert len(u) > 1000 and away.max() < 4.5

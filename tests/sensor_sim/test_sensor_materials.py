"""Materials through the whole sensor: speckle of their own contrast, ghosts from mirrors only."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sensor_sim.rigs import rig
from weldcell.cell.configuration import SensorConfig
from weldcell.cell.frames import translation
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.line_sensor import LineSensor
from weldcell.sensor_sim.materials import MATERIALS
from weldcell.sensor_sim.speckle import speckle_contrast

CONFIG = SensorConfig(bits=12, ambient_grey=1.0)
RIG = rig(CONFIG)


def tiles(*materials):
    """Boxes side by side along the stripe (y), each of one material."""
    spec = mujoco.MjSpec()
    width_m = 0.2 / len(materials)
    for k, name in enumerate(materials):
        spec.add_material(name=f"tile/{name}") if spec.material(f"tile/{name}") is None else None
        y_m = -0.1 + (k + 0.5) * width_m
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.1, width_m / 2, 0.001],
            pos=[0, y_m, -0.001],
            material=f"tile/{name}",
        )
    return with_data(spec.compile())


def groove(material):
    spec = mujoco.MjSpec()
    v_groove_plate(0.2, 0.16, 0.03, np.pi / 4, 0.0, 0.004, 0.0).with_surface(material).add_to(
        spec, translation([0, 0, -0.03])
    )
    return with_data(spec.compile())


def with_data(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def opened(config, model):
    return LineSensor(config, RIG.camera, RIG.fan.plane, RIG.fan.source_camera, model)


def contrast_in_pictures(config, model, data, columns, pictures=6):
    """Standard deviation over mean of the laser's light near its peak, photon and read noise taken off."""
    with opened(config, model) as sensor:
        light = sensor.light(data, RIG.T_base_camera())
        rows = light.laser.window[0]
        mean = light.laser.grey[:, columns]
        taken = [sensor.picture(light, np.random.default_rng(k))[rows, columns] for k in range(pictures)]
    levels = np.array(taken) * (255 / 4095)
    assert levels.max() < 250
    near_peak = mean > 0.7 * mean.max()
    laser = (levels - light.ambient_grey[rows, columns])[:, near_peak]
    ratio = laser / mean[near_peak]
    of_camera = (mean[near_peak] + 1) / 41 + 0.5**2  # levels^2
    assert ratio.mean() == pytest.approx(1, abs=0.02)
    return np.sqrt(ratio.var() - np.mean(of_camera / mean[near_peak] ** 2))


def expected_contrast(config, name):
    material = MATERIALS[name]
    return float(speckle_contrast(config, np.array(material.depolarises), np.array(material.height_sigma_m)))


@pytest.mark.parametrize("name", ["matt-white", "mill-scale", "ground-steel"])
def test_a_picture_has_the_speckle_contrast_of_its_material(name):
    config = replace(CONFIG, peak_grey={"matt-white": 40.0, "mill-scale": 120.0, "ground-steel": 60.0}[name])
    expected = expected_contrast(config, name)
    # 6 x 1440 columns of 2 px grains: 2 %; the gamma's cube 3 %
    assert contrast_in_pictures(config, *tiles(name), slice(100, 1340)) == pytest.approx(expected, rel=0.05)


def test_each_surface_of_a_picture_has_its_own_contrast():
    config = replace(CONFIG, peak_grey=40.0)
    model, data = tiles("matt-white", "ground-steel")
    left, right = (contrast_in_pictures(config, model, data, part) for part in (slice(60, 680), slice(760, 1380)))
    white, steel = (expected_contrast(config, name) for name in ("matt-white", "ground-steel"))
    assert steel > 1.2 * white
    assert sorted([left, right]) == pytest.approx([white, steel], rel=0.06)


@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_a_despeckler_leaves_its_share(ratio):
    config = replace(CONFIG, peak_grey=100.0, speckle_ratio=ratio)
    expected = expected_contrast(config, "matt-white")
    assert expected == pytest.approx(ratio * expected_contrast(CONFIG, "matt-white"))
    found = contrast_in_pictures(config, *tiles("matt-white"), slice(100, 1340))
    assert found == pytest.approx(expected, rel=0.05, abs=0.02)


@pytest.mark.parametrize(("material", "second_bounce", "ghostly"), [
    ("polished", True, True), ("polished", False, False), ("matt-white", True, False),
])  # fmt: skip
def test_only_mirrors_make_ghosts_and_only_if_asked(material, second_bounce, ghostly):
    """Light more than 5 sigma away from the stripe's own pieces, the sensor standing askew to the groove."""
    config = replace(CONFIG, noise=False, ambient_grey=0.0, second_bounce=second_bounce, exposure_ms=4.0)
    model, data = groove(material)
    with opened(config, model) as sensor:
        light = sensor.light(data, RIG.T_base_camera((0, 0, -0.01), 0.2))
        picture = sensor.picture(light, np.random.default_rng(0))
    stripe = light.stripe
    away = np.full(picture.shape, np.inf)
    rows = np.arange(picture.shape[0])
    for column, centre_px, sigma_px in zip(stripe.cut_px, stripe.centre_px, stripe.sigma_px, strict=True):
        away[:, column] = np.minimum(away[:, column], np.abs(rows - centre_px) / sigma_px)
    beside = (away > 5) & np.isfinite(away)
    if ghostly:
        assert len(light.ghosts) > 0 and all(ghost.amplitude_grey.max() > 1 for _, ghost in light.ghosts)
        assert np.count_nonzero(picture[beside] * (255 / 4095) > 2) > 200  # pixels brighter than two levels
    else:
        assert light.ghosts == () and picture[beside].max() == 0

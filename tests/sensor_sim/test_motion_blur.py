"""Motion during the exposure: stripes grow by the closed form and stay where the exposure's middle has them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sensor_sim.rigs import rig
from weldcell.cell.configuration import SENSOR_PRESETS
from weldcell.cell.frames import rigid_from
from weldcell.sensor_sim.line_sensor import LineSensor, Moment

CLEAN = {"noise": False, "ambient_grey": 0.0, "bits": 12, "motion_blur": True, "distortion": (0.0,) * 5}
SLANTS = {"level": "0 0 0", "slanted": "8 -12 0"}
MOTIONS = {
    "shifted": rigid_from(Rotation.identity(), np.array([0, 2e-4, 4e-4])),
    "turned": rigid_from(Rotation.from_rotvec([2e-3, 1e-3, 1e-3]), np.array([3e-4, 0, 0])),
}


def stripe_line(config, T_base_camera: RigidTransform, normal_base) -> np.ndarray:
    """The stripe (a, b, c) on a plane through the base's origin: a u + b v + c = 0 for a lens without distortion.

    Points on both n.p = d and m.p = e also lie on (e n - d m).p = 0, a plane through the camera's centre, whose
    picture is that line.
    """
    own = rig(config)
    normal = T_base_camera.rotation.inv().apply(normal_base)
    offset = -normal_base @ T_base_camera.translation
    through_centre = offset * own.fan.plane.normal_camera - own.fan.plane.offset_m * normal
    return np.linalg.solve(own.camera.matrix.T, through_centre)


def moments(picture, along: str, centre_px):
    """Centroid and variance of each cut's light within 16 px of the stripe (px, px^2)."""
    columns = picture.astype(float) if along == "rows" else picture.T.astype(float)
    rows = np.arange(len(columns))[:, None]
    light = np.where(np.abs(rows - centre_px) < 16, columns, 0)
    centroid = (rows * light).sum(axis=0) / light.sum(axis=0)
    return centroid, ((rows - centroid) ** 2 * light).sum(axis=0) / light.sum(axis=0)


def line_px(line, along: str, count: int):
    """Where a line crosses each cut."""
    a, b, c = line if along == "rows" else line[[1, 0, 2]]
    return -(a * np.arange(count) + c) / b


@pytest.mark.parametrize("preset", ["p2", "p1"])
@pytest.mark.parametrize("slant", SLANTS)
@pytest.mark.parametrize("name", MOTIONS)
def test_a_stripe_that_moves_by_d_gains_a_variance_of_d2_over_12(scene, preset, slant, name):
    motion = MOTIONS[name]
    config = replace(SENSOR_PRESETS[preset], **CLEAN)
    own, along = rig(config), config.stripe_along
    model, data = scene(f'<geom type="plane" size=".2 .2 .1" euler="{SLANTS[slant]}" rgba="1 1 1 1"/>')
    normal_base = data.geom_xmat[0].reshape(3, 3)[:, 2]
    middle = own.T_base_camera()
    half = rigid_from(Rotation.from_rotvec(motion.rotation.as_rotvec() / 2), motion.translation / 2)
    count = config.width_px if along == "rows" else config.height_px
    before, centre, after = (
        line_px(stripe_line(config, T, normal_base), along, count) for T in (middle * half.inv(), middle, middle * half)
    )
    with LineSensor(config, own.camera, own.fan.plane, own.fan.source_camera, model) as sensor:
        still, moving = (
            moments(sensor.capture(data, middle, np.random.default_rng(0), moment), along, centre)
            for moment in (Moment(), Moment(T_begin_end=motion))
        )
    inside = slice(count // 10, -count // 10)  # the light's ends move, too
    moved_px = (after - before)[inside]
    assert np.abs(moved_px).min() > 0.5
    # px; rounding to 12 bits moves a centroid by 0.001, and the second order of the motion is d^2 / f
    assert np.abs(moving[0] - centre)[inside].max() < 0.01
    gained_px2 = (moving[1] - still[1])[inside]
    # 1 %: sums over 4095 levels, the widths of five poses; 0.01 px^2: what is drawn ends at four sigma
    np.testing.assert_allclose(gained_px2, moved_px**2 / 12, rtol=0.01, atol=0.01)


def test_light_is_kept_and_a_camera_that_stands_is_not_blurred(scene):
    config = replace(SENSOR_PRESETS["p2"], **CLEAN)
    own = rig(config)
    model, data = scene('<geom type="plane" size=".2 .2 .1" rgba="1 1 1 1"/>')
    motion = Moment(T_begin_end=rigid_from(Rotation.identity(), [0, 0, 5e-4]))
    with LineSensor(config, own.camera, own.fan.plane, own.fan.source_camera, model) as sensor:
        still, moving = (sensor.light(data, own.T_base_camera(), m).laser.grey.sum(axis=0) for m in (None, motion))
    with LineSensor(
        replace(config, motion_blur=False), own.camera, own.fan.plane, own.fan.source_camera, model
    ) as sensor:
        unblurred = sensor.light(data, own.T_base_camera(), motion).laser.grey.sum(axis=0)
    np.testing.assert_allclose(
        moving[100:-100], still[100:-100], rtol=2e-3
    )  # a millimetre changes the distance by that
    np.testing.assert_array_equal(unblurred, still)

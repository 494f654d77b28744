"""The whole cell fits together: table height, no collisions in a working pose, a picture that shows it."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.frames import rigid_from, translation
from weldcell.models.arm import build_arm
from weldcell.models.boss import boss
from weldcell.models.room import TABLE_TOP_M, build_room
from weldcell.models.sensor_head import HeadDesign, build_sensor_head
from weldcell.models.sphere import sphere_stand
from weldcell.models.torch import build_torch
from weldcell.models.v_groove import v_groove_plate

# Torch straight down over the sphere, wire 0.6 mm above it, sensor outwards; from a closed-form inverse.
OVER_SPHERE_DEG = (0.0, -95.3, 120.2, 0.0, 30.1, 180.0)


@pytest.fixture(scope="module")
def cell():
    spec = build_room()
    arm = build_arm()
    arm.attach(build_torch(), site="flange", prefix="torch/")
    arm.attach(build_sensor_head(HeadDesign()), site="flange", prefix="sensor/")
    spec.attach(arm, frame=spec.worldbody.add_frame(), prefix="arm/")
    mount = spec.worldbody.add_body(name="sphere_mount", mocap=True, pos=[0.93, 0, 0.43])
    spec.attach(sphere_stand(0.02), frame=mount.add_frame(), prefix="sphere/")
    quarter_turn = Rotation.from_euler("z", 90, degrees=True)
    plate = v_groove_plate(0.3, 0.16, 0.06, np.pi / 4, 0, 0.004, 0.02)
    plate.add_to(spec, rigid_from(quarter_turn, np.array([1.01, 0.13, TABLE_TOP_M])))
    boss(0.05, np.arctan2(4, 3), 0.04).add_to(spec, translation(np.array([0.93, -0.19, TABLE_TOP_M])))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:6] = np.deg2rad(OVER_SPHERE_DEG)
    mujoco.mj_forward(model, data)
    return model, data


def test_table_top_is_at_its_height(cell):
    model, data = cell
    down, hit = np.array([0, 0, -1.0]), np.zeros(1, np.int32)
    distance = mujoco.mj_ray(model, data, np.array([0.651, -0.601, 1.0]), down, None, 1, -1, hit)
    assert distance == pytest.approx(1 - TABLE_TOP_M, abs=1e-6)
    assert model.geom(hit[0]).name == "table_top"


def test_working_pose_over_the_sphere_collides_with_nothing(cell):
    _, data = cell
    assert data.ncon == 0
    tip = data.site("arm/torch/torch").xpos
    np.testing.assert_allclose(tip, [0.93, 0, 0.4506], atol=2e-3)  # m: the pose is given to 0.1 deg


def test_torch_pushed_into_the_table_collides(cell):
    model, _ = cell
    other = mujoco.MjData(model)
    other.qpos[:6] = np.deg2rad((-35.0, -80.0, 125.0, 0.0, 45.0, 180.0))
    mujoco.mj_forward(model, other)
    names = {model.geom(int(g)).name for contact in other.contact[: other.ncon] for g in contact.geom}
    assert "table_top" in names


def test_picture_shows_an_orange_arm(cell):
    model, data = cell
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = [0.45, 0, 0.5], 2.8, 135, -22
    with mujoco.Renderer(model, 120, 160) as renderer:
        renderer.update_scene(data, camera)
        picture = renderer.render().astype(int)
    orange = (picture[..., 0] > 120) & (picture[..., 0] > 2 * picture[..., 2]) & (picture[..., 1] < picture[..., 0])
    assert orange.mean() > 0.02  # the arm covers about 5 % of this view

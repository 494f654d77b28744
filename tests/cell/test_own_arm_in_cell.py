"""The cell with a user's arm and part: it stands, sees and reaches as with its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import CellConfig
from weldcell.cell.frames import difference, translation
from weldcell.cell.world.controller import nominal_arm
from weldcell.cell.world.drives import Drives
from weldcell.cell.world.joint_motion import JointPath
from weldcell.cell.world.motion import MotionPlanner, readings_along
from weldcell.cell.world.path_clock import PathClock
from weldcell.cell.world.robot_error import BUDGETS, draw_error
from weldcell.cell.world.scene import build_cell, build_controller, build_parts
from weldcell.models.sensor_head import HeadDesign
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.torch_poses import flange_at, torch_rotation
from weldcell.scenarios.user_cell.part_file import read_part
from weldcell.scenarios.user_cell.robot_file import read_robot

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "own_part_and_robot"
T_BASE_PLATE = translation([0.93, 0, 0.5])
UPRIGHT = torch_rotation(np.pi / 2, 0.0, 0.0) * T_FLANGE_TORCH.rotation.inv()


@pytest.fixture(scope="module")
def long_arm():
    return read_robot(EXAMPLES / "long_arm.yaml").arm


@pytest.fixture(scope="module")
def own_parts():
    return replace(build_parts(CellConfig()), plate=read_part(EXAMPLES / "arc_plate.yaml").workpiece)


@pytest.fixture(scope="module")
def own_known_cell(own_parts, long_arm):
    cell = build_cell(own_parts, HeadDesign(), None, own_arm=long_arm)
    cell.place("plate", T_BASE_PLATE)
    return cell


@pytest.fixture(scope="module")
def own_controller(own_known_cell, long_arm):
    return build_controller(own_known_cell, long_arm)


@pytest.mark.parametrize("seed", range(3))
def test_the_controller_believes_where_the_known_cell_stands(own_known_cell, own_controller, seed):
    low, high = own_controller.limits_rad.T
    joints_rad = np.random.default_rng(seed).uniform(low, high)
    own_known_cell.take(joints_rad)
    angle_rad, distance_m = difference(own_controller.forward(joints_rad), own_known_cell.T_base("flange"))
    assert angle_rad < 1e-9 and distance_m < 1e-9  # rounding through seven bodies


def test_torch_and_sensor_hang_on_its_flange_as_on_the_cells_own(own_known_cell, known_cell):
    own_known_cell.take(np.full(6, 0.3))
    known_cell.take(np.full(6, 0.2))
    for frame in ("torch", "camera"):
        own, usual = (c.T_base("flange").inv() * c.T_base(frame) for c in (own_known_cell, known_cell))
        assert max(difference(own, usual)) < 1e-9


def test_its_home_is_clear_with_the_torch_upright_over_the_table(own_known_cell, long_arm):
    assert not own_known_cell.collides(long_arm.home_rad)
    assert own_known_cell.T_base("torch").rotation.apply([0, 0, 1])[2] < -0.99
    assert own_known_cell.tip_base == pytest.approx([0.93, 0, 0.60], abs=0.02)  # m: home is in whole degrees


def test_it_reaches_the_whole_seam_of_the_own_part(own_known_cell, own_controller, own_parts, long_arm):
    planner = MotionPlanner(controller=own_controller, known_cell=own_known_cell, home_rad=long_arm.home_rad)
    line_base = T_BASE_PLATE.apply(own_parts.plate.seam_part.points["root"])[::40] + [0, 0, 0.03]
    joints_rad, furthest_rad = long_arm.home_rad, 0.0
    for k, point in enumerate(line_base):
        after_rad = own_controller.inverse(flange_at(point, UPRIGHT, T_FLANGE_TORCH.translation), joints_rad)
        own_known_cell.take(after_rad)
        assert own_known_cell.tip_base == pytest.approx(point, abs=1e-9)  # m
        assert planner.free(after_rad)
        furthest_rad = max(furthest_rad, np.abs(after_rad - joints_rad).max() if k else 0)
        joints_rad = after_rad
    assert furthest_rad < 0.3  # rad in 20 mm: it stays in its configuration
    motion = planner.move(long_arm.home_rad, joints_rad)
    assert np.all(
        np.abs(np.diff(motion.joints_rad, axis=0)) <= long_arm.speeds_rad_s * np.diff(motion.times_s)[:, None]
    )


def test_its_drives_follow_a_line_at_welding_speed(own_parts, own_known_cell, own_controller, long_arm):
    cell = build_cell(
        own_parts, HeadDesign(), draw_error(BUDGETS["typical"], np.random.default_rng(1)), own_arm=long_arm
    )
    ways_m, start = np.linspace(0, 0.1, 26), own_controller.forward(long_arm.home_rad)
    poses = RigidTransform.concatenate([translation([0, way_m, 0]) * start for way_m in ways_m])
    path = JointPath(ways_m, readings_along(own_controller, poses, long_arm.home_rad))
    motion = path.motion(PathClock(0.1, 1.0, end_m=0.1).advance(1e-3, 1150))
    drives = Drives(cell, own_known_cell)
    drives.start(motion.readings_rad[0])
    readings = drives.follow(*motion)
    off_m = own_controller.forward(readings).translation - own_controller.forward(motion.readings_rad).translation
    assert np.abs(off_m).max() < 1e-4 and not drives.saturated.any()
    assert drives.torque_shares(*motion).max() < 0.5


def test_the_actual_arm_misses_by_what_its_errors_are(own_parts, own_controller, long_arm):
    joints_rad, off_mm = long_arm.home_rad, []
    for seed in range(3):
        actual = build_cell(
            own_parts, HeadDesign(), draw_error(BUDGETS["typical"], np.random.default_rng(seed)), own_arm=long_arm
        )
        actual.take(joints_rad)
        off_mm.append(1e3 * difference(own_controller.forward(joints_rad), actual.T_base("flange"))[1])
    assert 0.3 < np.mean(off_mm) < 5  # mm: 0.03 deg on axes 1 to 3 move a flange 1.3 m away by about 1 mm each


def test_the_load_on_its_joints_is_that_of_mujoco(own_known_cell, own_controller, long_arm):
    """Masses and centres of the plain arm, put into the torque of gravity by hand, give MuJoCo's own torque."""
    arm = nominal_arm(own_controller, own_known_cell.model)
    there_nm = own_known_cell._gravity_torque_nm(np.zeros(6))
    own_nm = [
        sum(
            arm.link_masses_kg[j] * 9.81 * np.cross(arm.axes_base[k], arm.link_centres_base[j] - arm.anchors_base[k])[2]
            for j in range(k, 6)
        )
        for k in range(6)
    ]
    assert own_nm == pytest.approx(there_nm, abs=1e-6)  # Nm

"""Motions: within limits and speeds, clear of the parts, and starting and ending where they should."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import translation
from weldcell.cell.world.motion import MotionPlanner, readings_along
from weldcell.cell.world.scene import HOME_RAD, SHELF


@pytest.fixture
def planner(known_cell, controller):
    for part, T_base_shelf in SHELF.items():
        known_cell.place(part, T_base_shelf)
    return MotionPlanner(controller=controller, known_cell=known_cell, home_rad=HOME_RAD)


def low_beside(planner, y_m: float) -> np.ndarray:
    """A posture with the tool low over the table, beside its middle."""
    T_base_flange = planner.controller.forward(HOME_RAD)
    down = translation([0, y_m, -0.30]) * T_base_flange
    return planner.controller.inverse(down, HOME_RAD)


def test_a_free_way_is_taken_straight_in_joint_space(planner):
    motion = planner.move(HOME_RAD, HOME_RAD + 0.2)
    shares = (motion.joints_rad - HOME_RAD) / 0.2
    assert np.allclose(shares, shares[:, :1], atol=1e-9)
    assert np.array_equal(motion.joints_rad[0], HOME_RAD)
    assert np.allclose(motion.joints_rad[-1], HOME_RAD + 0.2)


def test_no_joint_exceeds_its_speed(planner):
    motion = planner.move(low_beside(planner, -0.2), low_beside(planner, 0.2))
    speeds = np.abs(np.diff(motion.joints_rad, axis=0)) / np.diff(motion.times_s)[:, None]
    assert np.all(speeds <= planner.controller.speeds_rad_s)
    assert np.all(np.diff(motion.times_s) > 0)


def test_a_part_in_the_way_is_passed_clear_of_it(planner):
    start_rad, goal_rad = low_beside(planner, -0.25), low_beside(planner, 0.25)
    tip_z = planner.known_cell
    tip_z.take(start_rad)
    x_m, _, z_m = tip_z.tip_base
    planner.known_cell.place("boss", translation([x_m, 0.0, z_m - 0.03]))
    straight = start_rad + np.linspace(0, 1, 60)[:, None] * (goal_rad - start_rad)
    assert any(not planner.free(q) for q in straight)
    motion = planner.move(start_rad, goal_rad)
    assert all(planner.free(q) for q in motion.joints_rad)


def test_a_goal_inside_a_part_has_no_way(planner):
    goal_rad = low_beside(planner, 0.0)
    planner.known_cell.take(goal_rad)
    planner.known_cell.place("boss", translation(planner.known_cell.tip_base - [0, 0, 0.03]))
    with pytest.raises(OutOfReach, match="no path clear of the parts"):
        planner.move(HOME_RAD, goal_rad)


def test_readings_beyond_the_limits_are_not_free(planner):
    assert planner.free(HOME_RAD)
    beyond = HOME_RAD.copy()
    beyond[4] = planner.controller.limits_rad[4, 1] + 1e-6
    assert not planner.free(beyond)


def test_a_stretched_wrist_does_not_work(planner):
    stretched = HOME_RAD.copy()
    stretched[4] = np.radians(19)
    bent = HOME_RAD.copy()
    bent[4] = np.radians(21)
    assert planner.working(HOME_RAD) and planner.working(bent) and planner.free(stretched)
    assert not planner.working(stretched)


def line(controller, way_m, count=21):
    """Flange poses on a straight line from home."""
    start = controller.forward(HOME_RAD)
    poses = [translation(share * np.asarray(way_m)) * start for share in np.linspace(0, 1, count)]
    return RigidTransform.concatenate(poses)


def test_readings_along_a_line_take_the_flange_along_it(controller):
    poses = line(controller, [0.0, 0.2, -0.1])
    readings = readings_along(controller, poses, HOME_RAD)
    assert np.array_equal(readings[0], HOME_RAD)
    off = poses.inv() * controller.forward(readings)
    assert np.abs(off.translation).max() < 1e-9 and off.rotation.magnitude().max() < 1e-9  # m, rad: rounding
    assert np.abs(np.diff(readings, axis=0)).max() < 0.1  # rad in some 11 mm: one configuration


def test_a_line_out_of_reach_has_no_readings(controller):
    assert readings_along(controller, line(controller, [2.0, 0.0, 0.0]), HOME_RAD) is None


def test_a_line_that_turns_the_wrist_over_has_no_readings(controller):
    """The flange turned by half a turn between two poses takes some joint further than a path may."""
    start = controller.forward(HOME_RAD)
    turned = start * RigidTransform.from_rotation(Rotation.from_euler("x", 170, degrees=True))
    assert readings_along(controller, RigidTransform.concatenate([start, turned]), HOME_RAD) is None

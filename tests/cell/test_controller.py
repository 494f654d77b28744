"""The nominal robot: forward kinematics against MuJoCo's, inverse kinematics within limits."""

import numpy as np
import pytest

from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import translation
from weldcell.cell.world.scene import HOME_RAD

FORWARD = 1e-12  # m and rotation entries: rounding
INVERSE = 1e-9  # m and rotation entries: the closed form's rounding near its singularities


def random_joints(controller, count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform(*controller.limits_rad.T, size=(count, 6))


def test_forward_agrees_with_mujoco(known_cell, controller):
    joints_rad = random_joints(controller, 200)
    T_base_flange = controller.forward(joints_rad).as_matrix()
    for q, T in zip(joints_rad, T_base_flange, strict=True):
        known_cell.take(q)
        assert np.abs(known_cell.T_base("flange").as_matrix() - T).max() < FORWARD


def test_every_inverse_reaches_the_pose_within_limits_and_the_readings_are_among_them(controller):
    low, high = controller.limits_rad.T
    for q in random_joints(controller, 200):
        T_base_flange = controller.forward(q)
        readings = controller.all_inverse(T_base_flange)
        reached = controller.forward(readings).as_matrix()
        assert np.abs(reached - T_base_flange.as_matrix()).max() < INVERSE
        assert np.all((readings >= low) & (readings <= high))
        assert np.abs(readings - q).max(axis=1).min() < 1e-6  # rad


def test_inverse_takes_the_readings_next_to_where_the_arm_is(controller):
    target = controller.forward(HOME_RAD + 0.01)
    assert np.allclose(controller.inverse(target, HOME_RAD), HOME_RAD + 0.01, atol=1e-9)


def test_a_pose_out_of_reach_is_an_error_that_names_the_place(controller):
    with pytest.raises(OutOfReach, match=r"9\d\d\d\.\d"):
        controller.inverse(translation([9.0, 0, 0]) * controller.forward(HOME_RAD), HOME_RAD)

"""The plain numbers of the controller's arm, held against MuJoCo: with the actual errors they are the actual robot."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.calib.arm_model import gravity_torques_nm
from weldcell.calib.calibrated_arm import CalibratedArm
from weldcell.cell.world.controller import nominal_arm
from weldcell.cell.world.robot_error import RobotError
from weldcell.cell.world.scene import HOME_RAD


@pytest.fixture(scope="module")
def arm(controller, known_cell):
    return nominal_arm(controller, known_cell.model)


def postures(count=6):
    return HOME_RAD + np.random.default_rng(0).uniform(-0.4, 0.4, (count, 6))


def errors_in_base_axes(model: mujoco.MjModel, error: RobotError) -> np.ndarray:
    """Offsets are given in the parent's axes, twists in the link's own; both as they stand at readings of zero."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    links = [model.body(f"arm/link_{k + 1}").id for k in range(6)]
    own = [Rotation.from_matrix(data.xmat[link].reshape(3, 3)) for link in links]
    parents = [Rotation.from_matrix(data.xmat[model.body_parentid[link]].reshape(3, 3)) for link in links]
    offsets = [turn.apply(offset) for turn, offset in zip(parents, error.link_m, strict=True)]
    twists = [turn.apply(twist) for turn, twist in zip(own, error.twist_rad, strict=True)]
    return np.concatenate([np.ravel(offsets), np.ravel(twists), error.zero_rad, error.compliance_rad_per_nm])


def test_without_errors_it_is_where_the_controller_says(arm, controller):
    found = CalibratedArm(nominal=arm, errors=np.zeros(48)).flanges(postures())
    assert found.as_matrix() == pytest.approx(controller.forward(postures()).as_matrix(), abs=1e-14)


def test_torques_are_those_that_hold_the_known_cell(arm, known_cell):
    model, data = known_cell.model, mujoco.MjData(known_cell.model)
    joints = [model.joint(f"arm/joint_{k + 1}") for k in range(6)]
    for posture, found in zip(postures(), gravity_torques_nm(arm, postures()), strict=True):
        data.qpos[[joint.qposadr[0] for joint in joints]] = posture
        mujoco.mj_forward(model, data)
        held = data.qfrc_bias[[joint.dofadr[0] for joint in joints]]
        assert found == pytest.approx(held, abs=1e-9) and np.abs(held).max() > 20  # Nm


def test_with_the_actual_errors_it_is_the_actual_robot(arm, known_cell, typical_cell):
    errors = errors_in_base_axes(known_cell.model, typical_cell.error)
    found = CalibratedArm(nominal=arm, errors=errors).flanges(postures())
    for index, posture in enumerate(postures()):
        typical_cell.take(posture)
        apart_m = np.linalg.norm(typical_cell.T_base("flange").translation - found[index].translation)
        assert apart_m < 2e-6  # the nominal arm's torques for the actual one's: a thousandth of a millimetre of sag

"""The drives: what holds at rest, what lags, what feed-forward leaves, and what friction does."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import impulse
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadInput
from weldcell.cell.seam import distance_to_polyline
from weldcell.cell.world.bare_arm import BareArm
from weldcell.cell.world.drives import Drives
from weldcell.cell.world.joint_motion import JointMotion, JointPath
from weldcell.cell.world.motion import readings_along
from weldcell.cell.world.path_clock import PathClock
from weldcell.cell.world.robot_error import BUDGETS, draw_error, exact_robot
from weldcell.cell.world.scene import HOME_RAD, build_cell
from weldcell.models.sensor_head import HeadDesign
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.torch_poses import flange_at, torch_rotation

STILL = np.zeros(6)
BANDS_RAD_S = 2 * np.pi * np.array([25, 25, 40, 40, 40, 40])  # of the velocity loops


@pytest.fixture(scope="module")
def exact_cell(parts):
    return build_cell(parts, HeadDesign(), exact_robot())


@pytest.fixture(scope="module")
def smooth_cell(parts):
    """An arm as drawn, without friction."""
    cell = build_cell(parts, HeadDesign(), exact_robot())
    cell.model.dof_frictionloss[:] = cell.model.dof_damping[:] = 0
    return cell


@pytest.fixture(scope="module")
def s_path(controller):
    """Readings along an S of 20 mm to either side over 300 mm, on the table's middle, the torch turning with it."""
    x, swing = np.linspace(-0.15, 0.15, 151), 2 * np.pi / 0.3
    points_base = np.column_stack([0.93 - 0.02 * np.sin(swing * x), x, np.full(151, 0.36)])
    headings = np.arctan2(1.0, -0.02 * swing * np.cos(swing * x))
    poses = [
        flange_at(point, torch_rotation(heading) * T_FLANGE_TORCH.rotation.inv(), T_FLANGE_TORCH.translation)
        for point, heading in zip(points_base, headings, strict=True)
    ]
    readings = readings_along(controller, RigidTransform.concatenate(poses), controller.inverse(poses[0], HOME_RAD))
    steps_m = np.linalg.norm(np.diff(points_base, axis=0), axis=1)
    return JointPath(np.concatenate([[0], np.cumsum(steps_m)]), readings), steps_m.sum()


def along(s_path, speed_m_s, servo_hz=1000.0, acceleration_m_s2=1.0):
    path, length_m = s_path
    clock = PathClock(speed_m_s, acceleration_m_s2, end_m=length_m)
    duration_s = length_m / speed_m_s + 1.5 * speed_m_s / acceleration_m_s2 + 0.1
    return path.motion(clock.advance(1 / servo_hz, int(duration_s * servo_hz)))


def first(motion, seconds, servo_hz=1000.0):
    return JointMotion(*(part[: int(seconds * servo_hz)] for part in motion))


def followed(drives, motion):
    drives.start(motion.readings_rad[0])
    return drives.follow(*motion)


def tip_errors_mm(controller, motion, readings):
    """Errors of the tip along the path at each time, and distances from the path wherever along it the tip is."""
    tip = T_FLANGE_TORCH.translation
    wanted, got = controller.forward(motion.readings_rad).apply(tip), controller.forward(readings).apply(tip)
    moving = np.linalg.norm(motion.rates_rad_s, axis=1) > 1e-3
    tangents = np.gradient(wanted, axis=0)[moving]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    lag = np.sum((wanted - got)[moving] * tangents, axis=1)
    return 1e3 * lag, 1e3 * distance_to_polyline(got[moving][::10], wanted[moving][::10])


@pytest.mark.parametrize("feed_forward", [True, False])
def test_a_held_posture_does_not_drift(typical_cell, known_cell, feed_forward):
    drives = Drives(typical_cell, known_cell, feed_forward=feed_forward)
    drives.start(HOME_RAD)
    held = drives.follow(np.tile(HOME_RAD, (1000, 1)), np.zeros((1000, 6)), np.zeros((1000, 6)))
    assert held == pytest.approx(np.tile(HOME_RAD, (1000, 1)), abs=1e-12)  # rad: rounding
    assert not drives.saturated.any()


@pytest.mark.parametrize("seed", range(3))
def test_what_holds_the_bare_arm_is_what_holds_the_cells(typical_cell, seed):
    joints_rad = np.random.default_rng(seed).uniform(-2, 2, 6)
    bare_nm = BareArm(typical_cell.model, 1e-3).torque_nm(joints_rad, STILL, STILL)
    assert bare_nm == pytest.approx(typical_cell._gravity_torque_nm(joints_rad), abs=1e-9)  # Nm


def test_a_falling_arm_keeps_its_energy(exact_cell):
    """Kinetic energy gained is the work of the weights: gravity's torque along the way (trapezoids)."""
    arm = BareArm(exact_cell.model, 2e-4)
    arm.put(HOME_RAD)
    work_j = 0.0
    for _ in range(1500):
        before_rad = arm.angles_rad
        arm.step(STILL)
        middle_rad = 0.5 * (before_rad + arm.angles_rad)
        work_j -= arm.torque_nm(middle_rad, STILL, STILL) @ (arm.angles_rad - before_rad)
    weight_nm = arm.torque_nm(before_rad, STILL, STILL)
    momentum = arm.torque_nm(before_rad, STILL, arm.rates_rad_s) - weight_nm  # M q', by inverse dynamics
    assert work_j > 10  # J, after 0.3 s
    assert 0.5 * arm.rates_rad_s @ momentum == pytest.approx(work_j, rel=2e-3)  # the rates are half a step old


@pytest.mark.parametrize("joint", [0, 5])
def test_without_feed_forward_a_steady_motion_lags_by_its_rate_over_the_position_gain(typical_cell, known_cell, joint):
    drives = Drives(typical_cell, known_cell, feed_forward=False)
    rates = np.zeros((800, 6))
    rates[:, joint] = np.minimum(np.arange(800) / 200, 1) * 0.05
    commands = HOME_RAD + np.cumsum(rates, axis=0) * 1e-3
    drives.start(HOME_RAD)
    lag_rad = commands[-1] - drives.follow(commands, rates, np.zeros((800, 6)))[-1]
    assert drives.position_gain_1_s == pytest.approx(2 * np.pi * 25 / 5)
    assert lag_rad[joint] == pytest.approx(0.05 / drives.position_gain_1_s, rel=0.01)  # what is left after 0.6 s
    assert np.abs(np.delete(lag_rad, joint)).max() < 2e-5  # rad: the others stay


def test_with_feed_forward_a_known_arm_without_friction_does_not_err(smooth_cell, s_path):
    largest = {}
    for servo_hz in (500.0, 1000.0, 2000.0):
        motion = first(along(s_path, 0.1, servo_hz), 0.4, servo_hz)
        readings = followed(Drives(smooth_cell, smooth_cell, servo_hz), motion)
        largest[servo_hz] = np.abs(readings - motion.readings_rad).max()
    assert largest[1000.0] < 2e-6  # rad: 2 um at the torch
    assert largest[2000.0] < 0.6 * largest[1000.0] < 0.36 * largest[500.0] * 1.01  # the servo's period does it


def test_known_friction_is_compensated(exact_cell, known_cell, s_path, controller):
    motion = first(along(s_path, 0.1), 1.2)
    lag_mm, off_mm = tip_errors_mm(controller, motion, followed(Drives(exact_cell, known_cell), motion))
    assert np.abs(lag_mm).max() < 0.01 and off_mm.max() < 0.01


@pytest.mark.parametrize("joint", [0, 4])
def test_unknown_friction_leaves_the_spike_of_the_linear_loop_at_a_reversal(parts, known_cell, joint):
    """A reversal fast enough to be a step of torque: twice the friction that is not known."""
    ratio = np.zeros(6)
    ratio[joint] = 0.3
    cell = build_cell(parts, HeadDesign(), replace(exact_robot(), friction_ratio=ratio))
    times_s, wave = np.arange(1, 1451)[:, None] * 1e-3, 2 * np.pi * 1.0
    only = np.eye(6)[joint]
    commands = HOME_RAD + only * 0.2 * (1 - np.cos(wave * times_s))
    rates, accelerations = only * 0.2 * wave * np.sin(wave * times_s), only * 0.2 * wave**2 * np.cos(wave * times_s)
    drives = Drives(cell, known_cell)
    drives.start(HOME_RAD)
    error_rad = np.abs(drives.follow(commands, rates, accelerations) - commands)[:, joint]
    dof = known_cell.model.joint(f"arm/joint_{joint + 1}").dofadr[0]
    inertia = BareArm(known_cell.model, 1e-3).inertias_kgm2(HOME_RAD)[joint]
    step_nm = 2 * 0.3 * known_cell.model.dof_frictionloss[dof]
    band, gain = BANDS_RAD_S[joint], drives.position_gain_1_s
    loop = ([1 / inertia], [1, band, band * gain + band**2 / 4, band**2 * gain / 4])  # the docstring's, for a step
    expected_rad = step_nm * impulse(loop, T=np.linspace(0, 0.3, 3001))[1].max()
    # The friction turns round within some ms, and viscous friction and couplings act as well.
    assert error_rad[1000:1300].max() == pytest.approx(expected_rad, rel=0.2)
    assert error_rad[1250:1450].max() < 0.1 * error_rad[1000:1300].max()  # gone between two reversals


@pytest.mark.parametrize("seed", [1, 3])
def test_the_torch_stays_on_an_s_path(parts, known_cell, controller, s_path, seed):
    cell = build_cell(parts, HeadDesign(), draw_error(BUDGETS["typical"], np.random.default_rng(seed)))
    motion = first(along(s_path, 0.1), 2.0)  # all joints have turned back by then
    drives = Drives(cell, known_cell)
    lag_mm, off_mm = tip_errors_mm(controller, motion, followed(drives, motion))
    assert off_mm.mean() < 0.02 and off_mm.max() < 0.1
    assert np.abs(lag_mm).max() < 0.1
    assert not drives.saturated.any()


def test_without_feed_forward_the_torch_lags_on_an_s_path(typical_cell, known_cell, controller, s_path):
    motion = first(along(s_path, 0.1), 1.0)
    drives = Drives(typical_cell, known_cell, feed_forward=False)
    lag_mm, _ = tip_errors_mm(controller, motion, followed(drives, motion))
    assert np.median(lag_mm) == pytest.approx(100 / drives.position_gain_1_s, rel=0.02)  # mm: at 100 mm/s


def test_readings_are_what_the_encoders_show_and_not_the_arms_angles(parts, known_cell):
    zero_rad = np.radians([0.1, -0.2, 0.3, 0.1, 0.2, -0.1])
    drives = Drives(build_cell(parts, HeadDesign(), replace(exact_robot(), zero_rad=zero_rad)), known_cell)
    drives.start(HOME_RAD)
    assert drives.step(HOME_RAD, STILL, STILL) == pytest.approx(HOME_RAD, abs=1e-12)
    assert drives._arm.angles_rad == pytest.approx(HOME_RAD + zero_rad, abs=1e-12)


def test_a_command_beyond_a_motors_torque_is_seen_until_the_next_start(typical_cell, known_cell):
    drives = Drives(typical_cell, known_cell)
    drives.start(HOME_RAD)
    drives.step(HOME_RAD, STILL, np.array([0, 0, 0, 0, 0, 1000.0]))
    assert not drives.saturated.any()  # it is due at the period's end
    drives.follow(np.tile(HOME_RAD, (5, 1)), np.zeros((5, 6)), np.zeros((5, 6)))
    assert drives.saturated[5] and not drives.saturated[:3].any()
    drives.start(HOME_RAD)
    assert not drives.saturated.any()


def test_a_jump_of_the_command_saturates_and_is_recovered_from(typical_cell, known_cell):
    drives = Drives(typical_cell, known_cell)
    drives.start(HOME_RAD)
    target = HOME_RAD + 0.1
    late = drives.follow(np.tile(target, (800, 1)), np.zeros((800, 6)), np.zeros((800, 6)))
    assert drives.saturated.any()
    assert np.abs(late).max() < 4 and late[-1] == pytest.approx(target, abs=1e-4)  # rad: without winding up


def test_the_share_of_torque_at_rest_is_the_weights(known_cell):
    drives = Drives(known_cell, known_cell)
    shares = drives.torque_shares(HOME_RAD[None], STILL[None], STILL[None])[0]
    assert shares == pytest.approx(np.abs(known_cell._gravity_torque_nm(HOME_RAD)) / drives.limits_nm, abs=1e-9)


@pytest.mark.parametrize("servo_hz", [100.0, 250.0, 2000.0])
def test_servos_of_any_rate_are_stable(typical_cell, known_cell, s_path, servo_hz):
    motion = first(along(s_path, 0.1, servo_hz), 0.5, servo_hz)
    drives = Drives(typical_cell, known_cell, servo_hz)
    error_rad = followed(drives, motion) - motion.readings_rad
    assert np.abs(error_rad).max() < 0.02 and not drives.saturated.any()  # rad; the slow ones follow worse
    count = int(servo_hz / 2)
    held = drives.follow(np.tile(motion.readings_rad[-1], (count, 1)), np.zeros((count, 6)), np.zeros((count, 6)))
    assert np.ptp(held[-count // 5 :], axis=0).max() < 3e-3  # rad in 0.1 s: slow servos creep into place


def test_stretches_can_be_cut_anywhere_and_repeat_to_the_bit(typical_cell, known_cell, s_path):
    motion = tuple(part[:400] for part in along(s_path, 0.1))
    drives = Drives(typical_cell, known_cell)
    drives.start(motion[0][0])
    whole = drives.follow(*motion)
    drives.start(motion[0][0])
    cut = np.concatenate([drives.follow(*(part[a:b] for part in motion)) for a, b in ((0, 1), (1, 130), (130, 400))])
    again = Drives(typical_cell, known_cell)
    again.start(motion[0][0])
    assert whole.tobytes() == cut.tobytes() == again.follow(*motion).tobytes()


def test_a_command_that_is_not_a_number_is_refused_before_anything_moves(known_cell):
    drives = Drives(known_cell, known_cell)
    drives.start(HOME_RAD)
    with pytest.raises(BadInput, match="not a number"):
        drives.step(HOME_RAD, np.full(6, np.nan), STILL)
    assert drives.readings_rad == pytest.approx(HOME_RAD, abs=1e-15)


@pytest.mark.parametrize("servo_hz", [0.0, 50.0, np.nan, 1e6])
def test_a_servo_rate_out_of_reason_is_refused(known_cell, servo_hz):
    with pytest.raises(BadInput, match="servo_hz"):
        Drives(known_cell, known_cell, servo_hz)

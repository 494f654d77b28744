"""Smooth motions from readings along a path and from readings at the controller's rate."""

import numpy as np
import pytest

from weldcell.cell.errors import BadInput
from weldcell.cell.world.joint_motion import CommandSmoother, JointPath
from weldcell.cell.world.path_clock import PathClock, PathTimes

START_RAD = np.array([0.1, -1.0, 1.2, 0.3, 0.8, -0.5])


def bent(x):
    """Readings that bend: a sine for each joint, with its two derivatives."""
    waves = np.array([3.0, 5.0, 7.0, 9.0, 11.0, 13.0])
    phase = np.multiply.outer(x, waves)
    return np.sin(phase), waves * np.cos(phase), -(waves**2) * np.sin(phase)


def test_a_path_gives_readings_rates_and_accelerations_by_the_chain_rule():
    places_m = np.linspace(0, 0.3, 151)
    path = JointPath(places_m, bent(places_m)[0])
    times = PathTimes(np.linspace(0.01, 0.29, 57), np.linspace(0.02, 0.1, 57), np.linspace(-1, 1, 57))
    motion = path.motion(times)
    value, slope, bend = bent(times.arc_length_m)
    speed, acceleration = times.speed_m_s[:, None], times.acceleration_m_s2[:, None]
    assert motion.readings_rad == pytest.approx(value, abs=1e-9)  # rad: quintic on 2 mm steps
    assert motion.rates_rad_s == pytest.approx(slope * speed, abs=1e-6)
    assert motion.accelerations_rad_s2 == pytest.approx(bend * speed**2 + slope * acceleration, abs=1e-4)


def test_a_motion_along_a_path_is_its_own_derivative():
    places_m = np.linspace(0, 0.3, 151)
    motion = JointPath(places_m, bent(places_m)[0]).motion(PathClock(0.1, 1.0, end_m=0.3).advance(1e-3, 3200))
    rates = np.gradient(motion.readings_rad, 1e-3, axis=0)[1:-1]
    assert rates == pytest.approx(motion.rates_rad_s[1:-1], abs=1e-4)  # rad/s: jerk x step^2 / 6
    accelerations = np.gradient(motion.rates_rad_s, 1e-3, axis=0)[1:-1]
    assert accelerations == pytest.approx(motion.accelerations_rad_s2[1:-1], abs=0.2)  # rad/s2: kinks of the ramps


def test_the_share_of_the_joints_speeds_is_that_of_the_steepest_place():
    path = JointPath(np.linspace(0, 0.3, 31), START_RAD + np.outer(np.linspace(0, 0.3, 31), np.arange(6)))
    shares = path.speed_shares(0.1, np.full(6, 2.0))  # k rad/m at 0.1 m/s over 2 rad/s
    assert shares == pytest.approx(0.05 * np.arange(6), abs=1e-9)


def test_arc_lengths_that_go_back_are_refused():
    with pytest.raises(BadInput, match="increasing"):
        JointPath(np.array([0, 0.1, 0.1]), np.zeros((3, 6)))


def smoothed(commands_rad, command_hz, servo_hz, start_rad=START_RAD):
    smoother = CommandSmoother(start_rad, command_hz, servo_hz)
    parts = [smoother.add(command) for command in commands_rad]
    return tuple(np.concatenate(column) for column in zip(*parts, strict=True))


@pytest.mark.parametrize(("command_hz", "servo_hz"), [(125.0, 1000.0), (30.0, 1000.0), (83.0, 4000.0), (125.0, 125.0)])
def test_a_steady_motion_is_kept_and_comes_two_periods_later(command_hz, servo_hz):
    rate_rad_s = np.linspace(-0.2, 0.3, 6)
    due_s = (np.arange(60) + 2) / command_hz  # commands are given two periods ahead
    readings, rates, accelerations = smoothed(START_RAD + np.outer(due_s, rate_rad_s), command_hz, servo_hz)
    assert len(readings) == int(60 / command_hz * servo_hz + 1e-6)
    times_s = (np.arange(len(readings)) + 1) / servo_hz
    steady = times_s > 4 / command_hz
    assert readings[steady] == pytest.approx(START_RAD + np.outer(times_s, rate_rad_s)[steady], abs=1e-12)
    assert rates[steady] == pytest.approx(np.tile(rate_rad_s, (steady.sum(), 1)), abs=1e-10)
    assert accelerations[steady] == pytest.approx(np.zeros((steady.sum(), 6)), abs=1e-7)


def test_a_bend_is_cut_by_its_acceleration_times_a_sixth_of_the_period_squared():
    due_s = (np.arange(60) + 2) / 125
    bend_rad_s2 = np.linspace(0.1, 0.6, 6)
    readings, _, accelerations = smoothed(START_RAD + 0.5 * np.outer(due_s**2, bend_rad_s2), 125, 1000)
    times_s = (np.arange(len(readings)) + 1) / 1000
    cut_rad = readings - START_RAD - 0.5 * np.outer(times_s**2, bend_rad_s2)
    assert cut_rad[40:] == pytest.approx(np.tile(bend_rad_s2 / 6 / 125**2, (len(cut_rad) - 40, 1)), abs=1e-12)
    assert accelerations[40:] == pytest.approx(np.tile(bend_rad_s2, (len(cut_rad) - 40, 1)), abs=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_even_jumping_commands_give_a_motion_that_is_its_own_derivative(seed):
    commands = START_RAD + 1e-3 * np.random.default_rng(seed).normal(size=(40, 6))
    readings, rates, accelerations = smoothed(commands, 125, 8000)
    step_s = 1 / 8000
    assert np.diff(readings, axis=0) / step_s == pytest.approx(0.5 * (rates[1:] + rates[:-1]), abs=1e-3)
    assert np.diff(rates, axis=0) / step_s == pytest.approx(0.5 * (accelerations[1:] + accelerations[:-1]), abs=1e-6)


def test_it_rests_where_it_starts_and_where_the_last_command_stays():
    readings, rates, _ = smoothed(np.vstack([np.tile(START_RAD, (3, 1)), np.tile(START_RAD + 0.01, (5, 1))]), 125, 1000)
    assert np.array_equal(rates[:24], np.zeros((24, 6))) or np.abs(rates[:24]).max() < 1e-12
    assert readings[-1] == pytest.approx(START_RAD + 0.01, abs=1e-15)
    assert np.abs(rates[-8:]).max() < 1e-12


def test_commands_faster_than_the_servos_are_refused():
    with pytest.raises(BadInput, match="command_hz"):
        CommandSmoother(START_RAD, 2000, 1000)

"""Inverse kinematics without a closed form: exact where it answers, and it finds what the closed form finds."""

import numpy as np
import pytest

from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import translation
from weldcell.cell.world.controller import Controller
from weldcell.cell.world.numerical_inverse import NumericalInverse

X, Y, Z = np.eye(3)
LIMITS_RAD = np.radians([[-170, 170], [-85, 120], [-150, 95], [-200, 200], [-125, 125], [-360, 360]])
EXACT = 1e-9  # m and rad: hundred times what Newton's last step leaves


def arm(wrist_offset_m):
    """A 2 m class arm whose axis 5 runs below axis 4 by this much; 0 makes its wrist spherical."""
    low = 1.55 - wrist_offset_m
    return Controller(
        axes_base=np.array([Z, Y, Y, X, Y, X]),
        anchors_base=np.array(
            [[0, 0, 0], [0.25, 0, 0.55], [0.25, 0, 1.4], [0.25, 0, 1.55], [1.0, 0, low], [1.0, 0, low]]
        ),
        T_base_flange_zero=translation([1.12, 0, low]),
        limits_rad=LIMITS_RAD,
        speeds_rad_s=np.ones(6),
    )


def postures(rng, count):
    return rng.uniform(*LIMITS_RAD.T, (count, 6))


def numerical(controller):
    return NumericalInverse(
        axes_base=controller.axes_base,
        anchors_base=controller.anchors_base,
        T_base_flange_zero=controller.T_base_flange_zero,
    )


def missed(T_a, T_b):
    off = T_a.inv() * T_b
    return max(np.abs(off.translation).max(), off.rotation.magnitude())


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("wrist_offset_m", [0.03, 0.07, 0.15])
def test_an_offset_wrist_is_solved_over_the_whole_workspace(wrist_offset_m, seed):
    controller, found = arm(wrist_offset_m), 0
    assert not controller.has_closed_form
    tries = postures(np.random.default_rng(seed), 12)
    for joints_rad in tries:
        T_base_flange = controller.forward(joints_rad)
        readings = controller.all_inverse(T_base_flange)
        assert max(missed(controller.forward(q), T_base_flange) for q in readings) < EXACT
        low, high = LIMITS_RAD.T
        assert np.all((readings >= low) & (readings <= high))
        found += np.abs(readings - joints_rad).max(axis=1).min() < 1e-6  # rad: distinct solutions lie further apart
    assert found == len(tries)


@pytest.mark.parametrize("seed", range(3))
def test_it_finds_what_the_closed_form_finds(seed):
    controller = arm(0.0)
    assert controller.has_closed_form
    for joints_rad in postures(np.random.default_rng(seed), 4):
        T_base_flange = controller.forward(joints_rad)
        closed = controller._closed(T_base_flange)
        found = numerical(controller).all(T_base_flange)
        for q in closed:
            assert np.abs(np.angle(np.exp(1j * (found - q)))).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_three_parallel_axes_are_solved_in_closed_form(seed):
    """The other family that robots are built in: no wrist centre, axes 2, 3 and 4 parallel."""
    controller = Controller(
        axes_base=np.array([Z, Y, Y, Y, -Z, Y]),
        anchors_base=np.array(
            [[0, 0, 0], [0, 0.1, 0.1], [0.6, 0.1, 0.1], [1.1, 0.1, 0.1], [1.1, 0.2, 0.1], [1.1, 0.2, 0]]
        ),
        T_base_flange_zero=translation([1.1, 0.3, 0]),
        limits_rad=np.tile([-2 * np.pi, 2 * np.pi], (6, 1)),
        speeds_rad_s=np.ones(6),
    )
    assert controller.has_closed_form
    for joints_rad in np.random.default_rng(seed).uniform(-3, 3, (5, 6)):
        T_base_flange = controller.forward(joints_rad)
        readings = controller.all_inverse(T_base_flange)
        assert max(missed(controller.forward(q), T_base_flange) for q in readings) < EXACT
        assert np.abs(readings - joints_rad).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_the_jacobian_is_the_derivative_of_the_flange(seed):
    controller = arm(0.07)
    joints_rad, step = postures(np.random.default_rng(seed), 1)[0], 1e-6
    jacobian = numerical(controller).jacobian(joints_rad[None])[0]
    for k in range(6):
        ends = [controller.forward(joints_rad + sign * step * np.eye(6)[k]) for sign in (-1, 1)]
        speed = (ends[1].translation - ends[0].translation) / (2 * step)
        turn = (ends[1].rotation * ends[0].rotation.inv()).as_rotvec() / (2 * step)
        assert jacobian[:, k] == pytest.approx(np.concatenate([speed, turn]), abs=1e-8)  # of the difference quotient


def test_the_nearest_solution_is_the_one_that_a_path_goes_on_with():
    controller = arm(0.07)
    joints_rad = np.radians([10, 20, 10, 30, 60, -20])
    for _ in range(20):
        T_base_flange = translation([0.0, 0.01, -0.005]) * controller.forward(joints_rad)
        after_rad = controller.inverse(T_base_flange, joints_rad)
        assert missed(controller.forward(after_rad), T_base_flange) < EXACT
        assert np.abs(after_rad - joints_rad).max() < 0.1  # rad: no jump to another configuration
        joints_rad = after_rad


def test_out_of_reach_is_said_and_not_answered():
    with pytest.raises(OutOfReach, match="within its joint limits"):
        arm(0.07).inverse(translation([2.5, 0, 1.0]), np.zeros(6))


def test_the_wrists_sine_is_that_of_joint_five_for_axes_that_meet_squarely():
    for fifth_deg in (-100.0, -15.0, 0.0, 40.0):
        joints_rad = np.radians([5, 10, 20, 70, fifth_deg, 12])
        assert arm(0.07).wrist_sine(joints_rad) == pytest.approx(abs(np.sin(np.radians(fifth_deg))), abs=1e-12)

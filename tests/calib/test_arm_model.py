import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synthetic_arm
from weldcell.calib.arm_model import chain, gravity_torques_nm
from weldcell.calib.calibrated_arm import CalibratedArm
from weldcell.calib.joint_problem import Sizes

ARM = synthetic_arm.nominal_arm()


def somewhere(seed, count=7):
    rng = np.random.default_rng(seed)
    return synthetic_arm.HOME_RAD + rng.uniform(-0.5, 0.5, (count, 6)), rng


def errors_of(arm):
    """The fabricated arm's errors in the model's terms: offsets and twists in axes that are the base's at zero."""
    bodies = [(np.eye(3), np.zeros(3))]
    bodies += [(turn[0], origin[0]) for turn, origin in synthetic_arm.EXACT._bodies(np.zeros((1, 6)))]
    offsets = [bodies[k][0] @ arm.link_m[k] for k in range(6)]
    twists = [bodies[k + 1][0] @ arm.twist_rad[k] for k in range(6)]
    return np.concatenate([np.ravel(offsets), np.ravel(twists), arm.zero_rad, arm.compliance_rad_per_nm])


@pytest.mark.parametrize("size", [0.0, 1.0, 30.0])
def test_the_flange_is_where_a_chain_of_bodies_puts_it(size):
    joints_rad, rng = somewhere(0)
    sizes = Sizes(**{name: max(size, 1e-12) * value for name, value in vars(Sizes()).items()})
    arm = synthetic_arm.drawn_arm(rng, sizes)
    found = CalibratedArm(nominal=ARM, errors=errors_of(arm)).flanges(joints_rad).as_matrix()
    assert found == pytest.approx(arm.flanges(joints_rad).as_matrix(), abs=1e-12)


def test_torques_are_the_slope_of_the_potential_energy():
    joints_rad, _ = somewhere(1)
    expected = synthetic_arm.held_torques_nm(joints_rad)
    assert np.abs(expected).max() > 100  # Nm
    assert gravity_torques_nm(ARM, joints_rad) == pytest.approx(expected, abs=1e-8)  # of a difference of energies


def test_derivatives_are_those_of_the_flange():
    joints_rad, rng = somewhere(2)
    errors = errors_of(synthetic_arm.drawn_arm(rng, Sizes(offset_m=0.01, twist_rad=0.05)))
    point_flange = np.tile(rng.normal(size=3), (7, 1))

    def at(errors, joints_rad):
        return chain(ARM, joints_rad, errors, gravity_torques_nm(ARM, somewhere(2)[0])).points_base(point_flange)

    here = chain(ARM, joints_rad, errors)
    for column in range(48):
        step = 1e-6 * (np.arange(48) == column)
        slope = (at(errors + step, joints_rad) - at(errors - step, joints_rad)) / 2e-6
        scale = max(1.0, np.abs(slope).max() ** 2)  # a compliance's step is a turn by hundreds of times as much
        assert np.abs(here.by_errors(at(errors, joints_rad))[..., column] - slope).max() < 1e-8 * scale
    for joint in range(6):
        step = 1e-6 * (np.arange(6) == joint)
        slope = (at(errors, joints_rad + step) - at(errors, joints_rad - step)) / 2e-6
        assert np.abs(here.by_readings(at(errors, joints_rad))[..., joint] - slope).max() < 1e-8


def test_readings_take_the_flange_where_it_is_wanted():
    joints_rad, rng = somewhere(3)
    arm = CalibratedArm(nominal=ARM, errors=errors_of(synthetic_arm.drawn_arm(rng, Sizes(offset_m=1e-3))))
    wanted = synthetic_arm.EXACT.flanges(joints_rad)  # where the nominal arm would be: millimetres off
    sent = arm.readings(wanted, joints_rad)
    assert arm.flanges(sent).as_matrix() == pytest.approx(wanted.as_matrix(), abs=1e-12)
    assert 1e-5 < np.abs(sent - joints_rad).max() < 0.05


def test_an_error_of_a_joints_zero_is_a_twist_about_its_axis():
    joints_rad, _ = somewhere(4)
    zero, twist = np.zeros(48), np.zeros(48)
    zero[36 + 2] = 0.01
    twist[18 + 6 : 18 + 9] = 0.01 * ARM.axes_base[2]
    zeroed, twisted = (CalibratedArm(nominal=ARM, errors=errors).flanges(joints_rad) for errors in (zero, twist))
    assert zeroed.as_matrix() == pytest.approx(twisted.as_matrix(), abs=1e-14)


def test_a_turn_of_the_first_link_turns_everything():
    joints_rad, _ = somewhere(5)
    errors = np.zeros(48)
    errors[18:21] = [0.0, 0.0, 0.3]
    turned = CalibratedArm(nominal=ARM, errors=errors).flanges(joints_rad)
    expected = Rotation.from_euler("z", 0.3).apply(synthetic_arm.EXACT.flanges(joints_rad).translation)
    assert turned.translation == pytest.approx(expected, abs=1e-12)

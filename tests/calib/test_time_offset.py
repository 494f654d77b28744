from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.calib.time_offset import TimeOffsetProblem, solve
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import difference, rigid_from

TIMES_S = np.linspace(0, 8, 801)
STAMPS_S = np.linspace(0.5, 7.5, 60)


def sway(times_s, reach_m=0.03, lean_rad=0.0):
    """A camera that goes to and fro along all axes, and leans if asked to, above the target."""
    phases = np.outer(times_s, [1.1, 1.7, 0.9])
    turned = Rotation.from_rotvec(lean_rad * np.sin(phases[:, ::-1])) * synthetic.torch_down()
    mount = synthetic.camera_on_flange()
    R_base_camera = turned * mount.rotation
    seen = np.array([0, 0, 0.275]) + reach_m * np.sin(phases)
    return rigid_from(R_base_camera, synthetic.SPHERE_BASE - R_base_camera.apply(seen)) * mount.inv()


def problem(offset_s, rng=None, noise_m=0.0, motion=sway, **changes):
    mount = synthetic.camera_on_flange()
    centres = (motion(STAMPS_S + offset_s) * mount).inv().apply(synthetic.SPHERE_BASE)
    if rng is not None:
        centres = centres + rng.normal(0, noise_m, centres.shape)
    given = {"pose_times_s": TIMES_S, "T_base_flange": motion(TIMES_S), "picture_times_s": STAMPS_S}
    return TimeOffsetProblem(**{**given, "centres_camera": centres, "T_flange_camera": mount, **changes})


@pytest.mark.parametrize("offset_s", [0.0, 0.0123, -0.17])
def test_exact_sights_give_the_exact_offset(offset_s):
    found = solve(problem(offset_s))
    assert found.offset_s == pytest.approx(offset_s, abs=1e-7)  # s; cubic splines through sines sampled at 100 Hz
    assert found.target_base == pytest.approx(synthetic.SPHERE_BASE, abs=1e-7)
    assert found.verdict == "accepted" and found.rms_m < 1e-7


def ramp(times_s):
    """Speeds up and slows down: a cubic, which splines follow exactly."""
    s = (times_s / 8)[:, None]
    shift = s**2 * (1 - s) * np.array([0.3, -0.2, 0.1])
    start = sway(np.zeros(len(times_s)))
    return rigid_from(start.rotation, start.translation + shift)


def test_a_motion_that_splines_follow_gives_the_offset_to_solver_precision():
    found = solve(problem(0.05, motion=ramp))
    assert found.offset_s == pytest.approx(0.05, abs=1e-9)
    assert found.target_base == pytest.approx(synthetic.SPHERE_BASE, abs=1e-9)


def test_the_mount_is_found_with_it():
    def motion(times_s):
        return sway(times_s, lean_rad=0.4)

    truth = synthetic.camera_on_flange()
    start = rigid_from(truth.rotation * Rotation.from_rotvec([0.01, -0.02, 0.015]), truth.translation + 0.003)
    found = solve(problem(0.04, motion=motion, T_flange_camera=start, estimate_mount=True))
    angle_rad, distance_m = difference(found.T_flange_camera, truth)
    assert found.offset_s == pytest.approx(0.04, abs=1e-7) and angle_rad < 1e-6 and distance_m < 1e-6
    assert found.verdict == "accepted" and found.covariance.shape == (10, 10)


def test_errors_scatter_as_the_covariance_says():
    """80 trials: the standard deviation within 20 % (its own is 8 %)."""
    rng = np.random.default_rng(0)
    found = [solve(problem(0.03, rng, 2e-4, sigma_m=2e-4)) for _ in range(80)]
    ratio = np.std([one.offset_s for one in found]) / np.sqrt(np.mean([one.sigma_s**2 for one in found]))
    assert ratio == pytest.approx(1, abs=0.2)
    assert abs(np.mean([one.offset_s for one in found]) - 0.03) < 4 * found[0].sigma_s / np.sqrt(80)


@pytest.mark.parametrize("sigma_m", [0.0, 1e-4])
def test_a_robot_that_stood_still_is_refused(sigma_m):
    rng = np.random.default_rng(1)
    still = sway(np.zeros(801))
    jitter = rigid_from(still.rotation, still.translation + rng.normal(0, sigma_m / 5, (801, 3)))
    given = problem(0.0, rng, sigma_m, motion=lambda times_s: sway(np.zeros(len(times_s))))
    found = solve(replace(given, T_base_flange=jitter))
    assert found.verdict == "refused" and any("stood still" in reason for reason in found.reasons)


def test_constant_velocity_cannot_be_told_from_a_shift_of_the_target():
    def motion(times_s):
        start = sway(np.zeros(len(times_s)))
        return rigid_from(start.rotation, start.translation + 0.02 * times_s[:, None] * np.array([1.0, 0, 0]))

    found = solve(problem(0.02, motion=motion))
    assert found.verdict == "refused" and np.isinf(found.sigma_s)
    assert "time offset" in found.observability[0] and "the target along" in found.observability[0]


def test_an_offset_beyond_the_range_is_refused():
    found = solve(problem(0.2, largest_offset_s=0.1))
    assert found.verdict == "refused" and any("end of the range" in reason for reason in found.reasons)


def test_recordings_that_do_not_overlap_are_named():
    with pytest.raises(BadInput, match="s or more inside the poses"):
        problem(0.0, picture_times_s=STAMPS_S + 100)
    with pytest.raises(BadInput, match="rising"):
        problem(0.0, pose_times_s=TIMES_S[::-1].copy())

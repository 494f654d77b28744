from dataclasses import replace

import numpy as np
import pytest

import synthetic
import synthetic_arm
from weldcell.calib.joint_estimate import solve
from weldcell.calib.joint_problem import ARM_GROUPS, Sizes, TargetDistance
from weldcell.calib.joint_rows import JointModel, JointState
from weldcell.calib.sight_model import perturbation
from weldcell.cell.errors import BadInput

TYPICAL = Sizes()
NOTHING = Sizes(offset_m=1e-12, twist_rad=1e-12, zero_rad=1e-12, compliance_rad_per_nm=1e-15)


def cell_and_plan(seed, sizes=TYPICAL, **options):
    rng = np.random.default_rng(seed)
    return synthetic_arm.drawn_cell(rng, sizes), synthetic_arm.plan(rng, **options), rng


def torch_errors_m(cell, result, points_base, seed=99):
    misses, _ = synthetic_arm.misses_base(cell, result, synthetic_arm.views(np.random.default_rng(seed), points_base))
    return np.linalg.norm(misses, axis=1)


def test_an_exact_arm_gives_the_exact_camera_tip_and_sphere():
    """The torch too is as drawn: a bent one might as well be an arm whose last link is off."""
    cell, plan, rng = cell_and_plan(0)
    cell = replace(cell, arm=synthetic_arm.EXACT, tip_flange=synthetic.TIP_FLANGE)
    for adapt in (False, True):
        found = solve(synthetic_arm.observe(cell, plan, rng, TYPICAL, noise=0.0, adapt=adapt))
        assert np.abs(perturbation(cell.T_flange_camera, found.T_flange_camera)).max() < 1e-9  # m and rad
        assert found.tip_flange == pytest.approx(cell.tip_flange, abs=1e-9)
        assert found.targets_base == pytest.approx(plan.spheres_base, abs=1e-9)
        assert found.verdict == "accepted" and found.converged


def test_exact_observations_of_an_imperfect_arm_send_the_torch_to_the_exact_place():
    """Camera, tip and links are not determined one by one, where the torch goes is: everywhere that was measured."""
    cell, plan, rng = cell_and_plan(1, sights=60, touches=120, tilt_deg=40.0)
    found = solve(synthetic_arm.observe(cell, plan, rng, TYPICAL, noise=0.0, believed=1e-6, adapt=False))
    assert torch_errors_m(cell, found, plan.spheres_base).max() < 1e-9
    assert np.linalg.norm(found.arm.errors[:18]) > 1e-4  # although the arm was far from its drawing
    assert found.sight_residual_m.max() < 1e-9 and np.abs(found.touch_residual_m).max() < 1e-9


def test_the_arms_errors_are_found_well_enough_to_weld_away_from_the_sphere():
    """Against the same data without the arm's errors: P2's way, with all sights and touches in one estimate."""
    joint_m, plain_m = [], []
    for seed in range(3):
        cell, plan, rng = cell_and_plan(seed)
        problem = synthetic_arm.observe(cell, plan, rng, TYPICAL)
        plain = replace(problem, estimate=problem.estimate - ARM_GROUPS)
        for errors_m, found in ((joint_m, solve(problem)), (plain_m, solve(plain))):
            places = (synthetic_arm.NEAR_BASE, synthetic_arm.FAR_BASE)
            errors_m.append([torch_errors_m(cell, found, points).mean() for points in places])
    assert np.all(np.median(joint_m, axis=0) < 0.5 * np.median(plain_m, axis=0))
    assert np.all(np.median(joint_m, axis=0) < 3e-5)  # m, near and far, without the noise of view and approach


def test_points_serve_as_well_as_spheres():
    cell, plan, rng = cell_and_plan(2)
    found = solve(synthetic_arm.as_points(synthetic_arm.observe(cell, plan, rng, TYPICAL)))
    assert torch_errors_m(cell, found, synthetic_arm.NEAR_BASE).mean() < 3e-5 and found.verdict == "accepted"


def test_of_a_perfect_arm_next_to_nothing_is_estimated():
    """The sizes come from the data: an arm without errors is not bent to fit the noise."""
    cell, plan, rng = cell_and_plan(3, NOTHING)
    problem = synthetic_arm.observe(cell, plan, rng, TYPICAL)
    adapted, believed = solve(problem), solve(replace(problem, adapt=False))
    largest_m = [np.abs(found.arm.errors[:18]).max() for found in (adapted, believed)]
    assert largest_m[0] < 0.2 * largest_m[1]
    errors_m = [torch_errors_m(cell, found, synthetic_arm.FAR_BASE).mean() for found in (adapted, believed)]
    assert errors_m[0] < errors_m[1]


@pytest.mark.parametrize("factor", [0.3, 3.0])
def test_the_sizes_of_errors_and_noise_are_found(factor):
    """Medians over arms. Offsets, twists and zeros share what the data show of them; the noise stands alone."""
    actual = Sizes(**{name: factor * getattr(TYPICAL, name) for name in vars(TYPICAL)})
    ratios = []
    for seed in range(3):
        cell, plan, rng = cell_and_plan(seed, actual)
        problem = synthetic_arm.observe(cell, plan, rng, actual, sizes=TYPICAL)
        found = solve(problem).sizes
        ratios.append([getattr(found, name) / getattr(actual, name) for name in ("offset_m", "joint_noise_rad")])
    offset, noise = np.median(ratios, axis=0)
    assert 0.4 < offset < 2.5 and 0.8 < noise < 1.2


def test_predicted_errors_are_the_actual_ones():
    """A short form of `synthetic_arm.honesty(500)`, which demands 15 % and 92 to 98 %."""
    trials = 40
    found = synthetic_arm.honesty(trials, adapt=False, robust=False)
    spread = 4 / np.sqrt(2 * trials)  # four standard deviations of a standard deviation
    assert all(np.all(np.abs(ratio - 1) < spread) for ratio in found.sigma_ratio.values())
    assert all(0.95 - 4 * np.sqrt(0.05 * 0.95 / trials) < each for each in found.coverage.values())


def test_gross_outliers_are_named_and_left_out():
    for seed in range(2):
        cell, plan, rng = cell_and_plan(seed)
        problem = synthetic_arm.observe(cell, plan, rng, TYPICAL)
        clean_m = torch_errors_m(cell, solve(problem), synthetic_arm.NEAR_BASE).mean()
        wrong_sights, wrong_touches = rng.permutation(20)[:6], rng.permutation(60)[:18]  # 30 % of each
        circles, joints_rad = problem.sights.circles_laser.copy(), problem.touches.joints_rad.copy()
        circles[wrong_sights] += rng.normal(0, 0.004, (6, 3)) + [0.002, 0.003, -0.004]
        joints_rad[wrong_touches] += rng.normal(0, 0.01, (18, 6))
        found = solve(
            replace(
                problem,
                sights=replace(problem.sights, circles_laser=circles),
                touches=replace(problem.touches, joints_rad=joints_rad),
            )
        )
        assert set(np.flatnonzero(found.sight_outliers)) == set(wrong_sights)
        assert set(wrong_touches) >= set(np.flatnonzero(found.touch_outliers)) and found.touch_outliers.sum() >= 15
        assert torch_errors_m(cell, found, synthetic_arm.NEAR_BASE).mean() < 2 * clean_m
        assert found.verdict == "doubtful" and f"sight {min(wrong_sights)} " in " ".join(found.reasons)


def test_two_spheres_a_known_distance_apart_fix_the_scale_of_the_arm():
    """Without touches the sights alone bear a scale; the distance between the spheres' places tells it."""
    errors_m = {"known": [], "not known": []}
    for seed in range(3):
        rng = np.random.default_rng(seed)
        cell = synthetic_arm.drawn_cell(rng, Sizes(offset_m=7e-4))
        plan, distance = synthetic_arm.two_spheres(rng)
        problem = synthetic_arm.observe(cell, plan, rng, TYPICAL, touches=None, sizes=Sizes(offset_m=7e-4))
        for name, distances in (("known", (distance,)), ("not known", ())):
            found = solve(replace(problem, distances=distances))
            errors_m[name].append(abs(np.linalg.norm(np.diff(found.targets_base, axis=0)) - distance.distance_m))
    assert np.max(errors_m["known"]) < 1e-5 < 4e-5 < np.median(errors_m["not known"])  # m


def test_derivatives_are_those_of_the_residuals():
    rng = np.random.default_rng(4)
    cell = synthetic_arm.drawn_cell(rng, TYPICAL)
    plan, distance = synthetic_arm.two_spheres(rng)
    problem = synthetic_arm.observe(cell, plan, rng, TYPICAL, distances=(distance,))
    by_sensor = rng.normal(size=(len(plan.sights_rad), 3, 6))
    problem = replace(problem, sights=replace(problem.sights, by_sensor=by_sensor))
    model = JointModel(problem)
    state = JointState(
        R_flange_camera=cell.T_flange_camera.rotation.as_matrix(),
        camera_flange=cell.T_flange_camera.translation,
        tip_flange=cell.tip_flange,
        targets_base=plan.spheres_base + rng.normal(0, 1e-3, (2, 3)),
        errors=rng.normal(0, 1e-3, 48) * np.repeat([1, 1, 1, 1e-3], [18, 18, 6, 6]),
        sensor=rng.normal(0, 1e-3, 6),
    )
    compliances = range(model.columns.arm.start + 42, model.columns.arm.stop)
    for kind, seen in enumerate(model.observations(state)):
        for column in range(seen.jacobian.shape[-1]):
            size = 1e-8 if column in compliances else 1e-6
            step = size * (np.arange(seen.jacobian.shape[-1]) == column)
            ahead, behind = (
                model.observations(state.moved(sign * step, model.columns))[kind].residuals for sign in (1, -1)
            )
            slope = (ahead - behind) / (2 * size)
            scale = max(1.0, float(np.abs(slope).max()))
            assert np.abs(seen.jacobian[..., column] - slope).max() < 1e-7 * scale  # of central differences


def test_what_is_switched_off_keeps_its_nominal_value():
    cell, plan, rng = cell_and_plan(5)
    problem = synthetic_arm.observe(cell, plan, rng, TYPICAL)
    found = solve(replace(problem, estimate=frozenset({"zeros"})))
    assert np.array_equal(found.tip_flange, synthetic.TIP_FLANGE)
    assert np.all(found.arm.errors[:36] == 0) and np.all(found.arm.errors[42:] == 0) and np.all(found.sensor == 0)
    assert np.all(found.arm.errors[36:42] != 0)
    variances = np.diag(found.covariance_all)
    assert np.all(variances[6:9] == 0) and np.all(variances[12:48] == 0) and np.all(variances[48:54] > 0)


def test_left_out_one_by_one_sights_miss_by_what_a_refit_says():
    cell, plan, rng = cell_and_plan(6, sights=8, touches=30)
    problem = synthetic_arm.observe(cell, plan, rng, TYPICAL, adapt=False, robust=False)
    squares = []
    for left_out in range(8):
        kept = np.arange(8) != left_out
        sights = problem.sights
        fewer = replace(
            sights,
            joints_rad=sights.joints_rad[kept],
            circles_laser=sights.circles_laser[kept],
            covariances_laser=sights.covariances_laser[kept],
            targets=sights.targets[kept],
            radii_m=sights.radii_m[kept],
            sides=sights.sides[kept],
        )
        found = solve(replace(problem, sights=fewer))
        model = JointModel(problem)
        state = JointState(
            R_flange_camera=found.T_flange_camera.rotation.as_matrix(),
            camera_flange=found.T_flange_camera.translation,
            tip_flange=found.tip_flange,
            targets_base=found.targets_base,
            errors=found.arm.errors,
            sensor=found.sensor,
        )
        squares.append(np.sum(model.observations(state)[0].residuals[left_out] ** 2))
    # a linear formula for a model that is nearly linear
    assert solve(problem).leave_one_out_rms_m == pytest.approx(np.sqrt(np.mean(squares)), rel=0.01)


def test_sights_of_one_orientation_without_touches_are_refused_with_the_open_direction():
    cell, plan, rng = cell_and_plan(7, tilt_deg=0.0)
    found = solve(synthetic_arm.observe(cell, plan, rng, TYPICAL, touches=None))
    assert found.verdict == "refused"
    assert "hardly determined" in found.reasons[0] and "translation along" in " ".join(found.observability)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tip_flange": np.array([0, np.nan, 0])}, "tip_flange"),
        ({"distances": (TargetDistance(first=0, second=1, distance_m=0.3),)}, "never seen"),
    ],
)
def test_problems_that_make_no_sense_are_refused(change, message):
    cell, plan, rng = cell_and_plan(9, sights=4, touches=8)
    with pytest.raises(BadInput, match=message):
        synthetic_arm.observe(cell, plan, rng, TYPICAL, **change)


def test_readings_that_are_no_numbers_are_refused():
    cell, plan, rng = cell_and_plan(9, sights=4, touches=8)
    problem = synthetic_arm.observe(cell, plan, rng, TYPICAL)
    with pytest.raises(BadInput, match="joints_rad"):
        replace(problem.sights, joints_rad=np.full((4, 6), np.nan))

"""`weldcell calibrate hand-eye` on files made from a known truth, without the simulator."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.cell.frames import difference, rigid, rigid_from
from weldcell.scenarios.command_line import main

RADIUS_M = 0.020
# the sensor's own frame: profiles in y = 0, z is depth
SENSOR = rigid_from(Rotation.from_euler("XYZ", [170, 10, 80], degrees=True), np.array([0.05, -0.02, 0.12]))


def write_poses(path, T_base_flange):
    rows = ["id,x_mm,y_mm,z_mm,qw,qx,qy,qz"]
    quaternions = T_base_flange.rotation.as_quat(scalar_first=True)
    for index, (place, turn) in enumerate(zip(T_base_flange.translation * 1e3, quaternions, strict=True)):
        rows.append(",".join([f"pose {index}", *(f"{value:.9f}" for value in (*place, *turn))]))
    path.write_text("\n".join(rows) + "\n")
    return path


def write_points(path, by_pose):
    rows = ["id,x_mm,y_mm,z_mm"]
    for index, points in enumerate(by_pose):
        rows += [f"pose {index}," + ",".join(f"{value:.6f}" for value in point * 1e3) for point in points]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture
def calibrate(tmp_path, capfd):
    def call(T_base_flange, by_pose, *more):
        files = [write_poses(tmp_path / "poses.csv", T_base_flange), write_points(tmp_path / "points.csv", by_pose)]
        arguments = ["--poses", files[0], "--points", files[1], "--out", tmp_path / "out", *more]
        code = main(["calibrate", "hand-eye", *map(str, arguments)])
        result = tmp_path / "out" / "result.json"
        return code, json.loads(result.read_text()) if result.exists() else None, capfd.readouterr().err

    return call


def point_sights(seed=0):
    sights = synthetic.sights(np.random.default_rng(seed))
    return sights, [centre[None] for centre in sights.centres_camera]


def sphere_profiles(rng, sigma_m=0.0, side=1):
    """Flange poses and profiles of a sphere whose centre lies 5 to 14 mm off the light plane, on a flat table."""
    sights = synthetic.sights(rng, T_flange_camera=SENSOR)
    centres = np.array([0, 0, 0.25]) + rng.uniform(-0.02, 0.02, (20, 3))
    centres[:, 1] = side * rng.uniform(0.005, 0.014, 20)
    R_base_sensor = sights.T_base_flange.rotation * SENSOR.rotation
    T_base_sensor = rigid_from(R_base_sensor, sights.target_base - R_base_sensor.apply(centres))
    return T_base_sensor * SENSOR.inv(), [_profile(centre, rng, sigma_m) for centre in centres]


def _profile(centre, rng, sigma_m):
    x = np.linspace(centre[0] - 0.04, centre[0] + 0.04, 400)
    depth = np.full(400, centre[2] + RADIUS_M)
    height2 = RADIUS_M**2 - centre[1] ** 2 - (x - centre[0]) ** 2
    lit = height2 > (0.25 * RADIUS_M) ** 2
    depth[lit] = centre[2] - np.sqrt(height2[lit])
    return np.column_stack([x, np.zeros(400), depth + rng.normal(0, sigma_m, 400)])


def camera_of(result):
    matrix = np.array(result["estimate"]["T_flange_sensor"])
    matrix[:3, 3] *= 1e-3
    return rigid(matrix)


def test_exact_points_give_the_exact_sensor(calibrate):
    sights, by_pose = point_sights()
    code, result, errors = calibrate(sights.T_base_flange, by_pose, "--target", "point")
    assert code == 0 and result["verdict"] == "accepted" and not errors
    angle_rad, distance_m = difference(camera_of(result), sights.T_flange_camera)
    assert angle_rad < 1e-7 and distance_m < 1e-8  # files with 1 nm
    assert result["outliers"] == [] and len(result["residuals"]) == 20
    assert result["condition_number"] < 100 and result["leave_one_out_rms_mm"] < 1e-5
    assert np.shape(result["covariance"]) == (6, 6) and len(result["covariance_of"]) == 6


def test_outliers_are_named_by_id(calibrate):
    sights, by_pose = point_sights()
    by_pose[3] = by_pose[3] + 0.03
    by_pose[17] = by_pose[17] - [0, 0.02, 0]
    code, result, errors = calibrate(sights.T_base_flange, by_pose, "--target", "point")
    assert code == 0 and result["outliers"] == ["pose 3", "pose 17"]
    assert "id pose 3 is an outlier" in errors
    assert max(difference(camera_of(result), sights.T_flange_camera)) < 1e-7


def test_refused_data_gives_exit_1_a_reason_and_no_estimate(calibrate):
    sights, by_pose = point_sights()
    code, result, errors = calibrate(sights.T_base_flange[:10], by_pose[:10], "--target", "point")
    assert code == 1 and result["verdict"] == "refused" and result["estimate"] is None
    assert "weldcell: failed: " in errors and "not determined: translation along" in errors
    assert result["observability"] and result["condition_number"] is None


@pytest.mark.parametrize("side", [1, -1])
def test_exact_profiles_of_a_sphere_give_the_exact_sensor(calibrate, side):
    T_base_flange, profiles = sphere_profiles(np.random.default_rng(0), side=side)
    more = ["--target", "sphere", "--radius-mm", 20, "--side", side]
    code, result, _ = calibrate(T_base_flange, profiles, *more)
    angle_rad, distance_m = difference(camera_of(result), SENSOR)
    assert code == 0 and result["verdict"] == "accepted"
    assert angle_rad < 1e-5 and distance_m < 2e-6  # points rounded to 1 nm, arcs to 400 of them


def test_the_side_is_found_from_the_data(calibrate):
    T_base_flange, profiles = sphere_profiles(np.random.default_rng(1), sigma_m=2e-5, side=-1)
    code, result, _ = calibrate(T_base_flange, profiles, "--target", "sphere", "--radius-mm", 20)
    angle_rad, distance_m = difference(camera_of(result), SENSOR)
    assert code == 0 and "side -1" in result["notes"][0]
    assert angle_rad < np.deg2rad(0.3) and distance_m < 1e-3  # 20 um points, some 50 um centres, 60 mm moves


def test_a_profile_without_the_sphere_is_left_out_by_id(calibrate):
    T_base_flange, profiles = sphere_profiles(np.random.default_rng(2))
    profiles[12][:, 2] = 0.27
    _, result, errors = calibrate(T_base_flange, profiles, "--target", "sphere", "--radius-mm", 20, "--side", 1)
    assert result["outliers"] == ["pose 12"] and "id pose 12 is left out: " in errors
    assert difference(camera_of(result), SENSOR)[1] < 2e-6


def touched_with(calibrate, tmp_path, tip_mm):
    """A run whose touches were made by the synthetic torch, in one orientation, and this tip given."""
    T_base_flange, profiles = sphere_profiles(np.random.default_rng(3))
    touches_file = write_poses(tmp_path / "touches.csv", synthetic.touch_poses(np.random.default_rng(4), tilt_deg=0))
    sphere = ["--target", "sphere", "--radius-mm", 20, "--side", 1]
    tip = ["--touches", touches_file, "--tcp-mm", *tip_mm, "--tip-radius-mm", synthetic.TIP_RADIUS_M * 1e3]
    return calibrate(T_base_flange, profiles, *sphere, *tip)


def test_touches_by_a_torch_that_is_as_told_leave_the_sensor_where_it_is(calibrate, tmp_path):
    code, result, _ = touched_with(calibrate, tmp_path, synthetic.TIP_FLANGE * 1e3)
    assert code == 0 and result["verdict"] == "accepted"
    assert result["touches"]["sphere_centre_base_mm"] == pytest.approx(synthetic.SPHERE_BASE * 1e3, abs=1e-4)
    assert difference(camera_of(result), SENSOR)[1] < 2e-6  # m, as without touches


def test_touches_by_a_bent_torch_move_the_sensor_with_it(calibrate, tmp_path):
    """The tip is told 2 mm short: by closed form the sphere then seems to lie that much higher."""
    short = synthetic.TIP_FLANGE - synthetic.torch_on_flange().rotation.apply([0, 0, 2e-3])
    _, result, _ = touched_with(calibrate, tmp_path, short * 1e3)
    expected = synthetic.SPHERE_BASE * 1e3 + [0, 0, 2]
    assert result["touches"]["sphere_centre_base_mm"] == pytest.approx(expected, abs=1e-4)
    assert result["touches"]["compensation_rms_before_mm"] == pytest.approx(2, abs=0.01)
    assert result["touches"]["compensation_rms_mm"] < 1  # a sensor on the flange cannot follow in all orientations
    moved_m = difference(camera_of(result), SENSOR)[1]
    assert moved_m > 1e-3


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--target", "sphere"], "--radius-mm"),
        (["--target", "sphere", "--radius-mm", "-1"], "--radius-mm"),
        (["--target", "sphere", "--radius-mm", "nan"], "--radius-mm"),
        (["--target", "point", "--side", "1"], "--side"),
        (["--target", "point", "--euler", "XYZ"], "--euler"),
        (["--target", "cube"], "--target"),
        (["--target", "point", "--tip-radius-mm", "-1"], "--tip-radius-mm"),
        (["--target", "point", "--tcp-mm", "1", "2", "3"], "--tcp-mm"),
        (["--target", "point", "--puler", "XYZ"], "--euler"),
    ],
)
def test_bad_options_end_in_one_line_and_leave_nothing(calibrate, tmp_path, more, words):
    sights, by_pose = point_sights()
    code, result, errors = calibrate(sights.T_base_flange, by_pose, *more)
    assert code == 2 and result is None and not (tmp_path / "out").exists()
    assert errors.startswith("weldcell: error: ") and errors.count("\n") == 1 and words in errors


def test_a_result_is_not_overwritten_unasked(calibrate):
    sights, by_pose = point_sights()
    assert calibrate(sights.T_base_flange, by_pose, "--target", "point")[0] == 0
    code, _, errors = calibrate(sights.T_base_flange, by_pose, "--target", "point")
    assert code == 2 and "--overwrite" in errors
    assert calibrate(sights.T_base_flange, by_pose, "--target", "point", "--overwrite")[0] == 0

"""`weldcell calibrate tcp` on files made from a known truth, without the simulator."""

import json

import numpy as np
import pytest

import synthetic
from weldcell.cell.frames import rigid_from
from weldcell.scenarios.command_line import main


def write_poses(path, T_base_flange, euler="XYZ"):
    angles = T_base_flange.rotation.as_euler(euler, degrees=True)
    rows = ["id,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg"]
    for index, numbers in enumerate(np.hstack([T_base_flange.translation * 1e3, angles])):
        rows.append(f"pose {index}," + ",".join(f"{number:.9f}" for number in numbers))
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture
def calibrate(tmp_path, capfd):
    def call(T_base_flange, *more, euler="XYZ"):
        poses = write_poses(tmp_path / "poses.csv", T_base_flange)
        arguments = ["--poses", poses, "--euler", euler, "--out", tmp_path / "out", *more]
        code = main(["calibrate", "tcp", *map(str, arguments)])
        result = tmp_path / "out" / "result.json"
        return code, json.loads(result.read_text()) if result.exists() else None, capfd.readouterr().err

    return call


SPHERE = ["--method", "sphere", "--radius-mm", "20", "--tip-radius-mm", "0.6", "--tcp-mm", "-68", "1", "317"]


def test_exact_pivot_poses_give_the_exact_tip(calibrate):
    code, result, _ = calibrate(synthetic.pivot_poses(np.random.default_rng(0), 8))
    assert code == 0 and result["verdict"] == "accepted" and result["reasons"] == [] == result["outliers"]
    assert result["estimate"]["tip_flange_mm"] == pytest.approx(synthetic.TIP_FLANGE * 1e3, abs=1e-5)  # mm, as printed
    assert result["point_base_mm"] == pytest.approx(synthetic.SPHERE_BASE * 1e3, abs=1e-5)
    assert np.shape(result["covariance"]) == (6, 6) and len(result["residuals"]) == 8


def test_exact_touches_of_a_sphere_give_the_exact_tip(calibrate):
    code, result, _ = calibrate(synthetic.touch_poses(np.random.default_rng(1), 30), *SPHERE)
    assert code == 0 and result["verdict"] == "accepted"
    assert result["estimate"]["tip_flange_mm"] == pytest.approx(synthetic.TIP_FLANGE * 1e3, abs=1e-5)
    assert result["sphere_centre_base_mm"] == pytest.approx(synthetic.SPHERE_BASE * 1e3, abs=1e-5)


def test_a_wrong_pose_is_named_by_its_id(calibrate):
    rng = np.random.default_rng(2)
    poses = synthetic.moved(synthetic.pivot_poses(rng, 9), rng, 1e-4)
    shift = np.zeros((9, 3))
    shift[5] = [0.0, 0.01, -0.02]
    code, result, error = calibrate(rigid_from(poses.rotation, poses.translation + shift))
    assert code == 0 and result["verdict"] == "doubtful" and result["outliers"] == ["pose 5"]
    assert "id pose 5 is an outlier" in error


def test_one_orientation_fails_with_the_open_directions(calibrate):
    code, result, error = calibrate(synthetic.pivot_poses(np.random.default_rng(3), 8, tilt_deg=0.0))
    assert code == 1 and result["verdict"] == "refused" and result["estimate"] is None
    assert result["observability"] and "not determined" in error and "Traceback" not in error


def test_another_euler_sequence_that_fits_far_better_is_named(calibrate):
    rng = np.random.default_rng(4)
    poses = synthetic.moved(synthetic.pivot_poses(rng, 8), rng, 1e-4)
    code, result, error = calibrate(poses, euler="zyx")
    assert result["verdict"] != "accepted"
    assert code == 1 or "XYZ would leave" in error


@pytest.mark.parametrize(
    ("more", "named"),
    [
        (["--method", "sphere"], "--radius-mm"),
        (["--method", "sphere", "--radius-mm", "20"], "--tcp-mm"),
        (["--radius-mm", "20"], "belong to --method sphere"),
        (["--method", "sphere", "--radius-mm", "nan", "--tcp-mm", "0", "0", "300"], "--radius-mm"),
        (["--euler", "XXY"], "--euler"),
    ],
)
def test_options_that_do_not_fit_are_named(calibrate, more, named):
    code, result, error = calibrate(synthetic.pivot_poses(np.random.default_rng(5), 8), *more)
    assert code == 2 and result is None
    assert error.startswith("weldcell: error: ") and named in error and error.count("\n") == 1


def test_a_comma_as_decimal_sign_is_named_by_line(tmp_path, capfd):
    poses = tmp_path / "poses.csv"
    poses.write_text("id,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\na,1,2,3,4,5,6\nb,1,5,2,3,4,5,6\n")
    assert main(["calibrate", "tcp", "--poses", str(poses), "--euler", "XYZ", "--out", str(tmp_path / "out")]) == 2
    error = capfd.readouterr().err
    assert "line 3" in error and "decimal" in error and not (tmp_path / "out").exists()

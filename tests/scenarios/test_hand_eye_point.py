"""P1's hand-eye calibration through pictures, and its tables read back by the user's command."""

import json

import numpy as np
import pytest

from weldcell.scenarios import point_sights
from weldcell.scenarios.command_line import main
from weldcell.scenarios.yaml_file import read_yaml

FEW = ["--calibration.translations", "6", "--calibration.free-poses", "6", "--no-recording.enabled"]


def run(place, *more):
    code = main(["run", "hand-eye-point", "--out", str(place), *FEW, *more])
    return code, json.loads((place / "metrics.json").read_text())["metrics"]


@pytest.fixture(scope="module")
def typical(tmp_path_factory):
    place = tmp_path_factory.mktemp("point") / "run"
    return place, *run(place, "--robot", "typical", "--seed", "3")


def test_an_exact_aim_and_no_noise_leave_the_digits_that_the_controller_shows(tmp_path, monkeypatch):
    """0.01 mm and 0.01 degrees, over moves of 20 mm and levers of 0.4 m."""
    monkeypatch.setattr(point_sights, "AIM_SIGMA_M", 0.0)
    code, metrics = run(tmp_path / "run", "--robot", "perfect", "--no-sensor.noise")
    assert code == 0
    assert metrics["hand_eye_rotation_error_deg"] < 0.08 and metrics["hand_eye_translation_error_mm"] < 0.15
    assert metrics["point_spread_mm"] < 0.08


def test_aim_noise_and_a_typical_robot_leave_less_than_a_millimetre(typical):
    _, code, metrics = typical
    assert code == 0
    assert metrics["hand_eye_rotation_error_deg"] < 0.8 and metrics["hand_eye_translation_error_mm"] < 1.5


def test_the_users_command_finds_the_same_from_the_tables(typical, tmp_path, capfd):
    """The joint estimate of the same rows: its own answer, within the closed form's uncertainty."""
    place, _, _ = typical
    tables = place / "calibration"
    files = ["--poses", str(tables / "poses.csv"), "--points", str(tables / "points.csv")]
    code = main(
        ["calibrate", "hand-eye", "--target", "point", "--euler", "XYZ", *files, "--out", str(tmp_path / "out")]
    )
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert code == 0, capfd.readouterr().err
    here = np.array(read_yaml(tables / "hand_eye.yaml")["T_flange_sensor"])
    assert np.array(result["estimate"]["T_flange_sensor"])[:3, 3] == pytest.approx(here[:3, 3], abs=2.0)  # mm


def test_the_scenario_has_p1s_sensor_unless_asked_for_another(typical):
    place, _, _ = typical
    assert read_yaml(place / "config.yaml")["sensor"]["preset"] == "p1"

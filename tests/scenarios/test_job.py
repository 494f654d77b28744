"""What a recipe gives back, and how it is written down."""

import json
import math

import numpy as np
import pytest

from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.metrics_file import write_metrics
from weldcell.scenarios.results_table import results_table
from weldcell.scenarios.settings import resolve
from weldcell.scenarios.yaml_file import read_yaml


def test_a_limit_is_an_upper_one_and_may_be_reached():
    outcome = Outcome(metrics={"a_mm": 0.5, "b_mm": 0.5001}, limits={"a_mm": 0.5, "b_mm": 0.5})
    assert outcome.within_limit("a_mm") is True
    assert outcome.within_limit("b_mm") is False
    assert outcome.reasons == ("b_mm is 0.5001, limit 0.5",)


@pytest.mark.parametrize("value", [None, math.nan])
def test_what_could_not_be_measured_does_not_keep_its_limit(value):
    outcome = Outcome(metrics={"a_mm": value, "b_mm": value}, limits={"a_mm": 1.0})
    assert outcome.reasons == ("a_mm could not be measured, limit 1",)
    assert outcome.within_limit("b_mm") is None


def test_other_failures_fail_a_run_too():
    assert Outcome(metrics={}, failures=("seam lost",)).reasons == ("seam lost",)
    assert Outcome(metrics={"a_count": 3}).reasons == ()


@pytest.mark.parametrize("name", ["error", "error_m", "error_rad", "mm"])
def test_a_metric_without_its_unit_is_a_mistake_of_the_recipe(name):
    with pytest.raises(ValueError, match="must end in its unit"):
        Outcome(metrics={name: 1.0})


def test_a_limit_without_a_metric_is_a_mistake_of_the_recipe():
    with pytest.raises(ValueError, match="without a metric: b_mm"):
        Outcome(metrics={"a_mm": 1.0}, limits={"b_mm": 1.0})


def test_metrics_are_written_as_the_contract_says(tmp_path):
    metrics = {"a_mm": np.float64(0.25), "b_deg": math.inf, "c_count": np.int64(298), "d_px": None, "e_um": math.nan}
    outcome = Outcome(metrics=metrics, limits={"a_mm": np.float64(1)})
    write_metrics(tmp_path / "metrics.json", scenario="boss", seed=3, outcome=outcome)
    content = json.loads((tmp_path / "metrics.json").read_text())
    assert list(content) == ["scenario", "seed", "passed", "versions", "metrics", "limits"]
    assert content["scenario"] == "boss"
    assert content["seed"] == 3
    assert content["passed"] is True
    assert content["metrics"] == {"a_mm": 0.25, "b_deg": None, "c_count": 298, "d_px": None, "e_um": None}
    assert content["limits"] == {"a_mm": 1.0}
    assert {"python", "weldcell", "mujoco", "numpy"} <= set(content["versions"])


def test_numbers_survive_to_the_last_bit(tmp_path):
    values = np.random.default_rng(3).standard_normal(100)
    outcome = Outcome(metrics={f"m{i}_mm": value for i, value in enumerate(values)})
    write_metrics(tmp_path / "metrics.json", scenario="boss", seed=0, outcome=outcome)
    assert list(json.loads((tmp_path / "metrics.json").read_text())["metrics"].values()) == values.tolist()


def test_the_table_has_a_row_for_each_metric_with_its_unit():
    outcome = Outcome(
        metrics={"seam_root_mean_error_mm": 0.12345, "boss_angle_mean_error_deg": None, "frames_count": 300},
        limits={"seam_root_mean_error_mm": 0.1},
    )
    rows = list(zip(*(list(column.cells) for column in results_table("", outcome).columns), strict=True))
    assert rows == [
        ("seam root mean error", "0.123", "mm", "0.1", "[bold red]failed[/bold red]"),
        ("boss angle mean error", "not measured", "°", "", ""),
        ("frames", "300", "", "", ""),
    ]


def test_calibrations_are_left_as_readable_files(tmp_path):
    settings = resolve("boss")
    job = Job(scenario="boss", seed=0, config=settings.config, folder=tmp_path)
    job.write_calibration("hand_eye", {"T_flange_camera": np.eye(4), "verdict": "accepted"})
    content = read_yaml(tmp_path / "calibration" / "hand_eye.yaml")
    assert content == {"T_flange_camera": np.eye(4).tolist(), "verdict": "accepted"}

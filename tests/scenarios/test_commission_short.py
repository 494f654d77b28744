"""The main job with fewer frames: what it measures, what it leaves, and that it does the same twice."""

import json

import numpy as np
import pytest
import yaml

from weldcell.scenarios.command_line import main

SHORT = [
    "--seam.frames", "24", "--boss.frames", "40", "--calibration.viewpoints", "3", "--calibration.touches", "24",
]  # fmt: skip
CONTRACT = {
    "hand_eye_rotation_error_deg",
    "hand_eye_translation_error_mm",
    "sphere_centre_spread_mm",
    *(f"point_{k}_error_{when}_mm" for k in (1, 2, 3) for when in ("before", "p2", "after")),
    "far_error_before_mm",
    "far_error_p2_mm",
    "far_error_after_mm",
    "frames_count",
    "frames_valid_count",
    *(f"seam_{name}_{what}_error_mm" for name in ("left", "root", "right") for what in ("mean", "max")),
    *(f"seam_{name}_sensor_{what}_error_mm" for name in ("left", "root", "right") for what in ("mean", "max")),
    "boss_edge_mean_error_mm",
    "boss_angle_mean_error_deg",
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "typical"
    code = main(["run", "commission", "--seed", "5", "--out", str(folder), *SHORT])
    return code, folder, json.loads((folder / "metrics.json").read_text())


def test_it_passes_and_leaves_everything_that_the_contract_names(finished):
    code, folder, content = finished
    assert code == 0 and content["passed"] and content["scenario"] == "commission" and content["seed"] == 5
    assert set(content["metrics"]) == CONTRACT
    assert (folder / "recording.rrd").stat().st_size > 1e5
    assert {path.name for path in (folder / "calibration").iterdir()} == {
        "arm.yaml",
        "hand_eye.yaml",
        "hand_eye_before.yaml",
        "hand_eye_p2.yaml",
        "tcp.yaml",
        "tcp_p2.yaml",
    }


def test_compensation_helps_and_the_seam_is_found(finished):
    metrics = finished[2]["metrics"]
    for k in (1, 2, 3):
        assert metrics[f"point_{k}_error_p2_mm"] < metrics[f"point_{k}_error_before_mm"] / 2
    assert metrics["far_error_after_mm"] < metrics["far_error_p2_mm"]
    assert metrics["frames_valid_count"] == metrics["frames_count"] == 24
    # mm: a few times what 300 frames reach; a wrong side, frame or sign costs millimetres
    assert max(metrics[f"seam_{name}_max_error_mm"] for name in ("left", "root", "right")) < 0.5


def test_the_calibration_files_are_read_back_as_what_they_are(finished):
    hand_eye = yaml.safe_load((finished[1] / "calibration" / "hand_eye.yaml").read_text())
    matrix = np.array(hand_eye["T_flange_sensor"])
    assert matrix.shape == (4, 4)
    assert np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-9)
    assert 100 < np.linalg.norm(matrix[:3, 3]) < 1000  # mm
    assert hand_eye["verdict"] in ("accepted", "doubtful")


def test_the_written_configuration_repeats_the_run_to_the_byte(finished, tmp_path):
    _, folder, content = finished
    again = tmp_path / "again"
    assert main(["run", "commission", "--config", str(folder / "config.yaml"), "--out", str(again)]) == 0
    assert json.loads((again / "metrics.json").read_text()) == content
    for name in ("hand_eye.yaml", "tcp.yaml", "arm.yaml"):
        assert (again / "calibration" / name).read_bytes() == (folder / "calibration" / name).read_bytes()

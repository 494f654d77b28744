"""`weldcell run laser-plane`, small and whole: every method from rendered pictures, near the truth."""

import json

import pytest

from weldcell.scenarios.command_line import main

SMALL = (
    "--sensor.width-px 1120 --sensor.height-px 840 --laser-plane.boards 7 --laser-plane.columns 9 --laser-plane.rows 7 "
    "--laser-plane.positions 4 --laser-plane.step-targets 3 --laser-plane.noise-px 0.1 --laser-plane.noise-repeats 1 "
    "--recording.enabled false"
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    place = tmp_path_factory.mktemp("laser") / "run"
    code = main(["run", "laser-plane", "--seed", "2", "--out", str(place), *SMALL.split()])
    return code, place, json.loads((place / "metrics.json").read_text())


def test_every_method_is_near_the_truth(run):
    metrics = run[2]["metrics"]
    # half the pictures, a narrow view and a third of the corners: the intrinsics are known far less than in a full run
    assert metrics["board_plane_rms_um"] < 200 and metrics["bundle_plane_rms_um"] < 200
    assert metrics["board_theta_error_deg"] < 0.05 and metrics["bundle_theta_error_deg"] < 0.05
    assert metrics["vanishing_point_theta_error_deg"] < 0.1
    assert metrics["dual_step_theta_error_deg"] < 3  # speckle blurs its ends
    assert metrics["camera_held_out_rms_px"] < 0.05


def test_the_table_of_noise_has_every_method(run):
    metrics = run[2]["metrics"]
    for method in ("vanishing_point", "board", "dual_step", "bundle"):
        assert metrics[f"{method}_theta_error_at_0_1_px_deg"] > 0
        assert metrics[f"{method}_plane_rms_at_0_1_px_um"] > 0
        assert metrics[f"{method}_base_error_mm"] >= 0


def test_calibrations_are_left_behind(run):
    from weldcell.scenarios.camera_file import read_camera
    from weldcell.scenarios.yaml_file import read_yaml

    read_camera(run[1] / "calibration" / "camera.yaml")
    assert read_yaml(run[1] / "calibration" / "laser_plane_bundle.yaml")["offset_mm"] == pytest.approx(194.45, abs=1)

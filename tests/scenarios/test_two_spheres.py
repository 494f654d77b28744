"""A second sphere on a bar of known length joins the estimate; P2's method has no place for it."""

import json

import numpy as np
import pytest

from weldcell.scenarios.command_line import main

QUICK = ["--sensor.profile-only", "--no-recording.enabled", "--calibration.viewpoints", "2"]
QUICK += ["--calibration.touches", "20", "--seed", "3"]
BAR = ["--calibration.second-sphere-mm", "-80", "250", "60"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "two"
    code = main(["run", "hand-eye-sphere", "--robot", "bad", "--out", str(folder), *QUICK, *BAR])
    return code, json.loads((folder / "metrics.json").read_text())


def test_the_estimate_takes_both_spheres(finished):
    code, content = finished
    assert code == 0
    metrics = content["metrics"]
    # mm: the bad robot's repeatability floor is 0.05; P2's way leaves 0.15 to 0.2
    assert metrics["far_error_after_mm"] < 0.12
    assert metrics["far_error_after_mm"] < metrics["far_error_p2_mm"]


def test_the_second_sphere_stands_at_the_bars_length(tmp_path):
    from weldcell.cell.configuration import CellConfig
    from weldcell.scenarios.progress import Progress
    from weldcell.scenarios.recording import Recording
    from weldcell.scenarios.station import Station

    config = CellConfig()
    with (
        Recording(tmp_path / "recording.rrd", config.recording, title="bar") as recording,
        Station(config, 4, recording, Progress()) as station,
    ):
        station.place_sphere(station.sphere_known_base, "first")
        first = station.cell.T_base_part("sphere").translation
        station.place_sphere(station.sphere_known_base + [-0.08, 0.25, 0.06], "second", bar=(first, 0.2745906))
        apart_m = np.linalg.norm(station.cell.T_base_part("sphere").translation - first)
    assert apart_m == pytest.approx(0.2745906, abs=1e-12)


def test_paper_twos_method_refuses_a_second_sphere(tmp_path, capsys):
    assert main(["run", "hand-eye-sphere", "--method", "p2", "--out", str(tmp_path / "r"), *QUICK, *BAR]) == 2
    assert "needs --method joint" in capsys.readouterr().err

"""A user's own part and arm in the commands: one configuration file each."""

import json
from pathlib import Path

import pytest

from weldcell.cell.errors import BadInput
from weldcell.scenarios.command_line import main
from weldcell.scenarios.settings import resolve
from weldcell.scenarios.user_cell.own_cell import own_cell

EXAMPLE = Path(__file__).parents[2] / "docs/examples/own_part_and_robot"


def test_files_are_looked_for_beside_the_file_that_names_them():
    config = resolve("v-seam", file=EXAMPLE / "own_cell.yaml").config
    assert Path(config.arm_file) == (EXAMPLE / "long_arm.yaml").resolve()
    assert Path(config.seam.part_file) == (EXAMPLE / "arc_plate.yaml").resolve()


def test_files_on_the_command_line_are_looked_for_where_one_is(monkeypatch):
    monkeypatch.chdir(EXAMPLE)
    config = resolve("v-seam", options={"arm_file": "long_arm.yaml"}).config
    assert Path(config.arm_file) == (EXAMPLE / "long_arm.yaml").resolve()


def test_v_seam_runs_with_another_arm_and_part(tmp_path):
    """The limit is the project's own for a typical robot: 0.10 mm mean torch error."""
    place = tmp_path / "run"
    options = ["--seam.frames", "24", "--no-recording.enabled", "--out", str(place)]
    assert main(["run", "v-seam", "--config", str(EXAMPLE / "own_cell.yaml"), "--seed", "4", *options]) == 0
    metrics = json.loads((place / "metrics.json").read_text())["metrics"]
    assert metrics["frames_valid_count"] == 24
    assert all(metrics[f"seam_{name}_mean_error_mm"] < 0.10 for name in ("left", "root", "right"))
    repeated = resolve("v-seam", file=place / "config.yaml").config
    assert own_cell(repeated).arm is not None


def test_a_part_without_a_seam_is_refused(tmp_path):
    told = (EXAMPLE / "arc_plate.yaml").read_text().replace("seam_file", "# seam_file")
    (tmp_path / "part.yaml").write_text(told)
    (tmp_path / "arc_plate.stl").write_bytes((EXAMPLE / "arc_plate.stl").read_bytes())
    config = resolve("v-seam", options={"seam.part_file": str(tmp_path / "part.yaml")}).config
    with pytest.raises(BadInput, match=r"part\.yaml: found no seam, expected seam_file or seam_near_mm"):
        own_cell(config)


@pytest.mark.parametrize("field", ["--arm-file", "--seam.part-file"])
def test_a_missing_file_is_named(field, tmp_path, capsys):
    assert main(["run", "v-seam", field, str(tmp_path / "none.yaml"), "--out", str(tmp_path / "run")]) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("weldcell: error: ") and "none.yaml" in message
    assert not (tmp_path / "run").exists()

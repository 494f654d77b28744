"""The command `weldcell`: exit codes, one-line errors, and what a run leaves behind."""

import json
import signal
import subprocess
import sys
import time
import types

import pytest
import yaml

import weldcell
from weldcell.cell.errors import BadInput, JobFailed
from weldcell.scenarios.catalogue import SCENARIOS, Scenario
from weldcell.scenarios.command_line import main
from weldcell.scenarios.job import Outcome
from weldcell.scenarios.settings import fields, option_name

FAKE = Scenario(name="fake", summary="a fake for tests", module="fake_recipe")


@pytest.fixture
def weldcell_run(tmp_path, monkeypatch, capfd):
    """Runs the command in a folder of its own, with a recipe of the test; gives exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments, recipe=lambda job: Outcome(metrics={"seed_count": job.seed})):
        module = types.ModuleType(FAKE.module)
        module.run = recipe
        monkeypatch.setitem(sys.modules, FAKE.module, module)
        code = main([str(argument) for argument in arguments], scenarios=[FAKE])
        captured = capfd.readouterr()
        return code, captured.out, captured.err

    return call


def raising(error):
    def recipe(job):
        job.write_calibration("hand_eye", {"half": True})
        raise error

    return recipe


def assert_refused(result, *words):
    code, _, errors = result
    assert code == 2
    assert errors.startswith("weldcell: error: ")
    assert errors.count("\n") == 1
    for word in words:
        assert word in errors


def test_a_run_leaves_its_files_and_names_its_folder(weldcell_run, tmp_path):
    code, output, _ = weldcell_run("run", "fake", "--seed", 5, "--robot", "bad")
    assert code == 0
    assert output.rstrip().endswith("runs/fake-5")
    metrics = json.loads((tmp_path / "runs" / "fake-5" / "metrics.json").read_text())
    assert metrics["metrics"] == {"seed_count": 5}
    config = yaml.safe_load((tmp_path / "runs" / "fake-5" / "config.yaml").read_text())
    assert (config["scenario"], config["seed"], config["robot"]) == ("fake", 5, "bad")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["config.yaml", "fake-5", "metrics.json", "runs"]


def test_the_last_line_is_the_recording_if_there_is_one(weldcell_run):
    def recipe(job):
        job.recording_path.write_bytes(b"a recording")
        return Outcome(metrics={})

    _, output, _ = weldcell_run("run", "fake", "--out", "here and there", recipe=recipe)
    assert output.splitlines()[-1] == "here and there/recording.rrd"


def test_a_configuration_repeats_the_run_into_the_same_bytes(weldcell_run, tmp_path):
    weldcell_run("run", "fake", "--seed", 5, "--sensor.peak-grey", 111)
    code, _, _ = weldcell_run("run", "fake", "--config", "runs/fake-5/config.yaml", "--out", "again")
    assert code == 0
    for name in ("config.yaml", "metrics.json"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "runs" / "fake-5" / name).read_bytes()


def test_an_exceeded_limit_is_exit_code_one_with_the_reason_and_the_files(weldcell_run, tmp_path):
    def recipe(_):
        return Outcome(metrics={"error_mm": 0.6}, limits={"error_mm": 0.5})

    code, output, errors = weldcell_run("run", "fake", recipe=recipe)
    assert code == 1
    assert "failed" in output
    assert errors.splitlines()[-1] == "weldcell: failed: error_mm is 0.6, limit 0.5"
    assert json.loads((tmp_path / "runs" / "fake-0" / "metrics.json").read_text())["passed"] is False


def test_a_failed_job_is_exit_code_one_and_leaves_what_shows_why(weldcell_run, tmp_path):
    code, _, errors = weldcell_run("run", "fake", recipe=raising(JobFailed("seam lost at 120 mm")))
    assert code == 1
    assert errors == "weldcell: failed: seam lost at 120 mm\n"
    assert (tmp_path / "runs" / "fake-0" / "calibration" / "hand_eye.yaml").exists()
    assert json.loads((tmp_path / "runs" / "fake-0" / "metrics.json").read_text())["passed"] is False


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (BadInput("plate.stl: found\ntwo lines"), "plate.stl: found two lines"),
        (OSError(28, "No space left on device", "recording.rrd"), "recording.rrd: No space left on device"),
        (ZeroDivisionError("division by zero"), "unexpected ZeroDivisionError: division by zero"),
    ],
)
def test_a_run_that_breaks_says_so_in_one_line_and_leaves_nothing(weldcell_run, tmp_path, error, words):
    assert_refused(weldcell_run("run", "fake", recipe=raising(error)), words)
    assert list(tmp_path.iterdir()) == []


def test_debug_shows_where_it_happened(weldcell_run):
    code, _, errors = weldcell_run("run", "fake", "--debug", recipe=raising(BadInput("no")))
    assert code == 2
    assert "Traceback" in errors
    assert errors.splitlines()[-1] == "weldcell: error: no"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], ["COMMAND"]),
        (["weld"], ["weld", "list"]),
        (["run"], ["SCENARIO"]),
        (["run", "fate"], ["found 'fate'", "did you mean fake?"]),
        (["run", "fake", "more"], ["found 'more'"]),
        (["run", "fake", "--sensor.peek-grey", "3"], ["--sensor.peek-grey", "did you mean --sensor.peak-grey?"]),
        (["run", "fake", "--sensor.peak_grey", "300"], ["--sensor.peak-grey: found 300", "from 1 to 255"]),
        (["run", "fake", "--sensor.peak-grey"], ["--sensor.peak-grey"]),
        (["run", "fake", "--seed", "-1"], ["--seed: found -1", "whole number from 0"]),
        (["run", "fake", "--seed", "x"], ["--seed: found 'x'"]),
        (["run", "fake", "--config", "none.yaml"], ["none.yaml: ", "No such file"]),
        (["run", "fake", "--out", "/dev/null"], ["/dev/null: found a file"]),
        (["run", "fake", "--out", "/dev/null/below"], ["/dev/null/below: Not a directory"]),
        (["run", "fake", "--out", "x" * 300], ["File name too long"]),
        (["view", "none"], ["none: found no such file or folder"]),
        (["snapshot", "none", "--out", "a.png"], ["none: found no such file or folder"]),
        (["snapshot", "none"], ["--out"]),
        (["snapshot", ".", "--out", "a.png", "--frame", "x"], ["--frame"]),
    ],
)
def test_bad_input_is_refused_in_one_line_and_leaves_nothing(weldcell_run, tmp_path, arguments, words):
    assert_refused(weldcell_run(*arguments), *words)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_must_be_called_a_picture(weldcell_run, tmp_path):
    (tmp_path / "a.rrd").write_bytes(b"")
    assert_refused(weldcell_run("snapshot", "a.rrd", "--out", "a.jpeg"), "--out: found 'a.jpeg'", ".png")


def test_help_shows_every_option_with_its_unit_and_default(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["run", "--help"])
    assert ended.value.code == 0
    text = " ".join(capsys.readouterr().out.split())
    for field in fields():
        assert f"{option_name(field.path)} " in text
    assert "--sensor.pixel-um UM Pixel pitch (default: 3.45 um)" in text
    assert "--no-sensor.noise is false" in text
    assert "--disturbances [KIND[:START-END[:STRENGTH]]" in text


def test_listing_needs_no_simulator():
    """Importing the simulator or the recorder takes longer than the half second that a listing may take."""
    script = (
        "import sys\n"
        "from weldcell.scenarios.command_line import main\n"
        "code = main(['list'])\n"
        "heavy = {'mujoco', 'rerun', 'cv2', 'scipy', 'numpy', 'pydantic'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else code)"
    )
    listing = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert listing.stderr == ""
    assert listing.returncode == 0
    lines = listing.stdout.splitlines()
    assert [line.split()[0] for line in lines] == [scenario.name for scenario in SCENARIOS]
    by_module = subprocess.run([sys.executable, "-m", "weldcell", "list"], capture_output=True, text=True, check=True)
    assert by_module.stdout == listing.stdout


def test_version_is_told(capsys):
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out == f"weldcell {weldcell.__version__}\n"


_SLOW_RUN = """
import sys, time, types
from weldcell.scenarios.catalogue import Scenario
from weldcell.scenarios.command_line import main
def run(job):
    print("begun", flush=True)
    time.sleep(60)
sys.modules["slow"] = types.ModuleType("slow")
sys.modules["slow"].run = run
sys.exit(main(["run", "slow"], scenarios=[Scenario(name="slow", summary="", module="slow")]))
"""


def test_an_interruption_is_clean(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", _SLOW_RUN], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "begun\n"
        time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 130
    assert errors == "weldcell: error: interrupted; nothing was left behind\n"
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_had_enough_gets_no_traceback():
    command = f"{sys.executable} -m weldcell list | true"
    pipeline = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert pipeline.stderr == ""

"""The folder of a run: whatever interrupts a run, what was finished stays whole."""

import os
import shutil
import signal
import subprocess
import sys

import pytest

from weldcell.cell.errors import BadInput
from weldcell.scenarios import run_folder as module
from weldcell.scenarios.run_folder import recording_of, run_folder


class Killed(BaseException):
    """Stands for the end of the process at this very moment."""


def write_run(folder, version, *, recording=True):
    for name in ("config.yaml", "metrics.json", *(["recording.rrd"] if recording else [])):
        (folder / name).write_text(version)
    (folder / "calibration").mkdir()
    (folder / "calibration" / "hand_eye.yaml").write_text(version)


def content(place):
    return {str(path.relative_to(place)): path.read_text() for path in place.rglob("*") if path.is_file()}


def run_content(version):
    names = ("config.yaml", "metrics.json", "recording.rrd", "calibration/hand_eye.yaml")
    return dict.fromkeys(names, version)


def test_the_files_appear_together_at_the_end(tmp_path):
    place = tmp_path / "runs" / "boss-0"
    with run_folder(place) as folder:
        write_run(folder, "new")
        assert not (place / "metrics.json").exists()
    assert content(place) == run_content("new")
    assert [path.name for path in place.iterdir() if path.name.startswith(".")] == []


def test_a_run_that_breaks_leaves_nothing(tmp_path):
    with pytest.raises(Killed), run_folder(tmp_path / "runs" / "boss-0") as folder:
        write_run(folder, "half")
        raise Killed
    assert list(tmp_path.iterdir()) == []


def test_a_finished_run_is_only_replaced_when_asked_to(tmp_path):
    with run_folder(tmp_path / "run") as folder:
        write_run(folder, "old")
    with pytest.raises(BadInput, match=r"found a finished run.*--overwrite"), run_folder(tmp_path / "run"):
        pytest.fail("the run began")
    assert content(tmp_path / "run") == run_content("old")
    with run_folder(tmp_path / "run", overwrite=True) as folder:
        write_run(folder, "new")
    assert content(tmp_path / "run") == run_content("new")


def test_a_replaced_run_leaves_no_file_of_its_own_but_those_that_a_person_added(tmp_path):
    with run_folder(tmp_path / "run") as folder:
        write_run(folder, "old")
    (tmp_path / "run" / "notes.txt").write_text("mine")
    with run_folder(tmp_path / "run", overwrite=True) as folder:
        write_run(folder, "new", recording=False)
    expected = run_content("new") | {"notes.txt": "mine"}
    del expected["recording.rrd"]
    assert content(tmp_path / "run") == expected


def test_a_failed_overwrite_leaves_the_former_run(tmp_path):
    with run_folder(tmp_path / "run") as folder:
        write_run(folder, "old")
    with pytest.raises(Killed), run_folder(tmp_path / "run", overwrite=True) as folder:
        write_run(folder, "half")
        raise Killed
    assert content(tmp_path / "run") == run_content("old")


def test_other_peoples_files_are_not_taken_for_a_run(tmp_path):
    (tmp_path / "config.yaml").write_text("of another program")
    for overwrite in (False, True):
        with pytest.raises(BadInput, match=r"found config\.yaml"), run_folder(tmp_path, overwrite=overwrite):
            pytest.fail("the run began")
    assert content(tmp_path) == {"config.yaml": "of another program"}


def test_an_empty_folder_and_a_link_to_one_can_be_used(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    with run_folder(tmp_path / "link") as folder:
        write_run(folder, "new")
    assert content(tmp_path / "real") == run_content("new")


def interrupted_at(step, place, monkeypatch):
    """Whether a run that replaces another was cut off before its `step`-th change of the disk."""
    changes = 0

    def dying(function):
        def call(*arguments, **options):
            nonlocal changes
            changes += 1
            if changes > step:  # and so for all that follow, as in a process that is gone
                raise Killed
            return function(*arguments, **options)

        return call

    with monkeypatch.context() as patch:
        for name in ("rename", "unlink", "rmdir", "mkdir"):
            patch.setattr(os, name, dying(getattr(os, name)))
        try:
            with run_folder(place, overwrite=True) as folder:
                write_run(folder, "new")
        except Killed:
            return True
    return False


def test_a_kill_at_any_step_leaves_the_former_or_the_new_run_whole(tmp_path, monkeypatch):
    found = []
    for step in range(100):
        place = tmp_path / f"run-{step}"
        with run_folder(place) as folder:
            write_run(folder, "old")
        interrupted = interrupted_at(step, place, monkeypatch)
        with pytest.raises(BadInput, match="finished run"), run_folder(place):  # what comes next puts things right
            pytest.fail("the finished run was lost")
        found.append(content(place)["metrics.json"])
        assert content(place) == run_content(found[-1])
        if not interrupted:
            break
    else:
        pytest.fail("never came to the end")
    # First the former run stands, then the new one, and never the former again.
    assert found == sorted(found, reverse=True)
    assert found.count("new") > 5
    assert found.count("old") > 2


def test_remains_of_a_kill_do_not_block_the_next_run(tmp_path):
    (tmp_path / "run" / ".unfinished" / "calibration").mkdir(parents=True)
    (tmp_path / "run" / ".unfinished" / "config.yaml").write_text("half")
    with run_folder(tmp_path / "run") as folder:
        assert list(folder.iterdir()) == []
        write_run(folder, "new")
    assert content(tmp_path / "run") == run_content("new")


_WAITING_RUN = """
import sys, time
from pathlib import Path
from weldcell.scenarios.run_folder import run_folder
with run_folder(Path(sys.argv[1]), overwrite=True) as folder:
    (folder / "config.yaml").write_text("half")
    print("begun", flush=True)
    time.sleep(60)
"""


def test_two_runs_into_one_folder_are_refused_until_the_first_is_killed(tmp_path):
    place = tmp_path / "run"
    with run_folder(place) as folder:
        write_run(folder, "old")
    with subprocess.Popen([sys.executable, "-c", _WAITING_RUN, place], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout.readline() == "begun\n"
        with pytest.raises(BadInput, match="another run is writing there"), run_folder(place, overwrite=True):
            pytest.fail("both ran")
        other.send_signal(signal.SIGKILL)
    with run_folder(place, overwrite=True) as folder:
        write_run(folder, "new")
    assert content(place) == run_content("new")


def test_a_file_where_the_folder_should_be_is_refused(tmp_path):
    (tmp_path / "run").write_text("a file")
    with pytest.raises(BadInput, match="found a file, expected a folder"), run_folder(tmp_path / "run"):
        pytest.fail("the run began")
    with pytest.raises(OSError, match="Not a directory"), run_folder(tmp_path / "run" / "below"):
        pytest.fail("the run began")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(module.os, "access", lambda *_: False)  # a superuser may write everywhere
    with pytest.raises(PermissionError), run_folder(tmp_path / "run"):
        pytest.fail("the run began")
    assert list(tmp_path.iterdir()) == []


def test_a_recording_is_found_by_its_run_or_by_itself(tmp_path):
    with pytest.raises(BadInput, match="no such file or folder"):
        recording_of(tmp_path / "run")
    with run_folder(tmp_path / "run") as folder:
        write_run(folder, "new")
    recording = tmp_path / "run" / "recording.rrd"
    assert recording_of(tmp_path / "run") == recording_of(recording) == recording
    recording.unlink()
    with pytest.raises(BadInput, match=r"a folder without recording\.rrd"):
        recording_of(tmp_path / "run")


def test_names_may_be_strange(tmp_path):
    place = tmp_path / "-a b\nc é"
    with run_folder(place) as folder:
        write_run(folder, "new")
    assert content(place) == run_content("new")
    shutil.rmtree(place)

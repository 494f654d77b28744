"""`weldcell dataset`: the same bytes whatever happens, read back as its users do."""

import hashlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO

from weldcell.scenarios.command_line import main
from weldcell.scenarios.run_folder import lock_folder

SMALL = ("--sensor.width-px", 320, "--sensor.height-px", 240, "--sensor.pixel-um", 15.525)  # P2's view, coarser
ASKED = ("--count", 4, "--seed", 3, "--dataset.frames-per-plate", 2, *SMALL)


def arguments(place, *more):
    return [str(word) for word in ("dataset", *ASKED, "--out", place, *more)]


def contents(place):
    return {str(path.relative_to(place)): path.read_bytes() for path in sorted(place.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A data set made by two workers without interruption."""
    place = tmp_path_factory.mktemp("sets") / "two workers"
    assert main(arguments(place, "--workers", 2)) == 0
    return place


@pytest.fixture(scope="module")
def coco(made):
    return COCO(str(made / "annotations.json"))


def test_the_manifest_has_size_and_checksum_of_every_file(made):
    manifest = json.loads((made / "manifest.json").read_text())
    files = contents(made)
    files.pop("manifest.json")
    assert manifest["files"] == {
        name: {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()} for name, content in files.items()
    }
    assert (manifest["count"], manifest["seed"], manifest["format"]) == (4, 3, "coco")
    assert {"mujoco", "numpy", "pyarrow", "python"} <= set(manifest["versions"])


def test_killed_and_resumed_with_one_worker_gives_the_same_bytes(made, tmp_path, capfd):
    place = tmp_path / "killed"
    command = [sys.executable, "-m", "weldcell", *arguments(place, "--workers", 1)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        deadline_s = time.monotonic() + 60
        while not (place / ".unfinished" / "plate-00000.json").exists():
            assert process.poll() is None and time.monotonic() < deadline_s
            time.sleep(0.01)
        process.send_signal(signal.SIGKILL)
    assert not (place / "manifest.json").exists()
    kept = (place / "images" / "000000.png").stat().st_mtime_ns
    assert main(arguments(place, "--workers", 1)) == 0
    assert "an interrupted run had finished was kept" in capfd.readouterr().out
    assert contents(place) == contents(made)
    assert (place / "images" / "000000.png").stat().st_mtime_ns == kept


def test_a_finished_set_is_left_as_it_is_and_another_refused(made, capfd):
    before = {path: path.stat().st_mtime_ns for path in made.rglob("*")}
    assert main(arguments(made, "--workers", 1)) == 0
    assert "finished already" in capfd.readouterr().out
    for other in (("--seed", 4), ("--count", 7), ("--format", "yolo"), ("--sensor.peak-grey", 90)):
        assert main(arguments(made, *other)) == 2
        error = capfd.readouterr().err
        assert "found a finished data set" in error and "--overwrite" in error
    assert {path: path.stat().st_mtime_ns for path in made.rglob("*")} == before


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # pycocotools with NumPy 2
def test_pictures_masks_and_keypoints_agree(made, coco):
    assert coco.getImgIds() == [1, 2, 3, 4]
    assert coco.loadCats(1)[0]["keypoints"] == ["left", "root", "right"]
    for annotation in coco.anns.values():
        name = coco.imgs[annotation["image_id"]]["file_name"]
        picture, mask = (cv2.imread(str(made / folder / name), cv2.IMREAD_UNCHANGED) for folder in ("images", "masks"))
        assert picture.shape == mask.shape == (240, 320) and picture.dtype == mask.dtype == np.uint8
        np.testing.assert_array_equal(coco.annToMask(annotation), mask == 1)
        encoded = coco_mask.encode(np.asfortranarray((mask == 1).astype(np.uint8)))
        assert annotation["segmentation"]["counts"] == encoded["counts"].decode()
        assert annotation["bbox"] == coco_mask.toBbox(encoded).tolist()
        assert annotation["area"] == coco_mask.area(encoded)
        keypoints = np.array(annotation["keypoints"]).reshape(3, 3)
        assert annotation["num_keypoints"] == np.count_nonzero(keypoints[:, 2])
        rows, columns = np.nonzero(mask == 1)
        for u, v, visibility in keypoints[[0, 2]]:  # the edges; a root with a gap is a point between surfaces
            assert visibility < 2 or np.hypot(rows - v, columns - u).min() < 1.5  # px: a seen edge is on the stripe


def test_tables_hold_points_that_project_to_their_pixels_and_features_as_the_annotations(made, coco):
    frames = pq.read_table(made / "frames.parquet").to_pylist()
    table = pq.read_table(made / "stripe.parquet")
    stripe = {name: table[name].to_numpy() for name in table.column_names if name != "surface"}
    stripe["surface"] = np.array(table["surface"].to_pylist(), dtype=object)
    assert [row["frame"] for row in frames] == list(range(4))
    assert [row["plate"] for row in frames] == [0, 0, 1, 1]
    for row in frames:
        own = (stripe["frame"] == row["frame"]) & (stripe["bounce"] == 1)
        assert set(stripe["u_px"][own].astype(int)) == set(range(320))
        lit = own & (stripe["visibility"] > 0)
        camera, base = (
            np.stack([stripe[f"{of}_{axis}_mm"][lit] for axis in "xyz"], axis=1) for of in ("camera", "base")
        )
        matrix, distortion = np.reshape(row["camera_matrix"], (3, 3)), np.array(row["distortion"])
        pixels, _ = cv2.projectPoints(camera, np.zeros(3), np.zeros(3), matrix, distortion)
        np.testing.assert_allclose(pixels[:, 0].T, [stripe["u_px"][lit], stripe["v_px"][lit]], atol=1e-5)  # px
        np.testing.assert_allclose(camera @ row["plane_normal_camera"], row["plane_offset_mm"], atol=1e-9)
        T_base_camera = np.reshape(row["T_base_flange_actual"], (4, 4)) @ np.reshape(row["T_flange_camera"], (4, 4))
        np.testing.assert_allclose(base, camera @ T_base_camera[:3, :3].T + T_base_camera[:3, 3], atol=1e-9)  # mm
        assert set(stripe["surface"][lit]) <= {"v_groove_plate", "table_top", "floor"}
        assert set(stripe["surface"][own & ~lit]) <= {None}
        keypoints = np.reshape(coco.anns[row["frame"] + 1]["keypoints"], (3, 3))
        for name, (u, v, visibility) in zip(("left", "root", "right"), keypoints, strict=True):
            assert row[f"{name}_visibility"] == visibility
            if visibility:
                assert (row[f"{name}_u_px"], row[f"{name}_v_px"]) == (u, v)


@pytest.fixture(scope="module")
def replaced(made, tmp_path_factory):
    """A finished COCO set with strangers' files among its own, replaced by a shorter YOLO set."""
    place = tmp_path_factory.mktemp("sets") / "yolo"
    shutil.copytree(made, place)
    for name in ("notes.txt", "images/mine.png"):
        (place / name).write_text("mine")
    assert main(arguments(place, "--format", "yolo", "--count", 2, "--workers", 1, "--overwrite")) == 0
    return place


def test_overwriting_replaces_a_set_and_touches_nothing_else(replaced):
    assert sorted(path.name for path in replaced.iterdir()) == [
        "config.yaml", "data.yaml", "frames.parquet", "images", "labels", "manifest.json", "masks", "notes.txt",
        "stripe.parquet",
    ]  # fmt: skip
    pictures = sorted(path.name for path in (replaced / "images").iterdir())
    assert pictures == ["000000.png", "000001.png", "mine.png"]
    assert (replaced / "notes.txt").read_text() == (replaced / "images/mine.png").read_text() == "mine"


def test_yolo_labels_say_the_same_in_shares_of_the_picture(made, coco, replaced):
    data = yaml.safe_load((replaced / "data.yaml").read_text())
    assert data["kpt_shape"] == [3, 3] and data["names"] == ["seam"] and (replaced / data["train"]).is_dir()
    for frame in range(2):  # a shorter set has the same frames
        name = f"{frame:06d}"
        assert (replaced / f"images/{name}.png").read_bytes() == (made / f"images/{name}.png").read_bytes()
        kind, *numbers = map(float, (replaced / f"labels/{name}.txt").read_text().split())
        box, keypoints = np.array(numbers[:4]), np.reshape(numbers[4:], (3, 3))
        annotation = coco.anns[frame + 1]
        left, top, width, height = annotation["bbox"]
        expected = [(left + width / 2) / 320, (top + height / 2) / 240, width / 320, height / 240]
        np.testing.assert_allclose(box, expected, rtol=1e-7)
        truth = np.reshape(annotation["keypoints"], (3, 3))
        np.testing.assert_array_equal(keypoints[:, 2], truth[:, 2])
        labelled = truth[:, 2] > 0
        np.testing.assert_allclose(keypoints[labelled, :2] * [320, 240] - 0.5, truth[labelled, :2], atol=1e-4)  # px
        assert kind == 0


@pytest.mark.parametrize("name", ["images/000000.png", "annotations.json", "manifest.json"])
def test_a_folder_of_something_else_is_refused_and_left_alone(tmp_path, name, capfd):
    place = tmp_path / "someone's"
    (place / name).parent.mkdir(parents=True)
    (place / name).write_text("{}")
    for more in ((), ("--overwrite",)):
        assert main(arguments(place, *more)) == 2
        assert capfd.readouterr().err.startswith("weldcell: error: ")
    assert contents(place) == {name: b"{}"}


def test_a_set_that_was_begun_otherwise_is_refused(tmp_path, capfd):
    work = tmp_path / ".unfinished"
    work.mkdir()
    (work / "request.json").write_text(json.dumps({"count": 4, "seed": 5, "format": "coco"}))
    assert main(arguments(tmp_path)) == 2
    assert "an unfinished data set with seed 5, not 3" in capfd.readouterr().err
    assert (work / "request.json").exists()


def test_two_runs_into_one_folder_are_refused(tmp_path, capfd):
    lock = lock_folder(tmp_path)
    try:
        assert main(arguments(tmp_path)) == 2
    finally:
        os.close(lock)
    assert "another run is writing there" in capfd.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_said_in_a_line_and_leaves_nothing_half_written(tmp_path):
    """A limit on the size of files stands for the full disk: the first picture does not fit."""
    place = tmp_path / "full"
    done = subprocess.run(
        [sys.executable, "-m", "weldcell", *arguments(place, "--workers", 1)],
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000)),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("weldcell: error: ") and "File too large" in done.stderr
    assert not place.exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (("--count", 0), "--count: found 0"),
        (("--workers", -1), "--workers: found -1"),
        (("--dataset.groove-angle-deg", 30, 120), "dataset.groove_angle_deg"),
        (("--dataset.height-mm", -90, -80), "dataset.height_mm"),
        (("--dataset.materials", "wood"), "--dataset.materials"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_made(tmp_path, capfd, more, words):
    place = tmp_path / "never"
    assert main(arguments(place, *more)) == 2
    error = capfd.readouterr().err
    assert words in error and error.count("\n") == 1
    assert not place.exists()

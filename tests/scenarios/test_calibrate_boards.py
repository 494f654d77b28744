"""`weldcell calibrate camera` and `laser-plane` on the recorded-style pictures of docs/examples/boards."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from weldcell.cell.errors import BadInput
from weldcell.cell.optics import CameraModel
from weldcell.scenarios.camera_file import camera_mapping, read_camera
from weldcell.scenarios.command_line import main
from weldcell.scenarios.residual_plot import Bar, residual_png
from weldcell.scenarios.yaml_file import write_yaml

PICTURES = sorted((Path(__file__).parents[2] / "docs" / "examples" / "boards").glob("*.jpg"))
BOARD = ("--board", "11x8", "--square-mm", "7")
# The sensor that made them: 12 mm lens, 5.175 um pixels; light plane at 275 mm and 45 deg.
FOCAL_PX, OFFSET_MM = 12.0 / 5.175e-3, 275 / np.sqrt(2)
TRUE_CAMERA = CameraModel(
    width_px=960,
    height_px=720,
    focal_px=np.full(2, FOCAL_PX),
    principal_px=np.array([479.5, 359.5]),
    distortion=np.array([-0.10, 0.12, 2e-4, -1e-4, *np.zeros(10)]),
)


@pytest.fixture
def calibrate(capfd, tmp_path):
    def run(kind, images, *options, board=BOARD):
        out = tmp_path / "out"
        code = main(["calibrate", kind, *board, "--out", str(out), *map(str, options), "--", *map(str, images)])
        result = json.loads((out / "result.json").read_text()) if (out / "result.json").exists() else None
        return code, result, capfd.readouterr().err

    run.out = tmp_path / "out"
    return run


def camera_file(tmp_path):
    write_yaml(tmp_path / "camera.yaml", camera_mapping(TRUE_CAMERA))
    return tmp_path / "camera.yaml"


def test_the_camera_is_found_and_can_be_read_back(calibrate):
    code, result, errors = calibrate("camera", PICTURES[:7])
    assert (code, result["verdict"], errors) == (0, "accepted", "")
    # five sigma of what the result itself predicts
    sigma = np.sqrt(np.diag(result["covariance"]))
    found = np.array(result["estimate"]["matrix_px"])[[0, 0, 1], [0, 2, 2]]
    assert result["covariance_of"][:3] == ["fx_px", "cx_px", "cy_px"]
    assert np.all(np.abs(found - [FOCAL_PX, 479.5, 359.5]) < 5 * sigma[:3])
    assert sigma[0] < 1.5  # px
    assert result["held_out_rms_px"] < 0.06  # JPEG's blocks and the camera's noise
    assert set(result["residuals"]) == {picture.name for picture in PICTURES[:7]}
    camera = read_camera(calibrate.out / "camera.yaml")
    np.testing.assert_array_equal(camera.matrix, result["estimate"]["matrix_px"])
    plot = cv2.imread(str(calibrate.out / "residuals.png"))
    assert plot.shape[1] > 1000


def test_the_light_plane_is_found_with_a_known_camera(calibrate, tmp_path):
    code, result, _ = calibrate("laser-plane", PICTURES[:5], "--camera", camera_file(tmp_path))
    assert (code, result["verdict"]) == (0, "accepted")
    estimate = result["estimate"]
    angle_deg = np.degrees(np.arccos(np.dot(estimate["normal"], [0, -np.sqrt(0.5), np.sqrt(0.5)])))
    assert angle_deg < 0.05 and abs(estimate["offset_mm"] - OFFSET_MM) < 0.15
    assert estimate["theta_deg"] == pytest.approx(45, abs=0.05)
    assert result["residual_rms_mm"] < 0.04  # 0.3 px of speckle at 0.09 mm a pixel
    assert all(one["stripe_points"] > 10 for one in result["residuals"].values())
    assert not (calibrate.out / "camera.yaml").exists()


def test_camera_and_light_plane_are_found_together(calibrate):
    code, result, _ = calibrate("laser-plane", PICTURES[:7])
    assert (code, result["verdict"]) == (0, "accepted")
    assert abs(result["estimate"]["offset_mm"] - OFFSET_MM) < 0.15
    assert result["leave_one_out_rms_mm"] < 0.04
    read_camera(calibrate.out / "camera.yaml")


def test_pictures_without_the_board_are_named_and_left_out(calibrate, tmp_path):
    names = ["black.png", "saturated.png", "one\ncolumn wide.png", "-noise 16.png"]
    rng = np.random.default_rng(1)
    for name, picture in zip(
        names[:3], (np.zeros((720, 960), np.uint8), np.full((720, 960), 255, np.uint8)), strict=False
    ):
        cv2.imwrite(str(tmp_path / name), picture)
    cv2.imwrite(str(tmp_path / names[3]), rng.integers(0, 65535, (720, 960), np.uint16))
    odd = [tmp_path / name for name in (names[0], names[1], names[3])]
    code, result, errors = calibrate("laser-plane", [*PICTURES[:2], *odd], "--camera", camera_file(tmp_path))
    assert code == 0
    assert set(result["left_out"]) == {"black.png", "saturated.png", "-noise 16.png"}
    assert "black.png is left out: no board of 11x8 inner corners was found" in errors


def test_a_picture_whose_stripe_is_mistaken_is_named_and_not_used(calibrate, tmp_path):
    """A reflection brighter than the stripe, in one of five pictures."""
    soiled = cv2.imread(str(PICTURES[2]), cv2.IMREAD_GRAYSCALE)
    cv2.line(soiled, (250, 180), (750, 140), 235, 3, cv2.LINE_AA)
    cv2.imwrite(str(tmp_path / "reflection.png"), soiled)
    pictures = [PICTURES[0], PICTURES[1], PICTURES[3], PICTURES[4], tmp_path / "reflection.png"]
    code, result, errors = calibrate("laser-plane", pictures, "--camera", camera_file(tmp_path))
    assert (code, result["verdict"], result["outliers"]) == (0, "doubtful", ["reflection.png"])
    assert "reflection.png misses the light plane" in errors
    assert abs(result["estimate"]["offset_mm"] - OFFSET_MM) < 0.15


def test_a_laser_without_a_stripe_fails_in_words(calibrate, tmp_path):
    clean = []
    for k, path in enumerate(PICTURES[:3]):
        picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        clean.append(tmp_path / f"off{k}.png")
        cv2.imwrite(str(clean[-1]), np.minimum(cv2.medianBlur(picture, 15), 90))
    code, result, errors = calibrate("laser-plane", clean, "--camera", camera_file(tmp_path))
    assert (code, result) == (1, None)
    assert "0 pictures show the stripe on the board" in errors and errors.count("\n") == 1


def test_the_same_pose_again_and_again_is_refused(calibrate, tmp_path):
    copies = []
    for k in range(3):
        copies.append(tmp_path / f"copy{k}.jpg")
        shutil.copy(PICTURES[0], copies[-1])
    code, result, errors = calibrate("laser-plane", copies, "--camera", camera_file(tmp_path))
    assert code == 1 and result["verdict"] == "refused" and result["estimate"] is None
    assert "one line" in errors


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"matrix_px": [[0.0, 0, 480], [0, 0.0, 360], [0, 0, 1]]}, "more than 10 pixels"),
        ({"matrix_px": [[0.012, 0, 480], [0, 0.012, 360], [0, 0, 1]]}, "not metres or mm"),
        ({"matrix_px": [[2300.0, 5.0, 480], [0, 2300.0, 360], [0, 0, 1]]}, "matrix_px"),
        ({"matrix_px": "2300"}, "matrix_px"),
        ({"distortion": [9.0, -200.0, *[0.0] * 10]}, "cannot be inverted"),
        ({"distortion": [0.0, 0.0]}, "distortion"),
        ({"width_px": -3}, "width_px"),
        ({"tilt_deg": [0.0, None]}, "tilt_deg"),
    ],
)
def test_bad_cameras_are_refused_by_field(change, words, tmp_path):
    path = tmp_path / "camera.yaml"
    write_yaml(path, camera_mapping(TRUE_CAMERA) | change)
    with pytest.raises(BadInput, match=words) as refusal:
        read_camera(path)
    assert str(path) in str(refusal.value)


@pytest.mark.parametrize(
    ("images", "board", "words"),
    [
        (["nothing.png"], BOARD, "nothing.png: no such file"),
        ([PICTURES[0]], ("--board", "11", "--square-mm", "7"), "COLSxROWS"),
        ([PICTURES[0]], ("--board", "2x200", "--square-mm", "7"), "3 to 100"),
        ([PICTURES[0]], ("--board", "11x8", "--square-mm", "nan"), "--square-mm"),
        ([PICTURES[0]], ("--board", "11x8", "--square-mm", "0.007"), "--square-mm"),
        ([PICTURES[0], PICTURES[0]], BOARD, "found twice"),
        (PICTURES[:3], ("--board", "10x7", "--square-mm", "7"), "0 of 3 pictures"),
    ],
)
def test_bad_input_ends_in_one_line_and_leaves_nothing(calibrate, images, board, words):
    code, _, errors = calibrate("camera", images, board=board)
    assert code == 2 and words in errors and errors.count("\n") == 1
    assert not calibrate.out.exists()


def test_pictures_of_different_size_and_no_pictures_are_refused(calibrate, tmp_path):
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), cv2.imread(str(PICTURES[0]))[:500])
    code, _, errors = calibrate("camera", [PICTURES[0], small])
    assert code == 2 and "960 x 500" in errors and "small.png" in errors
    text = tmp_path / "text.png"
    text.write_text("not a picture")
    code, _, errors = calibrate("camera", [PICTURES[0], text])
    assert code == 2 and "text.png" in errors


def test_a_camera_of_another_size_is_refused(calibrate, tmp_path):
    path = tmp_path / "camera.yaml"
    write_yaml(path, camera_mapping(TRUE_CAMERA) | {"width_px": 640})
    code, _, errors = calibrate("laser-plane", PICTURES[:2], "--camera", path)
    assert code == 2 and "640 x 720" in errors


def test_results_are_not_overwritten_unasked(calibrate, tmp_path):
    camera = camera_file(tmp_path)
    assert calibrate("laser-plane", PICTURES[:3], "--camera", camera)[0] == 0
    code, _, errors = calibrate("laser-plane", PICTURES[:3], "--camera", camera)
    assert code == 2 and "--overwrite" in errors


def test_the_residual_plot_takes_any_names_and_values():
    bars = [Bar(name=f"näme\n{k}" * 9, value=value) for k, value in enumerate((0.0, float("nan"), 3.0))]
    decoded = cv2.imdecode(np.frombuffer(residual_png("t", "mm", bars * 40), np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape[0] < 1400  # px: the sixty longest only
    assert residual_png("t", "mm", [])

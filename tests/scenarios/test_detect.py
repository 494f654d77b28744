"""`weldcell detect` on users' own pictures."""

import csv
import struct
import time
import zlib

import cv2
import numpy as np
import pytest

from tracking.groove_pictures import CORNERS_PX, SHAPE, colour_picture, grey_picture, turned
from weldcell.scenarios.command_line import main
from weldcell.scenarios.detect import overlay_names

TRUE_PX = CORNERS_PX[1:4]


@pytest.fixture
def detect(tmp_path, capfd):
    def call(*arguments, out=tmp_path / "out"):
        code = main(["detect", *map(str, arguments), "--out", str(out)])
        said = capfd.readouterr()
        return code, said.out, said.err

    return call


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "groove.png"
    cv2.imwrite(str(path), grey_picture(rng=np.random.default_rng(0)))
    return path


def _rows(folder, name):
    with (folder / name).open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _points_px(rows):
    return np.array([[float(row["u_px"]), float(row["v_px"])] for row in rows])


def test_a_picture_gives_stripe_features_and_overlay(detect, picture, tmp_path):
    code, said, errors = detect(picture, "--joint", "v")
    assert code == 0 and errors == "" and said.count("\n") == 1 and "groove.png" in said
    features = _rows(tmp_path / "out", "features.csv")
    assert [row["feature"] for row in features] == ["left", "root", "right"]
    assert all(row == row | {"image": str(picture), "valid": "true", "reason": ""} for row in features)
    assert np.abs(_points_px(features) - TRUE_PX).max() < 0.3  # px; five of the predicted 0.06
    stripe = _rows(tmp_path / "out", "stripe.csv")
    assert list(stripe[0]) == ["image", "u_px", "v_px", "sigma_px"] and len(stripe) > 740
    overlay = cv2.imread(str(tmp_path / "out" / "groove-overlay.png"))
    assert overlay.shape[0] > SHAPE[0] and overlay.shape[1] >= SHAPE[1]
    green = (overlay[..., 1] > 200) & (overlay[..., 0] < 150) & (overlay[..., 2] < 100)
    assert green[: SHAPE[0]].sum() > 500  # the stripe's line
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "features.csv",
        "groove-overlay.png",
        "stripe.csv",
    ]


def _twelve_bits(path):
    grey = grey_picture(rng=np.random.default_rng(1)).astype(float)
    cv2.imwrite(str(path), np.rint(grey * 16).astype(np.uint16))
    return TRUE_PX


def _red_on_a_board(path):
    rgb = colour_picture(0, rng=np.random.default_rng(2))
    cv2.imwrite(str(path), rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])
    return TRUE_PX


def _colours_of_16_bits(path):
    rgb = colour_picture(1, rng=np.random.default_rng(3)).astype(np.uint16) * 257
    cv2.imwrite(str(path), rgb[..., ::-1])
    return TRUE_PX


def _upright(path):
    cv2.imwrite(str(path), np.rot90(grey_picture(rng=np.random.default_rng(4)), -1))
    return np.column_stack([SHAPE[0] - 1 - TRUE_PX[:, 1], TRUE_PX[:, 0]])


def _diagonal(angle_deg):
    def write(path):
        corners_px = turned(CORNERS_PX, np.deg2rad(angle_deg))
        cv2.imwrite(str(path), grey_picture(corners_px, rng=np.random.default_rng(5)))
        return corners_px[1:4]

    return write


@pytest.mark.parametrize(
    ("name", "write", "tolerance_px"),
    [
        ("twelve bits.tiff", _twelve_bits, 0.3),
        ("red.jpg", _red_on_a_board, 1.0),
        ("sixteen bits.png", _colours_of_16_bits, 1.0),
        ("upright.bmp", _upright, 0.3),
        ("30 degrees.png", _diagonal(30), 0.4),
        ("45 degrees.png", _diagonal(45), 0.4),
    ],
)
def test_each_kind_of_picture_gives_the_groove(detect, tmp_path, name, write, tolerance_px):
    true_px = write(tmp_path / name)
    code, _, errors = detect(tmp_path / name, "--joint", "v")
    assert code == 0, errors
    found_px = _points_px(_rows(tmp_path / "out", "features.csv"))
    true_px = true_px[np.argsort(true_px[:, 0] if name != "upright.bmp" else true_px[:, 1])]
    assert np.abs(found_px - true_px).max() < tolerance_px


def test_a_picture_without_a_joint_is_a_row_with_its_reason(detect, picture, tmp_path):
    cv2.imwrite(str(tmp_path / "flat.png"), grey_picture(CORNERS_PX[[0, 4]], rng=np.random.default_rng(6)))
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros(SHAPE, np.uint8))
    code, said, errors = detect(picture, tmp_path / "flat.png", tmp_path / "black.png", "--joint", "v")
    assert code == 0 and errors == "" and said.count("\n") == 3
    features = _rows(tmp_path / "out", "features.csv")
    by_image = {row["image"]: row for row in features}
    flat, black = by_image[str(tmp_path / "flat.png")], by_image[str(tmp_path / "black.png")]
    assert flat["valid"] == black["valid"] == "false" and flat["u_px"] == black["v_px"] == ""
    assert "V-groove" in flat["reason"] and black["reason"] == "no stripe in the picture"
    images = {row["image"] for row in _rows(tmp_path / "out", "stripe.csv")}
    assert images == {str(picture), str(tmp_path / "flat.png")}


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros(SHAPE, np.uint8),
        np.full(SHAPE, 255, np.uint8),
        np.random.default_rng(0).integers(0, 256, (300, 400)).astype(np.uint8),
        np.random.default_rng(0).integers(0, 256, (300, 400, 3)).astype(np.uint8),
        np.full((300, 1), 9, np.uint8),
        np.full((1, 1), 9, np.uint8),
    ],
    ids=["black", "white", "random", "random colours", "one column", "one pixel"],
)
def test_nothing_found_in_any_picture_is_told_with_exit_code_1(detect, tmp_path, picture):
    cv2.imwrite(str(tmp_path / "nothing.png"), picture)
    code, _, errors = detect(tmp_path / "nothing.png", "--joint", "v")
    assert code == 1 and errors.startswith("weldcell: failed: no stripe was found in any")
    assert _rows(tmp_path / "out", "stripe.csv") == []


def _png_of_size(width, height):
    """A PNG whose header claims this size."""
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(bytes(1000))), (b"IEND", b"")]
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    return b"\x89PNG\r\n\x1a\n" + body


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "no such file"),
        (b"", "an empty file"),
        (b"id,x_mm\n1,2\n", "no picture that can be read"),
        (b"\x89PNG\r\n\x1a\n garbage", "no picture that can be read"),
        (_png_of_size(100_000, 10), "100000 x 10 pixels"),
        (_png_of_size(9_000, 9_000), "9000 x 9000 pixels"),
        (_png_of_size(300_000, 300_000), "far too many pixels"),
        ("cut", "damaged or cut short"),
        ("float", "type float32"),
    ],
)
def test_a_bad_file_is_refused_at_once_and_leaves_nothing(detect, picture, tmp_path, content, reason):
    bad = tmp_path / "bad.png"
    if content == "cut":
        bad.write_bytes(picture.read_bytes()[: picture.stat().st_size // 2])
    elif content == "float":
        bad = tmp_path / "bad.tiff"
        cv2.imwrite(str(bad), np.zeros(SHAPE, np.float32))
    elif content is not None:
        bad.write_bytes(content)
    started_s = time.monotonic()
    code, _, errors = detect(picture, bad, "--joint", "v")
    assert code == 2 and time.monotonic() - started_s < 5  # s
    assert errors.startswith(f"weldcell: error: {bad}: ") and reason in errors and errors.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_is_no_picture(detect, tmp_path):
    code, _, errors = detect(tmp_path, "--joint", "v")
    assert code == 2 and "found a folder, expected a picture" in errors


def test_an_unknown_joint_names_the_known_ones(detect, picture):
    code, _, errors = detect(picture, "--joint", "w")
    assert code == 2 and "--joint: found 'w', expected one of " in errors and "v-gap" in errors


def test_found_files_are_not_overwritten_unless_asked(detect, picture, tmp_path):
    assert detect(picture, "--joint", "v")[0] == 0
    before = (tmp_path / "out" / "features.csv").stat().st_mtime_ns
    code, _, errors = detect(picture, "--joint", "v")
    assert code == 2 and "--overwrite" in errors
    assert (tmp_path / "out" / "features.csv").stat().st_mtime_ns == before
    assert detect(picture, "--joint", "v", "--overwrite")[0] == 0


def test_other_files_in_the_folder_are_left_alone(detect, picture, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    assert detect(picture, "--joint", "v")[0] == 0
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"


def test_a_file_in_the_folder_s_place_is_refused(detect, picture, tmp_path):
    code, _, errors = detect(picture, "--joint", "v", out=picture)
    assert code == 2 and "found a file, expected a folder" in errors
    assert cv2.imread(str(picture)) is not None


def test_odd_names_are_handled(detect, picture, tmp_path):
    names = ["with space.png", "new\nline.png", "Größe Ω.png", "-dash.png", 'comma, "quote".png']
    for name in names:
        (tmp_path / name).write_bytes(picture.read_bytes())
    code, said, _ = detect(*(tmp_path / name for name in names), "--joint", "v")
    assert code == 0 and said.count("\n") == len(names)  # a line a picture
    images = [row["image"] for row in _rows(tmp_path / "out", "features.csv")[::3]]
    assert images == [str(tmp_path / name) for name in names]


def test_pictures_of_one_name_get_overlays_of_their_own(tmp_path):
    images = [
        tmp_path / "a.png",
        tmp_path / "b" / "a.png",
        tmp_path / "A.jpg",
        tmp_path / "a-2.png",
        tmp_path / "x.png",
    ]
    names = overlay_names(images)
    assert len({name.casefold() for name in names}) == len(images)
    assert names[0] == "a-overlay.png" and names[-1] == "x-overlay.png"
    assert len(overlay_names([tmp_path / ("ü" * 120 + ".png")])[0].encode()) <= 255


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "1", "CMYK"])
def test_other_ways_of_storing_the_same_grey_are_read(detect, picture, tmp_path, mode):
    from PIL import Image

    suffix = ".jpg" if mode == "CMYK" else ".png"
    Image.open(picture).convert("RGB").convert(mode, dither=Image.Dither.NONE).save(tmp_path / f"other{suffix}")
    code, _, errors = detect(tmp_path / f"other{suffix}", "--joint", "v")
    assert code == 0, errors
    found_px = _points_px(_rows(tmp_path / "out", "features.csv"))
    assert np.abs(found_px - TRUE_PX).max() < 0.5  # px

"""CSV files as users write them: what is odd is read, what is wrong is named by line and column."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.errors import BadInput
from weldcell.scenarios.user_data import match_ids, read_points, read_poses

EULER = "id,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg\n"
QUATERNION = "id,x_mm,y_mm,z_mm,qw,qx,qy,qz\n"
POINTS = "id,x_mm,y_mm,z_mm\n"


@pytest.fixture
def written(tmp_path):
    def write(content, name="file.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def test_millimetres_and_degrees_become_metres_and_radians(written):
    poses = read_poses(written(EULER + "a,1000,-20,3.5,90,0,0\n"), "XYZ")
    assert poses.ids == ("a",)
    assert poses.T_base_flange.translation == pytest.approx(np.array([[1.0, -0.020, 0.0035]]), abs=1e-15)
    # a quarter turn about x takes y to z
    assert poses.T_base_flange.rotation.apply([0, 1, 0]) == pytest.approx(np.array([[0, 0, 1]]), abs=1e-15)


def test_upper_case_turns_about_moving_axes_and_lower_case_about_fixed_ones(written):
    path = written(EULER + "a,0,0,0,10,20,30\n")
    about = {
        axis: Rotation.from_rotvec(turn) for axis, turn in zip("xyz", np.diag(np.deg2rad([10, 20, 30])), strict=True)
    }
    moving, fixed = (read_poses(path, sequence).T_base_flange.rotation[0] for sequence in ("XYZ", "xyz"))
    assert (moving.inv() * about["x"] * about["y"] * about["z"]).magnitude() < 1e-14
    assert (fixed.inv() * about["z"] * about["y"] * about["x"]).magnitude() < 1e-14


def test_quaternions_have_the_scalar_first_and_columns_any_order(written):
    half = np.sqrt(0.5)
    plain = read_poses(written(QUATERNION + f"a,1,2,3,{half:.4f},0,0,{half:.4f}\n"), None)
    mixed = read_poses(written(f"qw,qx,qy,qz,z_mm,y_mm,x_mm,id\n{half:.4f},0,0,{half:.4f},3,2,1,a\n"), None)
    for poses in (plain, mixed):
        assert poses.T_base_flange.rotation[0].apply([1, 0, 0]) == pytest.approx([0, 1, 0], abs=1e-15)
        assert poses.T_base_flange.translation[0] == pytest.approx([1e-3, 2e-3, 3e-3])


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbfid,x_mm,y_mm,z_mm\na,1,2,3\nb,4,5,6\n",
        b"id,x_mm,y_mm,z_mm\r\na,1,2,3\r\nb,4,5,6\r\n",
        b'id, x_mm, y_mm, z_mm\n\na, 1, 2, 3\n\n"b",4,5,6e0',
    ],
)
def test_byte_order_mark_windows_line_ends_and_blank_lines_are_read(written, content):
    points = read_points(written(content), once=True)
    assert points.ids == ("a", "b")
    assert points.points_sensor == pytest.approx(np.array([[1, 2, 3], [4, 5, 6]]) * 1e-3)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("", ["empty file", "id,x_mm"]),
        ("\n\n", ["empty file"]),
        (POINTS, ["header alone"]),
        ("id,x,y,z\na,1,2,3\n", ["line 1", "'id,x,y,z'", "id,x_mm,y_mm,z_mm"]),
        ("id;x_mm;y_mm;z_mm\na;1;2;3\n", ["line 1", "separated by ';'"]),
        ("a,1,2,3\n", ["line 1", "header"]),
        (POINTS + "a,1,2,3\nb,1,5,2,3\n", ["line 3", "5 cells", "comma as decimal sign", "column z_mm"]),
        (POINTS + 'a,"1,5",2,3\n', ["line 2", "column x_mm", "'1,5'", "the decimal sign is a point"]),
        (POINTS + "a,1,2\n", ["line 2", "3 cells", "column z_mm"]),
        (POINTS + "a,1,NaN,3\n", ["line 2", "column y_mm", "'NaN'"]),
        (POINTS + "a,1,2,inf\n", ["line 2", "column z_mm", "'inf'"]),
        (POINTS + "a,1,2,1e300\n", ["line 2", "column z_mm", "1e300"]),
        (POINTS + "a,1,,3\n", ["line 2", "column y_mm"]),
        (POINTS + "a,1,2,3\n\n,1,2,3\n", ["line 4", "column id"]),
        (POINTS + "a,1,2,3\nb,1,2,3\na,1,2,3\n", ["line 4", "column id", "'a' again", "line 2"]),
        (b"\xff\xfe\x00\x01", ["UTF-8"]),
        (POINTS + 'a,"1,2,3\n', ["line 2"]),
    ],
)
def test_what_is_wrong_is_named(written, content, words):
    path = written(content)
    with pytest.raises(BadInput) as error:
        read_points(path, once=True)
    for word in [str(path), *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("content", "euler", "words"),
    [
        (EULER + "a,1,2,3,4,5,6\n", None, ["--euler XYZ"]),
        (EULER + "a,1,2,3,4,5,6\n", "XyZ", ["--euler", "'XyZ'"]),
        (EULER + "a,1,2,3,4,5,6\n", "XXY", ["--euler", "'XXY'"]),
        (QUATERNION + "a,1,2,3,1,0,0,0\n", "XYZ", ["--euler", "qw"]),
        (QUATERNION + "a,1,2,3,1,0,0,0\nb,1,2,3,1,1,0,0\n", None, ["line 3", "qw,qx,qy,qz", "length 1.414"]),
        (QUATERNION + "a,1,2,3,0,0,0,0\n", None, ["line 2", "length 0"]),
        (POINTS + "a,1,2,3\n", "XYZ", ["line 1", "rx_deg", "qw"]),
    ],
)
def test_what_is_wrong_with_poses_is_named(written, content, euler, words):
    path = written(content)
    with pytest.raises(BadInput) as error:
        read_poses(path, euler)
    for word in words:
        assert word in str(error.value)


def test_ids_must_match_between_the_files(written):
    poses_file, points_file = written(EULER + "a,1,2,3,4,5,6\nb,1,2,3,4,5,6\n", "poses.csv"), "points.csv"
    poses = read_poses(poses_file, "XYZ")
    extra = read_points(written(POINTS + "a,1,2,3\nb,1,2,3\nc,1,2,3\n", points_file), once=True)
    with pytest.raises(BadInput, match=r"points.csv, line 4, column id: found 'c'"):
        match_ids(poses_file, poses, points_file, extra)
    short = read_points(written(POINTS + "a,1,2,3\n", points_file), once=True)
    with pytest.raises(BadInput, match=r"points.csv: found no row of id 'b'"):
        match_ids(poses_file, poses, points_file, short)


def test_files_that_are_not_there_are_named(tmp_path):
    with pytest.raises(BadInput, match="no such file"):
        read_points(tmp_path / "none.csv", once=True)
    with pytest.raises(BadInput, match="a folder"):
        read_points(tmp_path, once=True)

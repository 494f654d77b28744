"""P1's Tables II and III as a user would hand them in: two files, and nothing said about what is wrong in them."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.scenarios.command_line import main
from weldcell.scenarios.user_data import read_points, read_poses

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "paper_one"
R_PRINTED = np.array([[0.0022, 0, -1], [-0.0004, -1, 0], [1, 0.0004, -0.0022]])


@pytest.fixture(scope="module")
def answer(tmp_path_factory):
    def calibrate(euler="XYZ"):
        place = tmp_path_factory.mktemp("paper_one")
        files = ["--poses", str(EXAMPLE / "poses.csv"), "--points", str(EXAMPLE / "points.csv")]
        code = main(["calibrate", "hand-eye", "--target", "point", *files, "--euler", euler, "--out", str(place)])
        return code, json.loads((place / "result.json").read_text())

    return calibrate


@pytest.fixture(scope="module")
def printed_angles(answer):
    return answer("XYZ")


def test_pose_3_alone_is_named(printed_angles):
    code, result = printed_angles
    assert code == 0 and result["verdict"] == "doubtful"
    assert result["outliers"] == ["3"]
    assert result["residuals"]["3"]["length_mm"] > 15


def test_pose_3_cannot_be_right_whatever_the_camera():
    """A rigid mounting keeps lengths: pose 3's distances in the camera are 11 to 18 mm off the flange's."""
    moved = read_poses(EXAMPLE / "poses.csv", "XYZ").T_base_flange.translation[:5] * 1e3
    seen = read_points(EXAMPLE / "points.csv", once=True).points_sensor[:5] * 1e3
    lengths = [np.linalg.norm(one[:, None] - one, axis=-1) for one in (moved, seen)]
    off = np.abs(lengths[1] - lengths[0])
    assert np.all(off[2, [0, 1, 3, 4]] > 11)
    assert off[np.ix_([0, 1, 3, 4], [0, 1, 3, 4])].max() < 2  # mm; what the other four disagree by


def test_the_last_five_poses_agree_on_the_target(printed_angles):
    _, result = printed_angles
    assert max(result["residuals"][str(pose)]["length_mm"] for pose in range(6, 11)) <= 0.6


def test_the_pose_groups_are_said_to_disagree_about_the_target(printed_angles):
    _, result = printed_angles
    first, last = result["targets"]
    assert first["ids"] == ["1", "2", "4", "5"] and last["ids"] == ["6", "7", "8", "9", "10"]
    apart = np.subtract(last["place_base_mm"], first["place_base_mm"])
    assert np.linalg.norm(apart) == pytest.approx(25.1, abs=0.1)
    assert any("disagree about its place by 25.1 mm" in reason for reason in result["reasons"])


def test_the_spread_is_stated(printed_angles):
    """Four translations 40 mm apart, 1 mm wrong, tell the rotation to about 2 degrees, and the result says so."""
    _, result = printed_angles
    sigmas = np.sqrt(np.diag(result["covariance"]))
    assert np.all((sigmas[:3] > 1) & (sigmas[:3] < 3))  # deg
    assert np.all((sigmas[3:] > 0.5) & (sigmas[3:] < 4))  # mm


def test_the_printed_rotation_is_a_reflection_and_does_not_satisfy_the_tables():
    assert np.linalg.det(R_PRINTED) == pytest.approx(-1, abs=1e-4)  # four printed digits
    poses = read_poses(EXAMPLE / "poses.csv", "XYZ").T_base_flange
    seen = read_points(EXAMPLE / "points.csv", once=True).points_sensor
    four = [0, 1, 3, 4]
    moves_flange = -(poses.translation[four] - poses.translation[0]) @ poses.rotation[0].as_matrix()
    missed = np.linalg.norm((seen[four] - seen[0]) @ R_PRINTED.T - moves_flange, axis=1)
    assert missed.max() > 0.010  # m; the true rotation misses by 2 mm or less
    with pytest.raises(ValueError, match="determinant"):
        Rotation.from_matrix(R_PRINTED)


def test_the_printed_translation_does_not_satisfy_the_tables():
    poses = read_poses(EXAMPLE / "poses.csv", "XYZ").T_base_flange[6:]
    seen = read_points(EXAMPLE / "points.csv", once=True).points_sensor[6:]
    places = poses.apply(seen @ R_PRINTED.T + np.array([49.8773, -46.9190, -16.1010]) * 1e-3)
    assert np.linalg.norm(places - places.mean(axis=0), axis=1).max() > 0.010  # m


@pytest.mark.parametrize("euler", ["xyz", "ZYX", "zyx", "ZYZ"])
def test_another_euler_convention_is_pointed_out(answer, euler):
    _, result = answer(euler)
    assert result["verdict"] != "accepted"
    assert any("XYZ would leave 0.694 mm" in reason for reason in result["reasons"])

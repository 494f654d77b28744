"""The station: pictures by seed, torch errors by hand, what the pipelines are given."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import CalibrationConfig, CellConfig, RecordingConfig, SensorConfig
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.sphere_sights import CALIBRATING, WORKING, plan_free, plan_translations
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at, torch_rotation


def station(robot="perfect", seed=2, **sensor) -> Station:
    config = CellConfig(robot=robot, recording=RecordingConfig(enabled=False), sensor=SensorConfig(**sensor))
    return Station(config, seed, Recording(Path("unused.rrd"), config.recording, title=""), Progress())


@pytest.fixture(scope="module")
def perfect():
    with station() as opened:
        yield opened


@pytest.fixture(scope="module")
def paper():
    with station("paper") as opened:
        yield opened


def look_at_sphere(opened: Station) -> None:
    opened.place_sphere(opened.sphere_known_base, stage="test")
    opened.go(plan_translations(opened, opened.sphere_known_base, 4)[0])


def test_the_same_seed_gives_the_same_picture_to_the_byte(perfect):
    look_at_sphere(perfect)
    first = perfect.see("test", 0).shot.image
    other = perfect.see("test", 1).shot.image
    again = perfect.see("test", 0).shot.image
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_another_station_of_the_same_seed_gives_the_same_picture(perfect):
    look_at_sphere(perfect)
    first = perfect.see("test", 0).shot.image
    with station() as second:
        look_at_sphere(second)
        assert np.array_equal(first, second.see("test", 0).shot.image)


def test_the_torch_of_a_perfect_robot_hits_the_point_it_is_sent_to(perfect):
    point_base = perfect.sphere_known_base + [0.02, 0.03, 0.04]
    rotation = perfect.rotation_base_flange(perfect.heading_rad, 0.1, 0.3)
    tip_base = perfect.send_torch(point_base, rotation, perfect.cell.tip_flange, np.random.default_rng(0))
    assert np.linalg.norm(tip_base - point_base) < 1e-9  # m: inverse kinematics


def test_a_wrong_tip_makes_the_torch_miss_by_as_much(perfect):
    off_flange = np.array([1e-3, -2e-3, 3e-3])
    point_base = perfect.sphere_known_base
    rotation = perfect.rotation_base_flange(perfect.heading_rad)
    believed = perfect.cell.tip_flange + off_flange
    tip_base = perfect.send_torch(point_base, rotation, believed, np.random.default_rng(0))
    assert np.allclose(tip_base - point_base, -rotation.apply(off_flange), atol=1e-9)


def test_the_pipelines_are_given_the_sensor_as_it_was_calibrated_not_as_it_is(perfect, paper):
    actual_px = 12e-3 / 3.45e-6
    assert perfect.belief.camera.focal_px == pytest.approx([actual_px, actual_px])
    assert abs(paper.belief.camera.focal_px[0] / actual_px - 1) > 1e-6
    assert paper.belief.plane.offset_m != perfect.belief.plane.offset_m


def test_reported_poses_are_the_nominal_robots(paper):
    paper.go(paper.planner.home_rad + 0.05)
    reported = paper.controller.forward(paper.joints_rad)
    paper.planner.known_cell.take(paper.joints_rad)
    known = paper.planner.known_cell.T_base("flange")
    assert np.allclose(reported.as_matrix(), known.as_matrix(), atol=1e-12)
    assert np.linalg.norm(reported.translation - paper.cell.T_base("flange").translation) > 1e-4


def test_translations_keep_the_orientation_and_vary_all_axes(perfect):
    perfect.place_sphere(perfect.sphere_known_base, stage="test")
    poses = perfect.controller.forward(np.array(plan_translations(perfect, perfect.sphere_known_base, 10)))
    turned = (poses[0].rotation.inv() * poses.rotation).magnitude()
    assert turned.max() < 1e-9  # rad
    assert np.linalg.svd(poses.translation - poses.translation.mean(axis=0))[1][2] > 2e-3  # m: y may vary by 6 mm only


def test_free_poses_move_all_six_joints(perfect):
    perfect.place_sphere(perfect.sphere_known_base, stage="test")
    joints_rad = np.array(plan_free(perfect, perfect.sphere_known_base, 10, WORKING, "test"))
    assert np.all(np.ptp(joints_rad, axis=0) > np.radians(5))
    assert all(perfect.planner.free(q) for q in joints_rad)


def test_a_flange_pose_brings_its_point_to_the_place():
    rotation = Rotation.from_rotvec([0.1, -0.2, 0.3])
    point_flange, point_base = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    assert np.allclose(flange_at(point_base, rotation, point_flange).apply(point_flange), point_base, atol=1e-15)


def test_the_torch_points_down_and_travels_along_its_heading():
    matrix = torch_rotation(np.radians(90)).as_matrix()
    assert np.allclose(matrix[:, 2], [0, 0, -1], atol=1e-15)
    assert np.allclose(matrix[:, 0], [0, 1, 0], atol=1e-15)
    leaning = torch_rotation(0.5, np.radians(20), 1.0).as_matrix()
    assert leaning[:, 2] @ [0, 0, -1] == pytest.approx(np.cos(np.radians(20)))


def test_fewer_views_are_planned_where_the_wanted_accuracy_takes_fewer(tmp_path):
    counts = []
    for wanted_mm in (0.0, 2.0, 0.6):
        config = CellConfig(calibration=CalibrationConfig(wanted_shift_mm=wanted_mm))
        with (
            Recording(tmp_path / f"{wanted_mm}.rrd", config.recording, title="plan") as recording,
            Station(config, 4, recording, Progress()) as station,
        ):
            counts.append(len(plan_free(station, station.sphere_known_base, 12, CALIBRATING, "free poses")))
    assert counts[0] == 12 and 3 <= counts[1] < counts[2] <= 12

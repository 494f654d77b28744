"""The torch's way: refused beforehand with what is in the way, and stopped safely where only the weld shows it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import CellConfig, RecordingConfig, SeamConfig, SensorConfig, WeldConfig
from weldcell.cell.errors import OutOfReach
from weldcell.cell.seam import Seam
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.station import Station
from weldcell.scenarios.welding.guide import AsTaught
from weldcell.scenarios.welding.moving_part import MovingPart
from weldcell.scenarios.welding.torch_path import TorchPath, taught_along, way_along
from weldcell.scenarios.welding.weld_pass import WeldPass
from weldcell.tracking.taught_path import TaughtPath

V = {"path": "straight", "length_mm": 200.0, "thickness_mm": 12.0, "groove_angle_deg": 60.0, "root_face_mm": 2.0}


def opened(seam: SeamConfig, **settings) -> tuple[Station, TorchPath, TaughtPath]:
    config = CellConfig(
        robot="perfect",
        seam=seam,
        weld=WeldConfig(arc=False, speed_mm_s=50.0, command_hz=50.0, **settings),
        sensor=SensorConfig(profile_only=True),
        recording=RecordingConfig(enabled=False),
    )
    station = Station(config, 1, Recording(Path("unused.rrd"), config.recording, title=""), Progress())
    taught = taught_along(station.parts.plate.middle_seam(), station.told_plate())
    station.place_plate(RigidTransform.identity())
    alignment = Alignment(T_flange_camera=station.cell.T_flange_camera, tip_flange=station.cell.tip_flange)
    return station, TorchPath.along(taught, config.weld, station, alignment), alignment


def test_the_wire_points_against_the_approach_and_the_light_lies_on_the_path():
    station, path, _ = opened(SeamConfig(**(V | {"path": "s", "length_mm": 300.0})))
    with station:
        at_m = np.linspace(0, path.taught.end_m - path.look_ahead_m, 9)
        here, ahead = path.taught.places(at_m), path.taught.places(at_m + path.look_ahead_m)
        torches = path.rotations(at_m).as_matrix()
    np.testing.assert_allclose(torches[:, :, 2], -here.ups, atol=1e-12)
    chords = (ahead.points - here.points) / np.linalg.norm(ahead.points - here.points, axis=1, keepdims=True)
    np.testing.assert_allclose(torches[:, :, 0], chords, atol=1e-9)


@pytest.mark.parametrize(("work_deg", "travel_deg"), [(15.0, 0.0), (0.0, 10.0), (0.0, -10.0)])
def test_work_angle_leans_to_the_right_and_travel_angle_forwards(work_deg, travel_deg):
    station, path, _ = opened(SeamConfig(**V), work_angle_deg=work_deg, travel_angle_deg=travel_deg)
    with station:
        place = path.taught.places(np.array([0.1]))
        back_along_wire = -path.rotations(np.array([0.1])).as_matrix()[0, :, 2]
    right, forward = -place.lefts[0], place.steps[0] / np.linalg.norm(place.steps[0])
    assert np.degrees(np.arcsin(back_along_wire @ right)) == pytest.approx(work_deg, abs=1e-6)
    assert np.degrees(np.arcsin(back_along_wire @ forward)) == pytest.approx(travel_deg, abs=1e-6)


@pytest.mark.parametrize(
    ("seam", "reason"),
    [
        (SeamConfig(**V, position_mm=(1700.0, 0.0, 300.0), yaw_deg=0.0), "reach"),
        (SeamConfig(**(V | {"thickness_mm": 60.0, "groove_angle_deg": 30.0})), "come closer than 1.5 mm"),
    ],
)
def test_what_is_in_the_way_is_said_before_anything_moves(seam, reason):
    station, path, _ = opened(seam)
    with station, pytest.raises(OutOfReach, match=rf"weld: -?\d+ mm along the seam of 200 mm: .*{reason}"):
        way_along(station, path, path.taught.start_m - 0.07)


def test_a_path_that_leaves_the_reach_stops_the_torch_within_10_mm():
    station, path, alignment = opened(SeamConfig(**V, position_mm=(1150.0, 0.0, 300.0), yaw_deg=0.0))
    far_base = path.taught.points_base + np.linspace(0, 1, len(path.taught.points_base))[:, None] * [0.5, 0, 0]
    taught = TaughtPath(
        arc_length_m=np.linspace(0, 0.7, len(far_base)),
        points_base=far_base,
        lefts_base=path.taught.lefts_base,
        ups_base=path.taught.ups_base,
    )
    with station:
        leaving = TorchPath.along(taught, station.config.weld, station, alignment)
        part = MovingPart(
            T_base_told=station.told_plate(),
            misplacement=RigidTransform.identity(),
            drift_base=np.zeros(3),
            weld_s=10.0,
            seam_part=Seam(arc_length_m=taught.arc_length_m, points={"middle": far_base}),
        )
        weld_pass = WeldPass(station, alignment, leaving, part, AsTaught(taught), None)
        first = leaving.flanges(np.array([weld_pass.start_m]), np.zeros(1), np.zeros(1))[0]
        station.joints_rad = station.controller.inverse(first, station.joints_rad)
        trace = weld_pass.run()
    assert trace.stop_kind == "out-of-reach" and "reach" in trace.stop_reason
    assert 0.05 < trace.trouble_at_m < 0.69
    tips = trace.tips()
    moved_m = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    after = np.array(trace.arc_length_m) > trace.trouble_at_m
    assert moved_m[after[1:]].sum() < 0.010 and moved_m[-1] < 1e-4

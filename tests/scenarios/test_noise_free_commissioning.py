"""Without noise and robot errors the whole chain, pictures included, gives the truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from weldcell.cell.configuration import SENSOR_PRESETS, CalibrationConfig, CellConfig, RecordingConfig
from weldcell.cell.frames import difference
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.sensor_setup import set_up_sensor
from weldcell.scenarios.station import Station


@pytest.mark.parametrize(("preset", "seed"), [("p2", 1), ("p1", 3), ("profiler", 2)])
def test_hand_eye_sphere_and_tip_come_out_through_the_pictures(preset, seed):
    config = CellConfig(
        robot="perfect",
        sensor=replace(SENSOR_PRESETS[preset], noise=False),
        calibration=CalibrationConfig(robot_sigma_mm=1e-5),
        recording=RecordingConfig(enabled=False),
    )
    with Station(config, seed, Recording(Path("unused.rrd"), config.recording, title=""), Progress()) as station:
        setup = set_up_sensor(station)
        angle_rad, distance_m = difference(setup.after.T_flange_camera, station.cell.T_flange_camera)
        sphere_base = station.cell.T_base_part("sphere").translation
        tip_flange = station.cell.tip_flange
    # What is left is 8-bit rounding: 0.005 px a column, 20 views of 450 columns; 1e-4 deg is the median.
    assert np.degrees(angle_rad) < 2e-4
    assert distance_m < 1e-6
    # Touches see no picture: their contact is resolved to 1 nm.
    assert np.linalg.norm(setup.touched.centre_base - sphere_base) < 1e-8
    assert np.linalg.norm(setup.touched.tip_flange - tip_flange) < 1e-8
    # The joint estimate weighs the pictures' rounding against an arm that might be off by a thousandth of the usual.
    assert np.linalg.norm(setup.after.tip_flange - tip_flange) < 5e-7

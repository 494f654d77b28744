"""The other sensors in the whole cell: the head follows the configuration, and the jobs pass their own limits."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from weldcell.cell.configuration import SENSOR_PRESETS, CellConfig, RecordingConfig, SeamConfig
from weldcell.cell.world.cell import CLEARANCE_M
from weldcell.models.mesh_body import GROUP_ARM, GROUP_PARTS
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.command_line import main
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.seam_tracking import taught_path
from weldcell.scenarios.sphere_sights import CALIBRATING, plan_free, plan_translations
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at

PRESETS = list(SENSOR_PRESETS)


def station(preset: str, **settings) -> Station:
    config = CellConfig(
        robot="perfect", sensor=SENSOR_PRESETS[preset], recording=RecordingConfig(enabled=False), **settings
    )
    return Station(config, 4, Recording(Path("unused.rrd"), config.recording, title=""), Progress())


def gap_to_parts_m(opened: Station) -> float:
    """Least distance of torch and head, wire and tip aside, to the plate where it actually lies."""
    model, data = opened.cell.model, opened.cell.data
    mujoco.mj_kinematics(model, data)
    plate = [g for g in range(model.ngeom) if model.body(model.geom_bodyid[g]).name == "v_groove_plate"]
    tools = [g for g in range(model.ngeom) if model.geom_group[g] > GROUP_ARM and model.geom_contype[g]]
    assert plate and len(tools) > 10 and all(model.geom_group[g] == GROUP_PARTS for g in plate)
    return min(mujoco.mj_geomDistance(model, data, tool, part, 0.5, None) for tool in tools for part in plate)


@pytest.mark.parametrize("preset", PRESETS)
def test_head_and_torch_stay_clear_of_the_plate_along_the_seam(preset):
    with station(preset, seam=SeamConfig(frames=8)) as opened:
        opened.place_plate()
        path = taught_path(opened)
        gaps_m = []
        for crossing_base, torch in zip(path.points_base, path.torch_rotations, strict=True):
            rotation = torch * T_FLANGE_TORCH.rotation.inv()
            T_base_flange = flange_at(crossing_base, rotation, opened.head.crossing_flange)
            opened.cell.take(opened.controller.inverse(T_base_flange, opened.joints_rad))
            gaps_m.append(gap_to_parts_m(opened))
    assert min(gaps_m) > CLEARANCE_M


@pytest.mark.parametrize("preset", PRESETS)
def test_planned_sights_show_the_whole_arc_of_the_sphere(preset):
    """In the picture and in the fan, the mount being as drawn: from the circle's top to where its flank dips 60 deg."""
    with station(preset) as opened:
        known_base = opened.sphere_known_base
        opened.place_sphere(known_base, stage="test")
        postures = plan_translations(opened, known_base, 6) + plan_free(opened, known_base, 6, CALIBRATING, "test")
        for joints_rad in postures:
            T_base_camera = opened.controller.forward(joints_rad) * opened.head.T_flange_camera
            centre_camera = T_base_camera.inv().apply(known_base)
            arc_camera = arc(opened.belief.plane, centre_camera, opened.parts.sphere_radius_m)
            assert opened.belief.camera.in_picture(opened.belief.camera.project(arc_camera)).all()
            from_axis = (arc_camera - opened.head.source_camera) / opened.head.laser_range_m
            light = np.array([0, 0, opened.head.stand_off_m]) - opened.head.source_camera
            cosines = from_axis @ light / np.linalg.norm(from_axis, axis=1) / np.linalg.norm(light)
            assert np.all(cosines > np.cos(np.radians(opened.config.sensor.laser_fan_deg / 2)))


def arc(plane, centre_camera, radius_m):
    """Points of the sphere's section by the light plane that the light meets at up to 60 deg."""
    off_plane_m = plane.distance_m(centre_camera)
    assert 0.2 * radius_m < off_plane_m < 0.8 * radius_m  # beyond the plane: the side that the fit is told
    foot = centre_camera - off_plane_m * plane.normal_camera
    across, _, light = plane.T_camera_laser.rotation.as_matrix().T
    turn = np.radians(np.linspace(-60, 60, 13))[:, None]
    return foot + np.sqrt(radius_m**2 - off_plane_m**2) * (np.sin(turn) * across - np.cos(turn) * light)


@pytest.mark.parametrize("preset", ["p1", "profiler"])
@pytest.mark.parametrize(
    ("scenario", "options"),
    [
        ("v-seam", "--seam.frames 24"),
        (
            "hand-eye-sphere",
            "--calibration.free-poses 6 --calibration.viewpoints 1 --calibration.far-points-mm 0 320 60",
        ),
    ],
)
def test_a_short_run_passes_its_own_limits(preset, scenario, options, tmp_path):
    """The limits are P2's published results; a wrong side, roll or axis costs millimetres."""
    common = ["--seed", "4", "--sensor.preset", preset, "--calibration.touches", "24", "--no-recording.enabled"]
    assert main(["run", scenario, *common, *options.split(), "--out", str(tmp_path / "run")]) == 0
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())["metrics"]
    assert metrics["sphere_centre_spread_mm"] < 0.5
    if scenario == "v-seam":
        assert metrics["frames_valid_count"] == metrics["frames_count"] == 24
        assert max(metrics[f"seam_{name}_max_error_mm"] for name in ("left", "root", "right")) < 0.6

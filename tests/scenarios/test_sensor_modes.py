"""Whole runs with the sensor's other ways to measure: no pictures, 12 bits with motion blur."""

import json

import pytest
from rerun.chunk import RrdReader

from weldcell.scenarios.command_line import main

SHORT = (
    "run v-seam --seed 4 --seam.frames 16 --calibration.touches 24 --calibration.free-poses 6 "
    "--calibration.viewpoints 1 --calibration.far-points-mm 0 320 60"
)


def metrics_of(place, *options):
    assert main([*SHORT.split(), *options, "--out", str(place)]) == 0  # within its own limits, P2's results
    return json.loads((place / "metrics.json").read_text())["metrics"]


def is_good(metrics):
    """Far above the sensor's scatter, far below a wrong sign or axis (mm)."""
    every_frame = metrics["frames_valid_count"] == metrics["frames_count"] == 16
    return every_frame and metrics["sphere_centre_spread_mm"] < 0.1 and metrics["seam_root_max_error_mm"] < 0.6


@pytest.fixture(scope="module")
def without_pictures(tmp_path_factory):
    place = tmp_path_factory.mktemp("runs") / "profiles"
    return place, metrics_of(place, "--sensor.profile-only")


def test_a_run_without_pictures_tracks_its_seam_and_records_profiles_only(without_pictures):
    place, metrics = without_pictures
    assert is_good(metrics)
    columns = [
        (chunk.entity_path, name)
        for chunk in RrdReader(place / "recording.rrd").stream()
        for name in chunk.to_record_batch().schema.names
    ]
    assert any(entity == "/profile/points" and name.startswith("Points2D") for entity, name in columns)
    assert not any(name.startswith("EncodedImage") for _, name in columns)


def test_a_run_without_pictures_repeats_itself(without_pictures, tmp_path):
    again = metrics_of(tmp_path / "again", "--sensor.profile-only", "--no-recording.enabled")
    assert again == without_pictures[1]


def test_a_run_with_12_bits_and_motion_blur_tracks_its_seam(tmp_path):
    options = ("--sensor.bits", "12", "--sensor.motion-blur", "--no-recording.enabled")
    assert is_good(metrics_of(tmp_path / "run", *options))

"""The U seam on a free-form surface, by the joint's finder and by P1's morphology: few pictures, exact calibration."""

import json
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from weldcell.cell.errors import BadInput
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.command_line import main
from weldcell.scenarios.morphology_track import MorphologyWatch, morphology_metrics, track_both
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.seam_tracking import seam_metrics
from weldcell.scenarios.settings import resolve
from weldcell.scenarios.station import Station

FRAMES = 20
STEPS = ("median", "bright", "pieces", "dilated", "eroded", "difference", "seam")
CONTRACT = {
    "frames_count",
    "frames_valid_count",
    "frames_morphological_valid_count",
    *(f"seam_{name}_{what}_error_mm" for name in ("left", "centre", "right") for what in ("mean", "max")),
    *(f"seam_centre_morphological_{what}_error_mm" for what in ("mean", "max", "lateral_mean", "lateral_max")),
}


def opened(seed: int, **options) -> Station:
    """The cell with a robot without errors, and half the part."""
    short = {"length_mm": 150.0, "surface_wave_mm": 5.0, "amplitude_mm": 4.0, "frames": FRAMES}
    given = {"robot": "perfect", "recording.enabled": False} | {f"seam.{name}": value for name, value in short.items()}
    given |= {name.replace("__", "."): value for name, value in options.items()}
    config = resolve("u-seam", options=given).config
    return Station(config, seed, Recording(Path("unused.rrd"), config.recording, title=""), Progress())


@pytest.mark.parametrize(("seed", "preset", "material"), [(2, "p1", "ground-steel"), (3, "p2", "mill-scale")])
def test_both_methods_follow_the_seam(seed, preset, material):
    with opened(seed, sensor__preset=preset, seam__material=material) as station:
        exact = Alignment(T_flange_camera=station.cell.T_flange_camera, tip_flange=station.cell.tip_flange)
        seam, watch = track_both(station, exact)
        metrics = seam_metrics(station, seam, exact) | morphology_metrics(station, seam, exact, watch)
        lost = MorphologyWatch(points_px=[np.full(2, np.nan)] * FRAMES)
        without = morphology_metrics(station, seam, exact, lost)
    assert min(metrics["frames_valid_count"], metrics["frames_morphological_valid_count"]) >= FRAMES - 1
    # mm: a few times what 300 pictures reach, in which the scatter of one averages out
    assert max(metrics[f"seam_{name}_mean_error_mm"] for name in ("left", "centre", "right")) < 0.12
    # mm: the bridge lies up to 2 px of 0.08 mm to the side that the surface bends to, and half a pixel across the seam
    assert metrics["seam_centre_morphological_mean_error_mm"] < 0.25
    assert metrics["seam_centre_morphological_lateral_mean_error_mm"] < 0.08
    # Where morphology sees nothing, nothing is invented.
    assert without.pop("frames_morphological_valid_count") == 0
    assert len(without) == 6 and np.isnan(list(without.values())).all()


def test_what_morphology_cannot_work_on_is_refused():
    with opened(1, sensor__profile_only=True) as station, pytest.raises(BadInput, match="profile_only"):
        track_both(station, Alignment(T_flange_camera=station.head.T_flange_camera, tip_flange=np.zeros(3)))
    with opened(1, seam__joint="fillet", seam__path="s") as station, pytest.raises(BadInput, match="found fillet"):
        track_both(station, Alignment(T_flange_camera=station.head.T_flange_camera, tip_flange=np.zeros(3)))


def test_a_short_run_passes_its_limits_and_records_the_steps(tmp_path):
    folder = tmp_path / "run"
    options = ["--seam.frames", "26", "--calibration.touches", "24"]
    assert main(["run", "u-seam", "--seed", "4", "--out", str(folder), *options]) == 0
    metrics = json.loads((folder / "metrics.json").read_text())["metrics"]
    assert set(metrics) >= CONTRACT
    assert metrics["frames_count"] == metrics["frames_valid_count"] == 26
    frames = {}
    for chunk in RrdReader(folder / "recording.rrd").stream():
        if chunk.entity_path.startswith("/steps/"):
            name = chunk.entity_path.removeprefix("/steps/")
            frames.setdefault(name, []).extend(chunk.to_record_batch().column("frame").to_pylist())
    assert set(frames) == {*STEPS, *(f"{name}/point" for name in STEPS)}
    assert all(np.diff(numbers).tolist() == [25] for numbers in frames.values())  # the first and the last of 26

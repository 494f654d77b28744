"""What the scenarios reach: medians over seeds that nothing was tuned on."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

SEEDS = (101, 102, 103, 104, 105)

POINTS = [f"point_{k}_error_{when}_mm" for when in ("before", "after") for k in (1, 2, 3)]
FAR = ["far_error_before_mm", "far_error_after_mm"]
SEAM = [f"seam_{name}_{what}_error_mm" for name in ("left", "root", "right") for what in ("mean", "max")]
CASES = {
    "perfect robot": ("hand-eye-sphere", ["--robot", "perfect"], [*POINTS, *FAR]),
    "typical robot": ("hand-eye-sphere", ["--robot", "typical"], [*POINTS, *FAR]),
    "typical robot, P2 to the letter": (
        "hand-eye-sphere",
        ["--robot", "typical", "--no-calibration.estimate-tip"],
        [*POINTS, *FAR],
    ),
    "bad robot": ("hand-eye-sphere", ["--robot", "bad"], [*POINTS, *FAR]),
    "paper robot": ("hand-eye-sphere", ["--robot", "paper"], [*POINTS, *FAR]),
    "paper robot, P2 to the letter": (
        "hand-eye-sphere",
        ["--robot", "paper", "--no-calibration.estimate-tip"],
        [*POINTS, *FAR],
    ),
    "no noise, perfect robot": (
        "hand-eye-sphere",
        ["--robot", "perfect", "--no-sensor.noise", "--calibration.robot-sigma-mm", "1e-5"],
        ["hand_eye_rotation_error_deg", "hand_eye_translation_error_mm"],
    ),
    "V-groove, typical robot": ("v-seam", ["--robot", "typical"], ["frames_count", "frames_valid_count", *SEAM]),
    "boss, typical robot": ("boss", ["--robot", "typical"], ["boss_edge_mean_error_mm", "boss_angle_mean_error_deg"]),
}


def medians(case: str) -> dict[str, float]:
    """Median of each metric of a case over the seeds."""
    scenario, options, names = CASES[case]
    rows = [_metrics(scenario, options, seed) for seed in SEEDS]
    return {name: float(np.median([row[name] for row in rows])) for name in names}


def _metrics(scenario: str, options: list[str], seed: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "run"
        command = [sys.executable, "-m", "weldcell", "run", scenario, "--seed", str(seed), "--out", str(place)]
        # Exit code 1 is a run that missed its limits: its figures count as well.
        done = subprocess.run([*command, "--no-recording.enabled", *options], capture_output=True, text=True)
        if done.returncode not in (0, 1):
            raise RuntimeError(done.stderr)
        return json.loads((place / "metrics.json").read_text())["metrics"]

"""What the scenarios reach: medians over seeds that nothing was tuned on."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.table import Figure

SEEDS = (101, 102, 103, 104, 105)
FEWER_SEEDS = SEEDS[:3]
AT_ONCE = 2
"""Runs at a time: each keeps one core busy."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Threads that wait for each other would only take the other run's time."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A scenario with options, and what is taken from it."""

    scenario: str
    options: tuple[str, ...]
    metrics: tuple[str, ...]
    seeds: tuple[int, ...] = SEEDS


def _points(*stages: str) -> tuple[str, ...]:
    """Torch errors near the sphere and far from it, before compensation, by P2's way and by the joint estimate."""
    near = [f"point_{k}_error_{stage}_mm" for stage in stages for k in (1, 2, 3)]
    return (*near, *(f"far_error_{stage}_mm" for stage in stages))


ALL, LETTER = _points("before", "p2", "after"), _points("before", "after")
SEAM = tuple(f"seam_{name}_{what}_error_mm" for name in ("left", "root", "right") for what in ("mean", "max"))
FRAMES = ("frames_count", "frames_valid_count")
TO_THE_LETTER = ("--method", "p2", "--no-calibration.estimate-tip")

CASES = {
    **{
        f"{robot} robot": Case(scenario="hand-eye-sphere", options=("--robot", robot), metrics=ALL)
        for robot in ("perfect", "typical", "bad", "paper")
    },
    **{
        f"{robot} robot, P2 to the letter": Case(
            scenario="hand-eye-sphere",
            options=("--robot", robot, *TO_THE_LETTER),
            metrics=LETTER,
            seeds=FEWER_SEEDS,
        )
        for robot in ("typical", "paper")
    },
    "no noise, perfect robot": Case(
        scenario="hand-eye-sphere",
        options=("--robot", "perfect", "--no-sensor.noise", "--calibration.robot-sigma-mm", "1e-5"),
        metrics=("hand_eye_rotation_error_deg", "hand_eye_translation_error_mm"),
        seeds=FEWER_SEEDS,
    ),
    "V-groove, typical robot": Case(scenario="v-seam", options=("--robot", "typical"), metrics=(*FRAMES, *SEAM)),
    **{
        f"V-groove, typical robot, sensor {preset}": Case(
            scenario="v-seam",
            options=("--robot", "typical", "--sensor.preset", preset, "--seam.frames", "150"),
            metrics=(*FRAMES, *SEAM),
            seeds=FEWER_SEEDS,
        )
        for preset in ("p1", "profiler")
    },
    "boss, typical robot": Case(
        scenario="boss",
        options=("--robot", "typical"),
        metrics=("boss_edge_mean_error_mm", "boss_angle_mean_error_deg"),
    ),
}


def tables(cases: dict[str, Case] = CASES) -> dict[str, list[Figure]]:
    """Median of each metric of each case over its seeds."""
    with ThreadPoolExecutor(AT_ONCE) as pool:
        rows = {
            name: [pool.submit(_metrics, case.scenario, case.options, seed) for seed in case.seeds]
            for name, case in cases.items()
        }
        return {
            f"{name}: medians over seeds {case.seeds[0]} to {case.seeds[-1]}": list(
                _medians(case, [row.result() for row in rows[name]])
            )
            for name, case in cases.items()
        }


def _medians(case: Case, rows: list[dict[str, float]]) -> Iterator[Figure]:
    for name in case.metrics:
        quantity, _, unit = name.rpartition("_")
        yield Figure(name=quantity, value=float(np.median([row[name] for row in rows])), unit=unit)


def _metrics(scenario: str, options: tuple[str, ...], seed: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "run"
        command = [sys.executable, "-m", "weldcell", "run", scenario, "--seed", str(seed), "--out", str(place)]
        # Exit code 1 is a run that missed its limits: its figures count as well.
        done = subprocess.run(
            [*command, "--no-recording.enabled", *options], capture_output=True, text=True, env=os.environ | ONE_THREAD
        )
        if done.returncode not in (0, 1):
            raise RuntimeError(done.stderr)
        return json.loads((place / "metrics.json").read_text())["metrics"]

"""`weldcell dataset` with one worker and with two: the same files, and how much faster."""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.table import Figure

COUNT = 200


def figures(count: int = COUNT) -> list[Figure]:
    """Times of both, their ratio, and whether all checksums agree; start-up included."""
    with tempfile.TemporaryDirectory() as folder:
        times_s, manifests = zip(
            *(_made(Path(folder) / str(workers), count, workers) for workers in (1, 2)), strict=True
        )
    return [
        Figure(name=f"{count} pictures, one worker", value=times_s[0], unit="s"),
        Figure(name=f"{count} pictures, two workers", value=times_s[1], unit="s"),
        Figure(name="two workers: times as fast as one", value=times_s[0] / times_s[1], at_least=1.6),
        Figure(name="files that differ between them", value=_differing(*manifests), at_most=0),
    ]


def _made(place: Path, count: int, workers: int) -> tuple[float, dict[str, Any]]:
    command = [sys.executable, "-m", "weldcell", "dataset", "--count", str(count), "--out", str(place)]
    begin = time.perf_counter()
    subprocess.run([*command, "--workers", str(workers)], check=True, capture_output=True)
    took_s = time.perf_counter() - begin
    return took_s, json.loads((place / "manifest.json").read_text())["files"]


def _differing(first: dict[str, Any], second: dict[str, Any]) -> int:
    return sum(first.get(name) != second.get(name) for name in first.keys() | second.keys())

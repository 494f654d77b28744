"""metrics.json: what a script reads of a run."""

import json
import math
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from weldcell.scenarios.atomic_file import write_text
from weldcell.scenarios.job import Outcome

# What a run's numbers may depend on.
_PACKAGES = ("weldcell", "mujoco", "numpy", "scipy", "opencv-python-headless", "pyarrow", "rerun-sdk")


def write_metrics(path: Path, *, scenario: str, seed: int, outcome: Outcome) -> None:
    """Writes the file; it appears when it is whole."""
    content = {
        "scenario": scenario,
        "seed": seed,
        "passed": not outcome.reasons,
        "versions": versions(),
        "metrics": {name: _number(value) for name, value in outcome.metrics.items()},
        "limits": {name: float(value) for name, value in outcome.limits.items()},
    }
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def _number(value: Any) -> float | int | None:
    """A plain number, or null for what could not be measured."""
    if value is None or not math.isfinite(value):
        return None
    return int(value) if float(value).is_integer() and not isinstance(value, float) else float(value)


def versions() -> dict[str, str]:
    """The versions that a run's numbers may depend on, by package."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:  # run from a folder without an installation
            continue
    return found

"""`python -m benchmarks [PART ...]`: prints tables and writes benchmarks/results.json; the parts stand below.

Without names all parts run. Results of parts that did not run stay in the file.
"""

import json
import os
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks import (
    accuracy,
    covariance,
    dataset,
    detector_tables,
    hand_eye_methods,
    precision,
    rays,
    seams,
    speed,
    welding,
)
from benchmarks.table import Figure, Grid, as_data, show, show_grid

RESULTS = Path(__file__).with_name("results.json")

Tables = Mapping[str, Sequence[Figure] | Grid]


def main(names: list[str]) -> int:
    """Runs the named parts, or all."""
    unknown = [name for name in names if name not in PARTS]
    if unknown:
        print(f"benchmarks: error: found {', '.join(unknown)}, expected some of {', '.join(PARTS)}", file=sys.stderr)
        return 2
    console = Console()
    for part in names or PARTS:
        tables = PARTS[part]()
        for title, table in tables.items():
            if isinstance(table, Grid):
                show_grid(console, table)
            else:
                show(console, title, table)
        _keep(part, {title: _data(table) for title, table in tables.items()})
    console.print(str(RESULTS), highlight=False)
    return 0


def _speed() -> Tables:
    times_ms = speed.frame_times()
    return {
        "A V-groove frame of 1440 x 1080 pixels": [Figure(name=n, value=v, unit="ms") for n, v in times_ms.items()],
        "Against primitives of the same run": speed.figures(times_ms),
    }


def _job() -> Tables:
    return {"The whole job": [Figure(name="weldcell run commission", value=speed.whole_job_s(), unit="s")]}


PARTS: dict[str, Callable[[], Tables]] = {
    "speed": _speed,
    "rays": lambda: {"Rays on a plate of 240 000 triangles": rays.figures()},
    "detectors": lambda: detector_tables.tables(Console()),
    "precision": lambda: {"Stripe centre against the Cramer-Rao bound": precision.figures()},
    "dataset": lambda: {"Data sets": dataset.figures()},
    "job": _job,
    "accuracy": accuracy.tables,
    "weld": welding.figures,
    "hand-eye": hand_eye_methods.tables,
    "seams": lambda: seams.tables(seams.NOMINAL),
    "seams-arc": lambda: seams.tables(seams.WELDING),
    "covariance": lambda: {"Predicted covariance against 500 trials": covariance.figures()},
}


def _data(table: Sequence[Figure] | Grid) -> dict[str, Any]:
    """A table for the JSON file."""
    return {"columns": table.columns, "rows": table.rows} if isinstance(table, Grid) else as_data(table)


def _keep(part: str, tables: dict[str, Any]) -> None:
    """Writes a part's results beside those of the others."""
    try:
        results = json.loads(RESULTS.read_text())
    except (OSError, ValueError):
        results = {}
    results = {name: value for name, value in results.items() if name in PARTS}
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    results[part] = {"machine": machine, "tables": tables}
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""`python -m benchmarks [speed] [accuracy]`: prints tables and writes benchmarks/results.json."""

import json
import platform
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import accuracy, speed

RESULTS = Path(__file__).with_name("results.json")


def main(parts: list[str]) -> int:
    """Runs the named parts, or all."""
    unknown = set(parts) - {"speed", "accuracy"}
    if unknown:
        print(f"benchmarks: error: found {', '.join(sorted(unknown))}, expected speed or accuracy", file=sys.stderr)
        return 2
    console, results = Console(), {"python": platform.python_version(), "machine": platform.machine()}
    if not parts or "speed" in parts:
        results["frame_ms"] = times_ms = speed.frame_times()
        _show(console, "A V-groove frame of 1440 x 1080 pixels", "ms", times_ms)
        results["ratio"] = speed.ratios(times_ms)
        _show(console, "Against primitives of the same run", "ratio", results["ratio"])
        results["commission_s"] = {"weldcell run commission": speed.whole_job_s()}
        _show(console, "The whole job", "s", results["commission_s"])
    if not parts or "accuracy" in parts:
        results["accuracy"] = {}
        for case in accuracy.CASES:
            results["accuracy"][case] = accuracy.medians(case)
            title = f"{case}: medians over seeds {accuracy.SEEDS[0]} to {accuracy.SEEDS[-1]}"
            _show(console, title, "", results["accuracy"][case])
    RESULTS.write_text(json.dumps(results, indent=2) + "\n")
    console.print(str(RESULTS), highlight=False)
    return 0


def _show(console: Console, title: str, unit: str, values: dict[str, float]) -> None:
    table = Table(title=title, title_justify="left")
    table.add_column("what")
    table.add_column(unit, justify="right")
    for name, value in values.items():
        table.add_row(name, f"{value:.4g}")
    console.print(table)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

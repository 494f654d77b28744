"""What a recipe gets (`Job`) and what it gives back (`Outcome`)."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from weldcell.cell.configuration import CellConfig
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.yaml_file import write_yaml

UNITS = {"_mm": "mm", "_deg": "°", "_px": "px", "_um": "µm", "_s": "s", "_count": "", "_ratio": ""}
"""A metric's name ends in one of these; the unit is as a person reads it."""


@dataclass(frozen=True, kw_only=True)
class Job:
    """One run of a scenario: what to do, and where to leave it."""

    scenario: str
    """The scenario's name, e.g. v-seam."""
    seed: int
    """Where all randomness of the run comes from (`weldcell.cell.randomness.generator(job.seed, stage, frame)`)."""
    config: CellConfig
    """The configuration as resolved."""
    folder: Path
    """Where files are written; it takes the run's place and name when the run is done."""
    progress: Progress = field(default_factory=Progress)
    """Where to say how far the work has come (silent unless a command line listens)."""

    @property
    def recording_path(self) -> Path:
        """Where to write the recording, if the configuration wants one."""
        return self.folder / "recording.rrd"

    def write_calibration(self, name: str, result: Mapping[str, Any]) -> None:
        """Leaves calibration/NAME.yaml: numbers, texts, arrays and nested mappings of them, units in the names."""
        write_yaml(self.folder / "calibration" / f"{name}.yaml", result)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What a run measured, and whether that is good enough."""

    metrics: Mapping[str, float | None]
    """Value by name, in the table's order; a name ends in its unit; None or NaN is what could not be measured."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """The largest acceptable value of some of the metrics."""
    failures: tuple[str, ...] = ()
    """Other reasons why the run is not acceptable, in words, e.g. '250 of 300 frames valid, expected 294'."""

    def __post_init__(self) -> None:
        for name in self.metrics:
            if not name.endswith(tuple(UNITS)):
                raise ValueError(f"metric {name!r} must end in its unit: {', '.join(UNITS)}")
        if unknown := set(self.limits) - set(self.metrics):
            raise ValueError(f"limits without a metric: {', '.join(sorted(unknown))}")

    @property
    def reasons(self) -> tuple[str, ...]:
        """Everything that makes the run fail, in words; empty when it passed."""
        exceeded = (self._verdict(name) for name in self.limits)
        return (*filter(None, exceeded), *self.failures)

    def within_limit(self, name: str) -> bool | None:
        """Whether this metric keeps its limit; None if it has none."""
        return not self._verdict(name) if name in self.limits else None

    def _verdict(self, name: str) -> str:
        value, limit = self.metrics[name], self.limits[name]
        if value is None or value != value:
            return f"{name} could not be measured, limit {limit:.6g}"
        return f"{name} is {value:.6g}, limit {limit:.6g}" if value > limit else ""

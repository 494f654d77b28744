"""Every joint along every path: scanned, fitted and compared with the exact seam, in nominal noise and beside an arc.

A seed's robot and sensor are calibrated once, on P2's cell, and what was found serves all of its parts: the same seed
draws the same robot. Sensor-side errors are those of single frames, the camera's true place being known; torch-side
errors are how far the actual tip misses the exact seam when it is sent along the fitted one. A joint's mean is the mean
over its features, its largest error that of all of them.
"""

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np

from benchmarks.accuracy import AT_ONCE, ONE_THREAD, SEEDS
from benchmarks.table import Figure, Grid
from weldcell.cell.configuration import (
    SEAM_PRESETS,
    SENSOR_PRESETS,
    CellConfig,
    Disturbance,
    JointName,
    PathName,
    RecordingConfig,
)
from weldcell.cell.errors import WeldcellError
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.dataset.worker import start_worker
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.seam_tracking import seam_metrics, track_seam
from weldcell.scenarios.sensor_setup import set_up_sensor
from weldcell.scenarios.station import Station

ASKED: tuple[PathName, ...] = ("straight", "s")
GROOVES: tuple[JointName, ...] = ("v", "bevel", "u", "j")
NO_ERRORS = {"valid_ratio": 0.0}


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What the sensor has to put up with, and what is asked of it."""

    name: str
    frames: int
    """Pictures of each seam."""
    limits: dict[str, float] = field(default_factory=dict, hash=False)
    """Largest errors (mm) that are asked for, by measure."""
    least_valid_ratio: float = 0.0
    disturbances: tuple[Disturbance, ...] = ()
    exposure_ms: float = 1.0
    scan_height_mm: float = 20.0
    """Wire's tip above the joint's highest feature."""


NOMINAL = Condition(
    name="nominal noise", frames=80, limits={"sensor_mean_mm": 0.06, "torch_mean_mm": 0.10}, least_valid_ratio=0.98
)
WELDING = Condition(
    name="arc and spatter",
    frames=60,
    limits={"sensor_mean_mm": 0.16, "sensor_max_mm": 0.5},
    least_valid_ratio=0.95,
    disturbances=(Disturbance(kind="arc"), Disturbance(kind="spatter")),
    exposure_ms=0.3,
    scan_height_mm=6.0,
)
"""With the torch as low as when it welds (an arc high over the part would light it ten times as strongly), and the
exposure short enough that the arc's pulses do not saturate the picture about the stripe."""
MEASURES = ("sensor_mean_mm", "sensor_max_mm", "torch_mean_mm", "torch_max_mm")
_COLUMNS = ("joint", "path", "valid %", "sensor mean mm", "max", "torch mean mm", "max")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One kind of seam under one condition."""

    joint: JointName
    path: PathName
    condition: Condition

    @property
    def is_asked(self) -> bool:
        """Whether limits hold for it: the other paths are there to show that they work."""
        return self.path in ASKED


def cases() -> list[Case]:
    """All joints along the asked paths under both conditions, along the others in nominal noise."""
    both = [
        Case(joint=joint, path=path, condition=condition)
        for condition, joint, path in product((NOMINAL, WELDING), SEAM_PRESETS, ASKED)
    ]
    others: list[tuple[JointName, PathName]] = [(joint, "arc") for joint in SEAM_PRESETS]
    others += [*((joint, "surface") for joint in GROOVES), ("fillet", "saddle")]
    return both + [Case(joint=joint, path=path, condition=NOMINAL) for joint, path in others]


def tables(condition: Condition, seeds: Sequence[int] = SEEDS) -> dict[str, list[Figure] | Grid]:
    """A row for each seam under one condition, and the worst of the asked ones against what is asked."""
    chosen = [case for case in cases() if case.condition is condition]
    os.environ |= ONE_THREAD
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(AT_ONCE, mp_context=spawn, initializer=start_worker) as pool:
        alignments = dict(zip(seeds, pool.map(aligned, seeds), strict=True))
        runs = [(case, seed, alignments[seed]) for case in chosen for seed in seeds]
        results = pool.map(measured, *zip(*runs, strict=True))
        rows = {}
        for case in chosen:
            rows[case] = _medians([next(results) for _ in seeds])
            print(*_cells(case, rows[case]), flush=True)
    title = f"Seams, {condition.name}: medians over seeds {seeds[0]} to {seeds[-1]}"
    return {
        title: Grid(title=title, columns=_COLUMNS, rows=[_cells(*item) for item in rows.items()]),
        f"{condition.name}, worst of all joints": list(_worst(condition, rows)),
    }


def aligned(seed: int) -> Alignment:
    """What calibration finds in the cell of this seed."""
    with _station(CellConfig(recording=RecordingConfig(enabled=False)), seed) as station:
        return set_up_sensor(station).after


def measured(case: Case, seed: int, alignment: Alignment) -> dict[str, float]:
    """Share of valid frames, and errors (mm) of one seam; the share alone, 0, where it was lost or out of reach."""
    condition = case.condition
    config = CellConfig(
        sensor=replace(SENSOR_PRESETS["p2"], exposure_ms=condition.exposure_ms),
        seam=replace(
            SEAM_PRESETS[case.joint],
            path=case.path,
            frames=condition.frames,
            scan_height_mm=condition.scan_height_mm,
        ),
        disturbances=condition.disturbances,
        recording=RecordingConfig(enabled=False),
    )
    with _station(config, seed) as station:
        try:
            tracked = track_seam(station, alignment)
        except WeldcellError as failure:
            print(f"{case.joint}, {case.path}, seed {seed}: {failure}", flush=True)
            return NO_ERRORS
        metrics = seam_metrics(station, tracked, alignment)
    by_measure = {
        "sensor_mean_mm": [v for name, v in metrics.items() if name.endswith("_sensor_mean_error_mm")],
        "sensor_max_mm": [v for name, v in metrics.items() if name.endswith("_sensor_max_error_mm")],
        "torch_mean_mm": [v for name, v in metrics.items() if _is_torch(name, "_mean_error_mm")],
        "torch_max_mm": [v for name, v in metrics.items() if _is_torch(name, "_max_error_mm")],
    }
    summary = {name: float((np.max if "max" in name else np.mean)(values)) for name, values in by_measure.items()}
    return {"valid_ratio": metrics["frames_valid_count"] / metrics["frames_count"], **summary}


def _is_torch(name: str, ending: str) -> bool:
    return name.endswith(ending) and "_sensor_" not in name


def _station(config: CellConfig, seed: int) -> Station:
    return Station(config, seed, Recording(Path("unused.rrd"), config.recording, title=""), Progress())


def _medians(results: Sequence[dict[str, float]]) -> dict[str, float]:
    """Over the seeds; a seam that was lost counts as an error without bounds."""
    row = {"valid_ratio": float(np.median([result["valid_ratio"] for result in results]))}
    return row | {name: float(np.median([result.get(name, np.inf) for result in results])) for name in MEASURES}


def _cells(case: Case, row: dict[str, float]) -> tuple[str, ...]:
    return (case.joint, case.path, f"{100 * row['valid_ratio']:.1f}", *(f"{row[name]:.3f}" for name in MEASURES))


def _worst(condition: Condition, rows: dict[Case, dict[str, float]]) -> Iterator[Figure]:
    asked = {case: row for case, row in rows.items() if case.is_asked}
    case = min(asked, key=lambda case: asked[case]["valid_ratio"])
    yield Figure(
        name=f"valid frames ({case.joint}, {case.path})",
        value=100 * asked[case]["valid_ratio"],
        unit="%",
        at_least=100 * condition.least_valid_ratio,
    )
    for name, limit in condition.limits.items():
        case = max(asked, key=lambda case: asked[case][name])
        quantity = name.removesuffix("_mm").replace("_", "-side ")
        yield Figure(
            name=f"{quantity} error ({case.joint}, {case.path})", value=asked[case][name], unit="mm", at_most=limit
        )

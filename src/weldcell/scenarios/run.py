"""One run of a scenario: its folder, its files, its table."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from weldcell.cell.errors import JobFailed
from weldcell.scenarios.catalogue import Scenario
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.metrics_file import write_metrics
from weldcell.scenarios.progress import Progress, progress_on
from weldcell.scenarios.results_table import results_table
from weldcell.scenarios.run_folder import CONFIG, METRICS, RECORDING, run_folder
from weldcell.scenarios.settings import Settings, resolve
from weldcell.scenarios.yaml_file import write_yaml


def run(
    scenario: Scenario,
    *,
    config_file: Path | None = None,
    seed: object = None,
    given: Mapping[str, Any] | None = None,
    place: Path | None = None,
    overwrite: bool = False,
) -> Outcome:
    """What the scenario measured with these settings, after its files and its table have been written."""
    settings = resolve(scenario.name, file=config_file, seed=seed, options=given)
    place = place or Path("runs") / f"{scenario.name}-{settings.seed}"
    with progress_on(Console(stderr=True)) as progress, run_folder(place, overwrite=overwrite) as folder:
        outcome = _perform(scenario, settings, folder, progress)
    _report(settings, outcome, place)
    return outcome


def _perform(scenario: Scenario, settings: Settings, folder: Path, progress: Progress) -> Outcome:
    write_yaml(folder / CONFIG, settings.as_mapping())
    job = Job(scenario=scenario.name, seed=settings.seed, config=settings.config, folder=folder, progress=progress)
    try:
        outcome = scenario.run(job)
    except JobFailed as failure:  # it ran: what it left shows why it failed
        outcome = Outcome(metrics={}, failures=(str(failure),))
    write_metrics(folder / METRICS, scenario=scenario.name, seed=settings.seed, outcome=outcome)
    return outcome


def _report(settings: Settings, outcome: Outcome, place: Path) -> None:
    console = Console()
    title = f"{settings.scenario}, seed {settings.seed}, robot {settings.config.robot}"
    if outcome.metrics:
        console.print(results_table(title, outcome))
    path = place / RECORDING if (place / RECORDING).exists() else place
    # The last line is a bare path, for scripts and for terminals that make it a link.
    console.print(str(path), markup=False, highlight=False, soft_wrap=True)

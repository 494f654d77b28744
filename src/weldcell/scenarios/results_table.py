"""The table that ends a run."""

from typing import TYPE_CHECKING

from weldcell.scenarios.job import UNITS, Outcome

if TYPE_CHECKING:
    from rich.table import Table

_DECIMALS = {"_mm": 3, "_deg": 4, "_px": 3, "_um": 1, "_s": 2, "_count": 0, "_ratio": 3}
_VERDICTS = {None: "", True: "[green]ok[/green]", False: "[bold red]failed[/bold red]"}


def results_table(title: str, outcome: Outcome) -> "Table":
    """A row a metric: value, unit, limit and whether it is kept."""
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    table.add_column("metric", no_wrap=True)
    table.add_column("value", justify="right")
    table.add_column("unit")
    table.add_column("limit", justify="right")
    table.add_column("verdict")
    for name, value in outcome.metrics.items():
        ending = _ending(name)
        verdict = _VERDICTS[outcome.within_limit(name)]
        limit = outcome.limits.get(name)
        table.add_row(
            name.removesuffix(ending).replace("_", " "),
            _shown(value, ending),
            UNITS[ending],
            "" if limit is None else f"{limit:.6g}",
            verdict,
        )
    return table


def _ending(name: str) -> str:
    return next(ending for ending in UNITS if name.endswith(ending))


def _shown(value: float | None, ending: str) -> str:
    if value is None or value != value:
        return "not measured"
    return f"{value:.{_DECIMALS[ending]}f}"


def results_markdown(outcome: Outcome) -> str:
    """The same as a page of text."""
    lines = ["| metric | value | limit | |", "| --- | ---: | ---: | --- |"]
    for name, value in outcome.metrics.items():
        ending = _ending(name)
        limit = _shown(outcome.limits.get(name), ending) if name in outcome.limits else ""
        within = outcome.within_limit(name)
        verdict = "" if within is None else ("ok" if within else "**exceeded**")
        lines.append(f"| {name} | {_shown(value, ending)} | {limit} | {verdict} |")
    return "\n".join([*lines, "", *(f"- {reason}" for reason in outcome.reasons)])

"""Figures with what they are to reach, as a table."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One measured number."""

    name: str
    """What was measured."""
    value: float
    unit: str = ""
    at_least: float | None = None
    """What it should reach, if it should."""
    at_most: float | None = None
    """What it should not exceed, if so."""

    @property
    def target(self) -> str:
        """What is asked for, in words."""
        if self.at_least is not None and self.at_most is not None:
            return f"{self.at_least:g} to {self.at_most:g}"
        if self.at_least is not None:
            return f"at least {self.at_least:g}"
        return "" if self.at_most is None else f"at most {self.at_most:g}"

    @property
    def verdict(self) -> str:
        """`ok` or `short`; empty without a target."""
        if not self.target:
            return ""
        low = self.at_least is None or self.value >= self.at_least
        high = self.at_most is None or self.value <= self.at_most
        return "ok" if low and high else "short"


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table of several columns of text."""

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]

    def markdown(self) -> str:
        """The same for a page; the first two columns are words, the others numbers."""
        ruler = ["---" if k < 2 else "---:" for k in range(len(self.columns))]
        return "\n".join(f"| {' | '.join(cells)} |" for cells in (self.columns, ruler, *self.rows))


def show_grid(console: Console, grid: Grid) -> None:
    """Prints a grid."""
    table = Table(title=grid.title, title_justify="left")
    for k, column in enumerate(grid.columns):
        table.add_column(column, justify="left" if k < 2 else "right", overflow="fold")
    for row in grid.rows:
        table.add_row(*row)
    console.print(table)


def show(console: Console, title: str, figures: Sequence[Figure]) -> None:
    """Prints a table; targets only where there are some."""
    table = Table(title=title, title_justify="left")
    table.add_column("what")
    table.add_column("value", justify="right")
    table.add_column("unit")
    with_targets = any(figure.target for figure in figures)
    if with_targets:
        table.add_column("target")
        table.add_column("")
    for figure in figures:
        row = [figure.name, f"{figure.value:.4g}", figure.unit]
        table.add_row(*row, *([figure.target, figure.verdict] if with_targets else []))
    console.print(table)


def as_data(figures: Sequence[Figure]) -> dict[str, dict[str, float | str]]:
    """The same for a JSON file."""
    return {
        figure.name: {"value": figure.value}
        | {key: text for key in ("unit", "target", "verdict") if (text := getattr(figure, key))}
        for figure in figures
    }

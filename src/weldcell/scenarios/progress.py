"""How far a job has come: a bar on a terminal, plain lines in a log, nothing in a test."""

import time
from collections.abc import Collection, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as RichBars

Item = TypeVar("Item")

_LINE_EVERY_S = 10.0  # a log should show life, not every frame


class Progress:
    """Says nothing; the base of those that do."""

    def stage(self, title: str) -> None:
        """Says that a piece of work begins whose length is not known."""

    def track(self, items: Collection[Item], title: str) -> Iterator[Item]:
        """The items one by one, while saying how many of them are done."""
        del title
        yield from items


class LineProgress(Progress):
    """Plain lines for a log."""

    def __init__(self, console: "Console") -> None:
        self._console = console

    def stage(self, title: str) -> None:
        self._say(title)

    def track(self, items: Collection[Item], title: str) -> Iterator[Item]:
        started_s = said_s = time.monotonic()
        for done, item in enumerate(items):
            if time.monotonic() - said_s > _LINE_EVERY_S:
                said_s = time.monotonic()
                self._say(f"{title}: {done} of {len(items)}")
            yield item
        self._say(f"{title}: {len(items)} of {len(items)}, {time.monotonic() - started_s:.1f} s")

    def _say(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False, soft_wrap=True)


class BarProgress(Progress):
    """Bars on a terminal, one below the other."""

    def __init__(self, bars: "RichBars") -> None:
        self._bars = bars

    def stage(self, title: str) -> None:
        self._bars.console.print(title, markup=False, highlight=False)

    def track(self, items: Collection[Item], title: str) -> Iterator[Item]:
        task = self._bars.add_task(title, total=len(items))
        for item in items:
            yield item
            self._bars.advance(task)


def progress_on(console: "Console") -> AbstractContextManager[Progress]:
    """A progress for this console: bars if it is a terminal, lines otherwise."""
    if not console.is_terminal:
        return nullcontext(LineProgress(console))
    return _Bars(console)


class _Bars(AbstractContextManager[Progress]):
    """Keeps rich's live display going while a job runs."""

    def __init__(self, console: "Console") -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

        self._bars: RichBars = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=console,
        )

    def __enter__(self) -> Progress:
        self._bars.start()
        return BarProgress(self._bars)

    def __exit__(self, *exception: object) -> None:
        self._bars.stop()

"""Progress: nothing is lost on the way, whoever listens."""

import io

import pytest
from rich.console import Console

from weldcell.scenarios.progress import LineProgress, Progress, progress_on


@pytest.mark.parametrize("is_terminal", [False, True])
def test_all_items_come_through_in_order(is_terminal):
    with progress_on(Console(file=io.StringIO(), force_terminal=is_terminal)) as progress:
        progress.stage("[begin]")
        assert list(progress.track(range(3), "scan")) == [0, 1, 2]
        assert [(a, b) for a in progress.track([1, 2], "outer") for b in progress.track("x", "inner")] == [
            (1, "x"),
            (2, "x"),
        ]
    assert list(Progress().track("abc", "scan")) == ["a", "b", "c"]


def test_a_log_gets_plain_lines():
    log = io.StringIO()
    progress = LineProgress(Console(file=log))
    progress.stage("[begin]")
    list(progress.track(range(300), "scan"))
    first, second = log.getvalue().splitlines()
    assert first == "[begin]"
    assert second.startswith("scan: 300 of 300, ")
    assert "\x1b" not in log.getvalue()

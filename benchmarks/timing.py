"""Times of calls, as medians in milliseconds."""

import time
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

Result = TypeVar("Result")


class Stopwatch:
    """Collects times by name."""

    def __init__(self) -> None:
        self._times_ms: dict[str, list[float]] = {}

    def run(self, name: str, call: Callable[[], Result]) -> Result:
        """What the call returns, its time noted."""
        begin = time.perf_counter()
        result = call()
        self._times_ms.setdefault(name, []).append(1e3 * (time.perf_counter() - begin))
        return result

    def medians_ms(self) -> dict[str, float]:
        """Median time of each name, in the order of their first call."""
        return {name: float(np.median(times)) for name, times in self._times_ms.items()}


def interleaved_ms(calls: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median time of each call, the calls taking turns so that a busy moment of the machine meets all alike."""
    watch = Stopwatch()
    for call in calls.values():  # what is built at first use is no part of the times
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            watch.run(name, call)
    return watch.medians_ms()

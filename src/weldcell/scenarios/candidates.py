"""Random postures to choose views from."""

from collections.abc import Callable
from typing import TypeVar

from weldcell.cell.errors import OutOfReach

_CANDIDATES_PER_POSE = 8
_ATTEMPTS_PER_CANDIDATE = 20

Candidate = TypeVar("Candidate")


def gathered(draw: Callable[[], Candidate | None], count: int, target: str) -> list[Candidate]:
    """Several times `count` of what `draw` gives where it gives anything; OutOfReach if there are not even `count`."""
    candidates: list[Candidate] = []
    for _ in range(_CANDIDATES_PER_POSE * _ATTEMPTS_PER_CANDIDATE * count):
        candidate = draw()
        if candidate is not None:
            candidates.append(candidate)
        if len(candidates) >= _CANDIDATES_PER_POSE * count:
            break
    if len(candidates) < count:
        found = len(candidates)
        raise OutOfReach(f"{target}: found {found} postures that see it in reach and clear of parts, need {count}")
    return candidates

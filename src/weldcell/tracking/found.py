"""What a joint's finder gives: its corners by name, what was measured between them, and how far it can be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from weldcell.tracking.section import Corner


@dataclass(frozen=True, kw_only=True)
class Trust:
    """The grounds on which a joint was accepted."""

    explained: float
    """Share of the points about the joint that lie on its model, 0 to 1."""
    margin: float
    """How much fewer points the best other candidate explains: 0 for a tie, 1 without any other."""
    support: int
    """Points on the piece of the joint that has the fewest."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """A joint in the laser frame, or the reason why there is none."""

    corners: tuple[Corner, ...] = ()
    """In the order of the kind's names: from left (large x) to right."""
    measures: Mapping[str, float] = field(default_factory=dict)
    """Derived values, with units in their names."""
    trust: Trust | None = None
    reason: str = ""

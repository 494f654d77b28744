"""What a recording has come to hold; the blueprint is laid out from it."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float


@dataclass(kw_only=True)
class StageContents:
    """What has been logged in one stage."""

    name: str
    title: str
    low_base: Float[np.ndarray, "3"] = field(default_factory=lambda: np.full(3, np.inf))
    """Least coordinates of its points, m."""
    high_base: Float[np.ndarray, "3"] = field(default_factory=lambda: np.full(3, -np.inf))
    """Largest coordinates of its points, m."""
    accumulated: set[str] = field(default_factory=set)
    """Entities that hold one moment's points each and are shown accumulated."""
    shots: int = 0
    series: int = 0
    """Number of error series."""
    events: int = 0
    """Number of events in it."""

    def enclose(self, points_base: Float[np.ndarray, "n 3"]) -> None:
        """Takes points into the bounds (NaN is ignored)."""
        points_base = points_base[np.isfinite(points_base).all(axis=1)]
        if len(points_base):
            self.low_base = np.minimum(self.low_base, points_base.min(axis=0))
            self.high_base = np.maximum(self.high_base, points_base.max(axis=0))

    @property
    def bounded(self) -> bool:
        """Whether it has any point."""
        return bool(np.all(np.isfinite(self.low_base)))

    @property
    def shown(self) -> bool:
        """Whether it deserves a tab."""
        return bool(self.shots or self.series or self.bounded)


@dataclass(kw_only=True)
class Contents:
    """What has been logged in the whole recording."""

    title: str
    stages: dict[str, StageContents] = field(default_factory=dict)
    """By name, in their order."""
    texts: list[str] = field(default_factory=list)
    """Names of the text pages, in their order."""
    steps: list[str] = field(default_factory=list)
    """Names of the steps of a picture's processing, in their order."""
    picture_px: tuple[int, int] | None = None
    """Width and height of the camera pictures; None without a sensor."""
    range_mm: Float[np.ndarray, "4 2"] | None = None
    """Corners of the sensor's measuring range; None without a sensor."""

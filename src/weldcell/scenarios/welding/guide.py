"""What guides the torch: something that says how far beside and above the taught path it belongs."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from weldcell.tracking.seam_tracker import SeamTracker
from weldcell.tracking.sighting import Sighting, TrackerEvent, TrackerSettings
from weldcell.tracking.taught_path import TaughtPath


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """Where the torch belongs, beside and above the taught path."""

    lateral_m: float
    """To the left."""
    vertical_m: float
    """Up."""


class Guide(Protocol):
    """A sensor with what is made of it."""

    @property
    def ready(self) -> bool:
        """Whether it knows enough for the arc to be lit."""
        ...

    @property
    def stop_at_m(self) -> float | None:
        """Arc length of the taught path where the torch must come to a stand; None while there is no reason to."""
        ...

    @property
    def stop_kind(self) -> str:
        """`end`, `lost` or `gap-closed`; empty while there is no reason to stop."""
        ...

    @property
    def stop_reason(self) -> str:
        """Why, in words."""
        ...

    @property
    def events(self) -> tuple[TrackerEvent, ...]:
        """What happened so far."""
        ...

    def observe(self, sighting: Sighting) -> None:
        """A frame's result is there."""
        ...

    def deviation(self, arc_length_m: float, arc_s: float) -> Deviation:
        """Where the torch belongs at this arc length of the taught path, this long after the arc was lit."""
        ...

    def track(self, arc_length_m: Float[np.ndarray, "m"], arc_s: float) -> Float[np.ndarray, "m 2"]:
        """Lateral and vertical deviations of the seam that it believes in, m."""
        ...


class AsTaught:
    """No sensor: along the taught path (which a scan may have found) to its end."""

    ready = True
    events: tuple[TrackerEvent, ...] = ()

    def __init__(self, taught: TaughtPath) -> None:
        self.stop_at_m: float | None = taught.end_m
        self.stop_kind, self.stop_reason = "end", "the taught path ends"

    def observe(self, sighting: Sighting) -> None:
        """Nothing is made of it."""

    def deviation(self, arc_length_m: float, arc_s: float) -> Deviation:
        """None."""
        return Deviation(lateral_m=0.0, vertical_m=0.0)

    def track(self, arc_length_m: Float[np.ndarray, "m"], arc_s: float) -> Float[np.ndarray, "m 2"]:
        """The taught path itself."""
        return np.zeros((len(arc_length_m), 2))


class ByLaser:
    """The laser ahead of the torch, and the seam tracker."""

    def __init__(self, taught: TaughtPath, *, drift: bool) -> None:
        self._tracker = SeamTracker(taught, TrackerSettings(drift=drift))

    @property
    def ready(self) -> bool:
        """Once the seam was found."""
        return self._tracker.state != "searching"

    @property
    def stop_at_m(self) -> float | None:
        """The seam's end, or the last place where it was seen."""
        return self._tracker.stop_at_m

    @property
    def stop_kind(self) -> str:
        """What the last event of that kind says."""
        kinds = [event.kind for event in self.events if event.kind in ("end", "lost", "gap-closed")]
        return kinds[-1] if kinds and self.stop_at_m is not None else ""

    @property
    def stop_reason(self) -> str:
        """Why the torch must stop."""
        return self._tracker.stop_reason

    @property
    def events(self) -> tuple[TrackerEvent, ...]:
        """What happened to the seam."""
        return self._tracker.events

    def observe(self, sighting: Sighting) -> None:
        """A frame's result is there."""
        self._tracker.observe(sighting)

    def deviation(self, arc_length_m: float, arc_s: float) -> Deviation:
        """The tracker's target; none before the seam was found."""
        if not self.ready:
            return Deviation(lateral_m=0.0, vertical_m=0.0)
        target = self._tracker.target(arc_length_m, arc_s)
        return Deviation(lateral_m=target.lateral_m, vertical_m=target.vertical_m)

    def track(self, arc_length_m: Float[np.ndarray, "m"], arc_s: float) -> Float[np.ndarray, "m 2"]:
        """The tracker's curve."""
        return self._tracker.curve(arc_length_m, arc_s)[0]

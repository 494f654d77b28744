"""What goes into a seam tracker and what comes out of it."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadGeometry
from weldcell.tracking.joint_follower import SEARCH_M
from weldcell.tracking.seam_model import SeamPriors

TrackerState = Literal["searching", "tracking", "coasting", "end", "lost"]
EventKind = Literal["found", "coasting", "recovered", "end", "lost", "gap-closed", "jump"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Sighting:
    """What one frame of the sensor said about the seam."""

    time_s: float
    """Time of the exposure."""
    arc_length_m: float
    """Where the light crosses the taught path; known from the pose, also when nothing was seen."""
    arc_s: float
    """Time of the exposure since the arc was lit; 0 before."""
    point_base: Float[np.ndarray, "3"] | None = None
    """The seam in the base (m); None where it was not found."""
    sigma_m: float = 5e-5
    """Standard deviation of each of the point's coordinates across the seam."""
    confidence: float = 1.0
    """Probability that it is the right point."""
    reason: str = ""
    """Why it was not found, if it was not."""
    gap_m: float | None = None
    """Root gap, where the joint has one that was measured."""

    def __post_init__(self) -> None:
        if self.point_base is not None and not np.all(np.isfinite(self.point_base)):
            raise BadGeometry("sighting: point_base must be finite, or None where nothing was found")
        if not self.sigma_m > 0 or not np.isfinite([self.time_s, self.arc_length_m, self.arc_s]).all():
            raise BadGeometry("sighting: sigma_m must be positive and the times and the arc length finite")


@dataclass(frozen=True, kw_only=True, eq=False)
class Target:
    """Where the torch belongs at one place of the path and one time."""

    point_base: Float[np.ndarray, "3"]
    lateral_m: float
    """To the left of the taught path."""
    vertical_m: float
    """Above it."""
    sigma_m: float
    """Predicted standard deviation of either deviation."""
    state: TrackerState


@dataclass(frozen=True, kw_only=True)
class TrackerEvent:
    """Something that happened to the seam on its way under the light."""

    time_s: float
    """Exposure of the frame that brought it out."""
    kind: EventKind
    text: str


@dataclass(frozen=True, kw_only=True)
class TrackerSettings:
    """How a seam tracker goes about it."""

    priors: SeamPriors = field(default_factory=SeamPriors)
    drift: bool = True
    """Whether the part's drift is modelled."""
    least_confidence: float = 0.5
    """Sightings below it count as not seen."""
    least_sigma_m: float = 0.01e-3
    """Added in quadrature to each sighting's sigma: what the arm does from frame to frame."""
    search_gate_m: float = SEARCH_M
    """How far from the taught path the seam is looked for at first."""
    gate_sigmas: float = 5.0
    """How far from where it is expected the seam is believed, once found."""
    least_gate_m: float = 0.3e-3
    """The gate is never tighter."""
    jump_m: float = 1e-3
    """By how much a seam may jump and still be the same one, if some points beside it lie in line."""
    found_points: int = 4
    """So many points in line make a seam."""
    search_m: float = 20e-3
    """Not found this far behind the taught start, the seam is lost;"""
    search_frames: int = 6
    """so many frames at least are tried where the seam must be."""
    coasting_after_m: float = 2e-3
    """Nothing seen for this distance (and two frames): coasting."""
    coast_m: float = 8e-3
    """Nothing seen for this distance: the seam's end, or lost;"""
    coast_frames: int = 6
    """so many frames at least, where they lie far apart,"""
    longest_coast_m: float = 30e-3
    """but never farther than this: half of a look-ahead of 60 mm."""
    end_tolerance_m: float = 15e-3
    """How far from the taught end the seam may end."""
    end_points: int = 3
    """So many points seen beyond an end show that it was none."""
    least_gap_m: float = 0.1e-3
    """Narrower gaps cannot be seen."""

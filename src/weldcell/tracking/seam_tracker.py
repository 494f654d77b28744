"""The real-time seam tracker: sightings of a sensor that looks ahead go in, the torch's targets come out.

The estimate behind it, and what can and cannot be told, stand in `seam_model`; the states and stops in `seam_watch`.
Here: which sightings are believed. At first the seam is looked for within 15 mm of the taught path, and is found when
some points lie in line. From then on a point is believed within some sigmas of where the estimate expects it.
"""

from collections import deque
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from weldcell.tracking.point_line import in_line
from weldcell.tracking.seam_estimate import SeamBuffer, SeamEstimate
from weldcell.tracking.seam_model import seam_model
from weldcell.tracking.seam_watch import SeamWatch
from weldcell.tracking.sighting import Sighting, Target, TrackerEvent, TrackerSettings, TrackerState
from weldcell.tracking.target_curve import TargetCurve, target_curve
from weldcell.tracking.taught_path import TaughtPath

_CANDIDATES, _SURE_POINTS = 16, 10
_SHARE = 0.5  # of the candidates, that must lie in line
_JUMP_POINTS = 4
_JUMP_SHARE = 0.7


class SeamTracker:
    """Follows a seam near a taught path."""

    def __init__(self, taught: TaughtPath, settings: TrackerSettings) -> None:
        priors = settings.priors if settings.drift else replace(settings.priors, drift_m=0.0)
        self.taught = taught
        self._settings = settings
        self._model = seam_model(taught, priors)
        self._estimate = SeamEstimate(self._model, settings.least_sigma_m)
        self._watch = SeamWatch(taught.start_m, taught.end_m, settings)
        self._ahead: TargetCurve | None = None
        self._candidates: deque[Sighting] = deque(maxlen=_CANDIDATES)
        self._found: list[Sighting] = []
        self._strays: deque[tuple[Sighting, Float[np.ndarray, "2"], float]] = deque(maxlen=_CANDIDATES)

    @property
    def state(self) -> TrackerState:
        """Whether the seam is being seen."""
        return self._watch.state

    @property
    def events(self) -> tuple[TrackerEvent, ...]:
        """What happened so far."""
        return tuple(self._watch.events)

    @property
    def stop_at_m(self) -> float | None:
        """Arc length of the taught path where the torch must come to a stand; None while there is no reason to.

        The seam's end, or the last place where it was seen; the taught start if it was never found.
        """
        return self._watch.stop_at_m

    @property
    def stop_reason(self) -> str:
        """Why it must."""
        return self._watch.stop_reason

    @property
    def buffer(self) -> SeamBuffer:
        """The points that were believed."""
        return self._estimate.buffer

    def observe(self, sighting: Sighting) -> None:
        """Takes a frame's result in, in whatever order they come."""
        if self.state == "lost":
            return
        self._ahead = None
        seen = sighting.point_base is not None and sighting.confidence >= self._settings.least_confidence
        if len(self._found) < _SURE_POINTS:
            self._search(sighting, seen)
        elif seen:
            self._follow(sighting)
        else:
            self._watch.unseen(sighting.time_s, sighting.arc_length_m, sighting.reason or "nothing to be trusted")

    def target(self, arc_length_m: float, arc_s: float) -> Target:
        """Where the torch belongs at this arc length of the taught path, this long after the arc was lit."""
        if self._ahead is None or not self._ahead.covers(arc_length_m, arc_s):
            self._ahead = target_curve(self._estimate.curve, arc_length_m, arc_s)
        lateral_m, vertical_m, sigma_m = self._ahead.at(arc_length_m, arc_s)
        place = self.taught.place(np.array([arc_length_m]), np.array([lateral_m]), np.array([vertical_m]))
        return Target(
            point_base=place[0], lateral_m=lateral_m, vertical_m=vertical_m, sigma_m=sigma_m, state=self.state
        )

    def curve(
        self, arc_length_m: Float[np.ndarray, "m"], arc_s: float
    ) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m"]]:
        """Lateral and vertical deviations of the whole seam at a time, and the sigma of one of them (m)."""
        return self._estimate.curve(arc_length_m, np.full(len(arc_length_m), arc_s))

    def drift_m(self, arc_s: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m 3"]:
        """The drift in the base, as estimated, at these times since the arc was lit."""
        return self._estimate.drift_m(arc_s)

    def _search(self, sighting: Sighting, seen: bool) -> None:
        """Until some points lie in line; then, while they are few, from all of them anew with each that comes."""
        if seen:
            self._candidates.append(sighting)
            if self._find() and sighting is self._found[-1]:
                return
        self._watch.unseen(sighting.time_s, sighting.arc_length_m, sighting.reason or "no points in line")

    def _find(self) -> bool:
        """Whether enough candidates lie in line; they are the first points of the seam then."""
        sightings = list(self._candidates)
        places_m, lateral_m, vertical_m = self.taught.project(np.array([one.point_base for one in sightings]))
        offsets_m = np.column_stack([lateral_m, vertical_m])
        sigma_m = np.array([sighting.sigma_m for sighting in sightings])
        near = np.linalg.norm(offsets_m, axis=1) <= self._settings.search_gate_m
        line = np.flatnonzero(in_line(places_m, offsets_m, sigma_m) & near)
        if len(line) < max(self._settings.found_points, _SHARE * len(sightings)):
            return False
        if self.state == "searching":
            newest, (left_m, up_m) = sightings[line[-1]], np.median(offsets_m[line], axis=0)
            self._watch.found(newest.time_s, float(places_m[line].min()), (float(left_m), float(up_m)))
        self._found = [sightings[index] for index in line]
        self._estimate = SeamEstimate(self._model, self._settings.least_sigma_m)
        for index in line:
            self._believe(sightings[index], float(places_m[index]))
        self._estimate.refit()
        return True

    def _follow(self, sighting: Sighting) -> None:
        assert sighting.point_base is not None
        near_m = sighting.arc_length_m + self._watch.lead_m
        off_m, sigma_m, place_m = self._estimate.surprise(sighting.point_base, sighting.arc_s, near_m)
        settings, distance_m = self._settings, float(np.linalg.norm(off_m))
        gate_m = settings.gate_sigmas * float(np.hypot(sigma_m, self._estimate.noise * sighting.sigma_m))
        if distance_m <= min(max(gate_m, settings.least_gate_m), settings.search_gate_m):
            self._strays.clear()
            self._believe(sighting, place_m)
            self._estimate.refit()
            return
        self._strays.append((sighting, off_m, place_m))
        if not self._jump(sighting):
            reason = f"what was seen lies {1e3 * distance_m:.2f} mm off"
            self._watch.unseen(sighting.time_s, sighting.arc_length_m, reason)

    def _believe(self, sighting: Sighting, place_m: float) -> None:
        assert sighting.point_base is not None
        self._estimate.add(sighting.point_base, sighting.arc_s, sighting.sigma_m, place_m)
        self._watch.seen(sighting.time_s, sighting.arc_length_m, place_m, sighting.gap_m)

    def _jump(self, sighting: Sighting) -> bool:
        """Whether points beside the seam agree, and lie so little beside it that they are the seam after all."""
        offsets_m = np.array([off_m for _, off_m, _ in self._strays])
        middle = np.median(offsets_m, axis=0)
        size_m = float(np.linalg.norm(middle))
        near = np.linalg.norm(offsets_m - middle, axis=1) <= 0.25 * size_m + 4 * sighting.sigma_m
        if near.sum() < _JUMP_POINTS or near.mean() < _JUMP_SHARE:
            return False
        self._watch.jumped(sighting.time_s, size_m)
        if size_m > self._settings.jump_m:
            return False
        for index in np.flatnonzero(near):
            stray, _, place_m = self._strays[index]
            self._believe(stray, place_m)
        self._strays.clear()
        self._estimate.refit()
        return True

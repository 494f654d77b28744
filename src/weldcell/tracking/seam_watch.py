"""Whether a seam is being seen, and where the torch has to stop: the states of a seam tracker.

    searching -> tracking <-> coasting -> end | lost        (end -> tracking, if the seam goes on after all)

All is judged by where the light was, not by the order in which frames come: what was seen or not at an earlier place
than the last sighting changes nothing.
"""

import numpy as np

from weldcell.tracking.sighting import EventKind, TrackerEvent, TrackerSettings, TrackerState

_GAP_STRETCH_M = 20e-3  # before its last sighting, over which a gap's trend is judged
_GAP_POINTS = 5


class SeamWatch:
    """The state of the search, its events, and the stop."""

    def __init__(self, start_m: float, end_m: float, settings: TrackerSettings) -> None:
        self.state: TrackerState = "searching"
        self.events: list[TrackerEvent] = []
        self.stop_at_m: float | None = None
        """Arc length where the torch must come to a stand."""
        self.stop_reason = ""
        self.lead_m = 0.0
        """How far beyond the light's crossing of the taught path the seam was last seen, along the path."""
        self._start_m, self._end_m, self._settings = start_m, end_m, settings
        self._seen_light_m = self._seen_place_m = -np.inf
        self._unseen_m: list[float] = []
        self._gaps: list[tuple[float, float]] = []
        self._beyond_end = 0
        self._tries = 0
        self._jumped = False

    def found(self, time_s: float, place_m: float, offset_m: tuple[float, float]) -> None:
        """The seam was found."""
        self.state = "tracking"
        self._unseen_m = []
        left, up = 1e3 * offset_m[0], 1e3 * offset_m[1]
        self._tell(time_s, "found", f"seam found at {1e3 * place_m:.1f} mm, {left:+.2f} mm left and {up:+.2f} mm up")

    def seen(self, time_s: float, light_m: float, place_m: float, gap_m: float | None = None) -> None:
        """The seam was seen at a place of the path, and believed."""
        if light_m <= self._seen_light_m:
            return
        if gap_m is not None:
            self._gaps.append((place_m, gap_m))
        if self.state == "end":
            self._beyond_end += 1
            if self._beyond_end < self._settings.end_points:
                return
        coasted_m, self._jumped = place_m - self._seen_place_m, False
        self._seen_light_m, self._seen_place_m, self.lead_m = light_m, place_m, place_m - light_m
        self._unseen_m = [light for light in self._unseen_m if light > light_m]
        if self.state in ("coasting", "end"):
            self.state, self.stop_at_m, self.stop_reason = "tracking", None, ""
            self._beyond_end = 0
            self._tell(
                time_s, "recovered", f"seam seen again at {1e3 * place_m:.1f} mm, after {1e3 * coasted_m:.1f} mm"
            )
        limit_m = self._end_m + self._settings.end_tolerance_m
        if self.state == "tracking" and place_m > limit_m:
            self._stop(
                time_s, "end", limit_m, f"the seam goes on {1e3 * (place_m - self._end_m):.1f} mm beyond its taught end"
            )

    def unseen(self, time_s: float, light_m: float, reason: str) -> None:
        """Nothing was seen, or nothing that could be believed, with the light at this arc length."""
        if self.state == "searching":
            self._search(time_s, light_m, reason)
        elif self.state in ("tracking", "coasting") and light_m > self._seen_light_m:
            self._unseen_m.append(light_m)
            self._coast(time_s, reason)

    def jumped(self, time_s: float, size_m: float) -> None:
        """What was seen lies in line, but not where the seam should be: told once until it is seen again."""
        if not self._jumped:
            self._jumped = True
            self._tell(time_s, "jump", f"what is seen lies {1e3 * size_m:.2f} mm from where the seam should go on")

    def _search(self, time_s: float, light_m: float, reason: str) -> None:
        settings = self._settings
        must_be_m = self._start_m + settings.priors.place_m
        self._tries += light_m > must_be_m
        if light_m > self._start_m + settings.search_m and self._tries >= settings.search_frames:
            text = f"seam not found within {1e3 * (light_m - self._start_m):.1f} mm of its taught start"
            self._stop(time_s, "lost", self._start_m, text + _because(reason))

    def _coast(self, time_s: float, reason: str) -> None:
        settings = self._settings
        away_m = max(self._unseen_m) - self._seen_light_m
        if self.state == "tracking" and away_m >= settings.coasting_after_m and len(self._unseen_m) >= 2:
            self.state = "coasting"
            self._tell(time_s, "coasting", f"seam not seen since {1e3 * self._seen_place_m:.1f} mm" + _because(reason))
        long = away_m >= settings.coast_m and len(self._unseen_m) >= settings.coast_frames
        if self.state == "coasting" and (long or away_m >= settings.longest_coast_m):
            self._give_up(time_s, reason)

    def _give_up(self, time_s: float, reason: str) -> None:
        last_m = self._seen_place_m
        if abs(last_m - self._end_m) <= self._settings.end_tolerance_m:
            end_m = last_m + (min(self._unseen_m) - self._seen_light_m) / 2  # between the last seen and the next frame
            self._stop(time_s, "end", end_m, f"the seam's end was seen at {1e3 * end_m:.1f} mm")
        elif self._gap_closed():
            self._stop(time_s, "gap-closed", last_m, f"the gap closed at {1e3 * last_m:.1f} mm")
        else:
            why = "; what is seen since lies beside it" if self._jumped else _because(reason)
            self._stop(time_s, "lost", last_m, f"seam lost at {1e3 * last_m:.1f} mm" + why)

    def _gap_closed(self) -> bool:
        """Whether the gap's trend (Theil and Sen: median of the slopes) leads below what can be seen."""
        gaps = np.array([row for row in self._gaps if row[0] > self._seen_place_m - _GAP_STRETCH_M]).reshape(-1, 2)
        if len(gaps) < _GAP_POINTS:
            return False
        first, second = np.triu_indices(len(gaps), 1)
        steps = gaps[second] - gaps[first]
        slope = np.median(steps[:, 1] / np.where(steps[:, 0] == 0, np.inf, steps[:, 0]))
        level = np.median(gaps[:, 1] - slope * gaps[:, 0])
        return bool(level + slope * (self._seen_place_m + self._settings.coast_m) <= self._settings.least_gap_m)

    def _stop(self, time_s: float, kind: EventKind, at_m: float, text: str) -> None:
        self.state = "end" if kind == "end" else "lost"
        self.stop_at_m, self.stop_reason = at_m, text
        self._tell(time_s, kind, text)

    def _tell(self, time_s: float, kind: EventKind, text: str) -> None:
        self.events.append(TrackerEvent(time_s=time_s, kind=kind, text=text))


def _because(reason: str) -> str:
    return f": {reason}" if reason else ""

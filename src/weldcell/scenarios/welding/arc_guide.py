"""Guided by the arc: the current while the torch weaves, and what the through-arc tracker makes of it."""

import numpy as np
from jaxtyping import Float

from weldcell.cell.configuration import SeamConfig
from weldcell.cell.randomness import generator
from weldcell.scenarios.station import Station
from weldcell.scenarios.welding.guide import Deviation
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.weld.arc_current import ArcElectrics, ArcSource
from weldcell.sensor_sim.weld.contact_distance import WORK_GROUPS, contact_distance
from weldcell.tracking.sighting import Sighting, TrackerEvent
from weldcell.tracking.taught_path import TaughtPath
from weldcell.tracking.through_arc import ThroughArcSettings, ThroughArcTracker
from weldcell.tracking.weaving import Weave

_SAMPLES_HZ = 2000.0
_GROOVE_ANGLE_RAD = np.pi / 2  # of a fillet and a lap, whose walls stand square


class ArcCurrent:
    """The current of the actual arc: the source, and the way from contact tip to work where the torch really is."""

    def __init__(self, station: Station, tick_s: float) -> None:
        self._station = station
        self._caster = RayCaster(station.cell.model, WORK_GROUPS)
        self._source = ArcSource(ArcElectrics(), generator(station.seed, "weld/arc current"))
        self._samples = max(1, round(tick_s * _SAMPLES_HZ))
        self._tick_s = tick_s
        self._distance_m: float | None = None

    def tick(self) -> Float[np.ndarray, "n"]:
        """Samples of the current (A) over the last tick, the cell standing as at its end."""
        now_m = float(contact_distance(self._caster, self._station.cell.data, self._station.cell.T_base("torch")))
        before_m = now_m if self._distance_m is None or not np.isfinite(self._distance_m) else self._distance_m
        self._distance_m = now_m
        share = np.arange(1, self._samples + 1) / self._samples
        way_m = before_m + share * (now_m - before_m) if np.isfinite(now_m) else np.full(self._samples, np.inf)
        return self._source.currents(way_m, self._tick_s / self._samples)


class ByArc:
    """Through-arc sensing; the path's end is the taught one."""

    ready = True

    def __init__(self, taught: TaughtPath, weave: Weave, seam: SeamConfig) -> None:
        angle_rad = float(np.radians(seam.groove_angle_deg))
        if seam.joint in ("fillet", "lap"):
            angle_rad = _GROOVE_ANGLE_RAD
        self._tracker = ThroughArcTracker(ThroughArcSettings(weave=weave, groove_angle_rad=angle_rad))
        self._end_m, self._lost_m = taught.end_m, float("nan")
        self._events: list[TrackerEvent] = []
        self._reason = ""

    @property
    def stop_at_m(self) -> float:
        """Where the seam was lost, else the taught end."""
        return self._lost_m if self._reason else self._end_m

    @property
    def stop_kind(self) -> str:
        """Lost, if it is."""
        return "lost" if self._reason else "end"

    @property
    def stop_reason(self) -> str:
        """Why the torch must stop."""
        return self._reason or "the taught path ends"

    @property
    def events(self) -> tuple[TrackerEvent, ...]:
        """What happened so far."""
        return tuple(self._events)

    def observe(self, sighting: Sighting) -> None:
        """The laser plays no part."""

    def feel(
        self,
        arc_length_m: float,
        time_s: Float[np.ndarray, "n"],
        phase_rad: Float[np.ndarray, "n"],
        current_a: Float[np.ndarray, "n"],
    ) -> None:
        """Takes samples of the current in, the torch being there."""
        for reading in self._tracker.feed(time_s, phase_rad, current_a):
            if reading.state in ("lost", "not-observable") and not self._reason:
                self._reason, self._lost_m = reading.reason, arc_length_m
                self._events.append(TrackerEvent(time_s=reading.time_s, kind="lost", text=reading.reason))

    def deviation(self, arc_length_m: float, arc_s: float) -> Deviation:
        """The corrections so far."""
        lateral_m, vertical_m = self._tracker.correction()
        return Deviation(lateral_m=lateral_m, vertical_m=vertical_m)

    def track(self, arc_length_m: Float[np.ndarray, "m"], arc_s: float) -> Float[np.ndarray, "m 2"]:
        """The corrections so far, all along: the arc sees nothing ahead."""
        return np.tile(self._tracker.correction(), (len(arc_length_m), 1))

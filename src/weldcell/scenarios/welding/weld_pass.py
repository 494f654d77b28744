"""One weld in real time: the torch on its path, the sensor ahead of it, the drives' physics, the part that moves.

Three rates: the servos' (physics), the controller's (a new place for the torch each tick), the sensor's (pictures,
whose results come a latency later). The torch runs in over a look-ahead before the seam, so that the light has seen
the seam when the arc is lit at its start. What the guide says is blended in on the run-in, and later changes fade in
over `_FADE_S`: the torch never jumps.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.configuration import Disturbance, DisturbanceKind
from weldcell.cell.world.path_clock import PathClock
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.station import Station
from weldcell.scenarios.welding.arc_guide import ArcCurrent, ByArc
from weldcell.scenarios.welding.guide import ByLaser, Deviation, Guide
from weldcell.scenarios.welding.lookout import Lookout
from weldcell.scenarios.welding.moving_part import MovingPart
from weldcell.scenarios.welding.torch_drive import TorchDrive
from weldcell.scenarios.welding.torch_path import TorchPath
from weldcell.tracking.weaving import Weave

ACCELERATION_M_S2 = 2.0
"""Largest along the path: from 100 mm/s the torch stops within 5 mm."""
LEAD_M = 0.010
"""How far before the seam the light starts."""
_BLEND_M = (-0.045, -0.008)  # from the seam's start: where the guide's word begins to count, and where it counts fully
_FADE_S = 0.15
_BEYOND_END_M = 0.030  # of the taught path: further on there is nothing to weld
_TRACK_POINTS = 25
_SETTLING_TICKS = 4  # the arm comes to a stand that much after what it is sent
_LIGHT: tuple[DisturbanceKind, ...] = ("arc", "spatter", "fume")


@dataclass(kw_only=True, eq=False)
class WeldTrace:
    """What happened, tick by tick; the actual places are for comparison only."""

    times_s: list[float] = field(default_factory=list)
    arc_length_m: list[float] = field(default_factory=list)
    """Of the taught path, commanded."""
    welding: list[bool] = field(default_factory=list)
    """Whether the arc burned."""
    weave_m: list[float] = field(default_factory=list)
    """How far the weave had swung to the left."""
    tips_part: list[Float[np.ndarray, "3"]] = field(default_factory=list)
    """The actual tip in the frame of the part as it lay then, m."""
    frames: list[int] = field(default_factory=list)
    """The next picture's number."""
    stop_kind: str = ""
    """Why the torch stopped."""
    stop_reason: str = ""
    """The same in words."""
    trouble_at_m: float = float("nan")
    """Arc length of the taught path up to which it might go."""
    stopped_at_m: float = float("nan")
    """And where it came to a stand."""
    arc_on_s: float = float("nan")
    arc_off_s: float = float("nan")

    def tips(self) -> Float[np.ndarray, "n 3"]:
        """All tips, m, part."""
        return np.array(self.tips_part).reshape(-1, 3)

    def welded(self) -> Bool[np.ndarray, "n"]:
        """Whether the arc burned."""
        return np.array(self.welding, bool)

    def frame_ticks(self) -> Int[np.ndarray, "k"]:
        """The last tick before each picture."""
        return np.flatnonzero(np.diff(self.frames, append=self.frames[-1:]) > 0)


class WeldPass:
    """The weld of a seam; `run` does it."""

    def __init__(
        self,
        station: Station,
        alignment: Alignment,
        path: TorchPath,
        part: MovingPart,
        guide: Guide,
        weave: Weave | None,
    ) -> None:
        config = station.config.weld
        self._station, self._config, self._path, self._part, self._guide = station, config, path, part, guide
        self._tick_s = 1 / config.command_hz
        self._lookout = Lookout(station, path, alignment, config)
        self._weave = weave
        self._current = ArcCurrent(station, self._tick_s) if isinstance(guide, ByArc) else None
        self.start_m = path.taught.start_m - path.look_ahead_m - LEAD_M
        """Where the run-in begins, as arc length of the taught path."""
        self._drive = TorchDrive(station, path, alignment, self.start_m, config)
        self._fading, self._last = Deviation(lateral_m=0.0, vertical_m=0.0), Deviation(lateral_m=0.0, vertical_m=0.0)
        self._told, self._now_s, self._weave_sent_m = 0, station.time_s, 0.0
        self._seeing = isinstance(guide, ByLaser)
        self.trace = WeldTrace()

    @property
    def lookout(self) -> Lookout:
        """The sensor's side."""
        return self._lookout

    def run(self) -> WeldTrace:
        """What happened, from the run-in's start, where the arm stands, to where the torch came to a stand."""
        self._drive.start(self._station.joints_rad)
        self._now_s = self._station.time_s
        self._lookout.begin(self._now_s)
        clock = PathClock(1e-3 * self._config.speed_mm_s, ACCELERATION_M_S2, start_m=self.start_m)
        standing = 0
        while standing < _SETTLING_TICKS:
            standing += int(self._drive.at_rest if self._drive.trouble else clock.stopped)
            clock.advance(self._tick_s)
            self._now_s += self._tick_s
            self._tick(clock.arc_length_m)
            if (
                not (self._lit or clock.stopping)
                and self._guide.ready
                and clock.arc_length_m >= self._path.taught.start_m
            ):
                self._light_arc()
            self._mind_stops(clock)
        self._conclude(clock)
        return self.trace

    @property
    def _lit(self) -> bool:
        return not np.isnan(self.trace.arc_on_s)

    @property
    def _arc_s(self) -> float:
        """Time since the arc was lit; 0 before."""
        return self._now_s - self.trace.arc_on_s if self._lit else 0.0

    def _tick(self, place_m: float) -> None:
        """A tick of the controller, the torch's path being at this place."""
        said = self._guide.deviation(place_m, self._arc_s)
        wanted, weave_m = self._wanted(place_m, said), self._weave_m()
        readings_rad = self._drive.go(place_m, wanted.lateral_m + weave_m, wanted.vertical_m)
        stray_rad = self._drive.stray_rad(self._now_s)
        self._station.cell.place("plate", self._part.T_base_part(self._arc_s))
        self._station.cell.take(readings_rad + stray_rad)
        self._note(place_m, self._weave_sent_m)
        self._weave_sent_m = weave_m  # the arm gets there a tick later
        if self._lookout.due(self._now_s):
            self._station.stand_at(readings_rad, self._now_s)
            if self._seeing:
                self._lookout.look(place_m, self._arc_s, self._drive.rates_rad_s, stray_rad)
            self._show_track(place_m)
        for sighting in self._lookout.results(self._now_s):
            self._guide.observe(sighting)
        self._feel(place_m)
        self._fade(said, self._guide.deviation(place_m, self._arc_s))
        self._tell()

    def _wanted(self, place_m: float, said: Deviation) -> Deviation:
        """Where the torch is sent: what the guide says, blended in, with its latest changes fading in."""
        begin_m, full_m = (self._path.taught.start_m + at_m for at_m in _BLEND_M)
        share = float(np.clip((place_m - begin_m) / (full_m - begin_m), 0, 1))
        share = share * share * (3 - 2 * share)
        kept = float(np.exp(-self._tick_s / _FADE_S))
        self._fading = Deviation(lateral_m=kept * self._fading.lateral_m, vertical_m=kept * self._fading.vertical_m)
        return Deviation(
            lateral_m=share * (said.lateral_m + self._fading.lateral_m),
            vertical_m=share * (said.vertical_m + self._fading.vertical_m),
        )

    def _fade(self, before: Deviation, after: Deviation) -> None:
        """The guide has changed its mind: the torch follows by and by."""
        self._fading = Deviation(
            lateral_m=self._fading.lateral_m + before.lateral_m - after.lateral_m,
            vertical_m=self._fading.vertical_m + before.vertical_m - after.vertical_m,
        )

    def _weave_m(self) -> float:
        """How far the weave swings to the left now; it begins with the arc."""
        if self._weave is None or not self._lit:
            return 0.0
        return float(self._weave.lateral_m(np.array([self._arc_s]))[0])

    def _feel(self, place_m: float) -> None:
        """The arc's current over the last tick, if that guides."""
        if self._current is None or self._weave is None or not self._lit or not isinstance(self._guide, ByArc):
            return
        current_a = self._current.tick()
        times_s = self._arc_s - self._tick_s * (1 - np.arange(1, len(current_a) + 1) / len(current_a))
        self._guide.feel(place_m, times_s, self._weave.phase_rad(times_s - self._drive.delay_s), current_a)

    def _note(self, place_m: float, weave_m: float) -> None:
        """What is true now, for the comparison."""
        trace, cell = self.trace, self._station.cell
        trace.times_s.append(self._now_s)
        trace.arc_length_m.append(place_m)
        trace.welding.append(self._lit)
        trace.weave_m.append(weave_m)
        trace.tips_part.append(cell.T_base_part("plate").inv().apply(cell.tip_base))
        trace.frames.append(self._station.frame)

    def _light_arc(self) -> None:
        self.trace.arc_on_s = self._now_s
        self._event("the arc is lit")
        if self._config.arc:
            burning = tuple(Disturbance(kind=kind, start_s=self._now_s) for kind in _LIGHT)
            script = self._station.config.disturbances + burning
            self._station.script = self._station.sensor.scripted(script, self._station.seed)

    def _mind_stops(self, clock: PathClock) -> None:
        """Ends the path where the guide says, or at once where the arm cannot go on."""
        if self._drive.trouble and not clock.stopping:
            self.trace.trouble_at_m = clock.arc_length_m
            clock.brake()
        elif self._guide.stop_at_m is not None and not self._drive.trouble:
            self.trace.trouble_at_m = self._guide.stop_at_m
            clock.end_at(self._guide.stop_at_m)
        elif clock.arc_length_m > self._path.taught.end_m + _BEYOND_END_M:
            clock.brake()

    def _conclude(self, clock: PathClock) -> None:
        trace, station = self.trace, self._station
        trace.stopped_at_m, trace.arc_off_s = clock.arc_length_m, self._now_s
        trace.stop_kind, trace.stop_reason = self._guide.stop_kind, self._guide.stop_reason
        if self._drive.trouble:
            trace.stop_kind, trace.stop_reason = "out-of-reach", self._drive.trouble
        station.script = None
        station.joints_rad, station.time_s = self._drive.place_rad, self._now_s
        self._event(f"the torch stands: {trace.stop_kind or 'the path is over'}: {trace.stop_reason}", warning=True)

    def _tell(self) -> None:
        """Puts the guide's new events into the recording."""
        for event in self._guide.events[self._told :]:
            self._event(f"{event.kind}: {event.text}", warning=event.kind not in ("found", "recovered", "end"))
        self._told = len(self._guide.events)

    def _event(self, text: str, *, warning: bool = False) -> None:
        station = self._station
        station.recording.log_event(text, frame=station.frame, time_s=self._now_s, warning=warning)

    def _show_track(self, place_m: float) -> None:
        """The seam as the guide has it, from the torch to the light."""
        if not self._station.recording.enabled or not self._guide.ready:
            return
        taught = self._path.taught
        ahead_m = np.linspace(place_m, place_m + self._path.look_ahead_m, _TRACK_POINTS)
        deviations_m = self._guide.track(ahead_m, self._arc_s)
        line_base = taught.place(ahead_m, deviations_m[:, 0], deviations_m[:, 1])
        self._station.recording.log_lines("track", {"track": line_base}, frame=self._station.frame, time_s=self._now_s)

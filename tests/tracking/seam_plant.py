"""A seam on a part that stands off and drifts, a sensor that looks ahead of a torch, and the loop between: fabricated.

The truth is worked out on a fine polyline of the actual seam, not by the model that the tracker fits.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from weldcell.tracking.seam_tracker import SeamTracker
from weldcell.tracking.sighting import Sighting, TrackerSettings
from weldcell.tracking.taught_path import TaughtPath

LOOK_AHEAD_M = 0.060
LENGTH_M = 0.300
FINE_M = 0.25e-3


def path(kind: str = "s", length_m: float = LENGTH_M) -> TaughtPath:
    """A straight path, or one period of a sine of 20 mm, somewhere in the cell and turned in it."""
    x = np.linspace(0, length_m, 20001)
    wave = 2 * np.pi / length_m
    y = 0.020 * np.sin(wave * x) if kind == "s" else 0 * x
    slope = 0.020 * wave * np.cos(wave * x) if kind == "s" else 0 * x
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    pick = np.searchsorted(arc, np.arange(0, arc[-1], 2e-3))
    points = np.column_stack([x, y, 0 * x])[pick]
    lefts = np.column_stack([-slope, 1 + 0 * x, 0 * x])[pick] / np.hypot(1, slope[pick])[:, None]
    turn = Rotation.from_euler("z", 25, degrees=True)
    return TaughtPath(
        arc_length_m=arc[pick],
        points_base=turn.apply(points) + [0.9, -0.2, 0.3],
        lefts_base=turn.apply(lefts),
        ups_base=np.tile([0.0, 0.0, 1.0], (len(pick), 1)),
    )


def no_drift(time_s: np.ndarray) -> np.ndarray:
    """Nothing moves."""
    return np.zeros((*np.shape(time_s), 3))


def steady(size_m: np.ndarray, within_s: float) -> Callable[[np.ndarray], np.ndarray]:
    """A drift of constant rate."""
    return lambda time_s: np.maximum(np.asarray(time_s), 0)[..., None] / within_s * size_m


def saturating(size_m: np.ndarray, constant_s: float) -> Callable[[np.ndarray], np.ndarray]:
    """A drift that comes to rest: 1 - exp(-t / constant)."""
    return lambda time_s: (1 - np.exp(-np.maximum(np.asarray(time_s), 0) / constant_s))[..., None] * size_m


@dataclass(frozen=True, kw_only=True)
class Plant:
    """What stands in the cell, and how it is looked at."""

    taught: TaughtPath
    shift_m: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn_rad: np.ndarray = field(default_factory=lambda: np.zeros(3))
    drift: Callable[[np.ndarray], np.ndarray] = no_drift
    shape: Callable[[np.ndarray], np.ndarray] = lambda arc_length_m: np.zeros((len(arc_length_m), 2))
    speed_m_s: float = 0.010
    rate_hz: float = 10.0
    latency_s: float = 0.05
    noise_m: float = 0.05e-3
    lost_share: float = 0.1
    stray_share: float = 0.05
    hidden_m: tuple[float, float] | None = None
    gap_m: Callable[[float], float] | None = None
    least_gap_m: float = 0.1e-3
    seam_end_m: float = np.inf
    run_in_m: float = LOOK_AHEAD_M + 0.015

    @cached_property
    def still_base(self) -> np.ndarray:
        """Points of the actual seam before anything drifts."""
        end_m = min(self.taught.end_m, self.seam_end_m)
        at = np.linspace(0, end_m, int(end_m / FINE_M) + 1)
        middle = self.taught.points_base.mean(axis=0)
        offsets = self.shape(at)
        points = self.taught.place(at, offsets[:, 0], offsets[:, 1]) - middle
        return Rotation.from_rotvec(self.turn_rad).apply(points) + middle + self.shift_m

    def cut(self, time_s: float, point: np.ndarray, normal: np.ndarray) -> np.ndarray | None:
        """Where a plane cuts the actual seam, nearest to a point; None if it does not."""
        line, drift = self.still_base, self.drift(np.array(time_s))
        side = line @ normal + (drift - point) @ normal
        places = np.flatnonzero(np.diff(side >= 0))
        if not len(places):
            return None
        share = side[places] / (side[places] - side[places + 1])
        cuts = line[places] + share[:, None] * (line[places + 1] - line[places]) + drift
        return cuts[np.argmin(np.linalg.norm(cuts - point, axis=1))]

    def truth(self, arc_length_m: float, time_s: float) -> np.ndarray | None:
        """Lateral and vertical deviation of the actual seam from the taught path there."""
        at = self.taught.places(np.array([arc_length_m]))
        cut = self.cut(time_s, at.points[0], at.steps[0])
        return None if cut is None else np.array([at.lefts[0], at.ups[0]]) @ (cut - at.points[0])

    def true_end_m(self, time_s: float) -> float:
        """Arc length of the taught path beside the actual seam's end."""
        return float(self.taught.project(self.still_base[-1:] + self.drift(np.array(time_s)))[0][0])


@dataclass(kw_only=True)
class Weld:
    """What came of a run."""

    tracker: SeamTracker
    arc_length_m: np.ndarray
    arc_s: np.ndarray
    errors_m: np.ndarray
    """Target less truth, lateral and vertical, where the torch was on the seam."""
    sigma_m: np.ndarray
    stopped_at_m: float


def sight(plant: Plant, time_s: float, rng: np.random.Generator) -> Sighting:
    """One frame: the arc is lit at time 0, when the torch is at the taught start."""
    light_m = plant.speed_m_s * time_s + LOOK_AHEAD_M
    lost, stray = rng.random(2)
    jitter = rng.normal(0, plant.noise_m, 2)
    astray = rng.uniform(-12e-3, 12e-3, 2)
    blank = Sighting(time_s=time_s, arc_length_m=light_m, arc_s=max(time_s, 0.0), reason="no stripe")
    ahead = plant.taught.places(np.array([light_m, light_m - LOOK_AHEAD_M]))
    heading = ahead.points[0] - ahead.points[1]  # the sensor is fixed to a torch that stands along the path
    point = plant.cut(time_s, ahead.points[0], heading / np.linalg.norm(heading))
    if point is None or lost < plant.lost_share:
        return blank
    place_m = float(plant.taught.project(point[None])[0][0])
    if plant.hidden_m and plant.hidden_m[0] < place_m < plant.hidden_m[1]:
        return blank
    gap_m = plant.gap_m(place_m) if plant.gap_m else None
    if gap_m is not None and gap_m < plant.least_gap_m:
        return replace(blank, reason="no gap")
    off = jitter + (astray if stray < plant.stray_share else 0)
    point = point + off @ np.array([ahead.lefts[0], ahead.ups[0]])
    return replace(blank, point_base=point, sigma_m=plant.noise_m, reason="", gap_m=gap_m)


def weld(plant: Plant, settings: TrackerSettings, seed: int, *, shuffle: int = 0) -> Weld:
    """Runs the torch along the seam; frames come after their latency, `shuffle` of them at a time in any order."""
    rng = np.random.default_rng([seed, 7])
    tracker = SeamTracker(plant.taught, settings)
    first_s = -plant.run_in_m / plant.speed_m_s
    last_s = (plant.taught.end_m + 0.02) / plant.speed_m_s
    times_s = np.arange(first_s, last_s, 1 / plant.rate_hz)
    sightings = [sight(plant, float(time_s), rng) for time_s in times_s]
    if shuffle:
        order = np.concatenate(
            [rng.permutation(np.arange(i, min(i + shuffle, len(times_s)))) for i in range(0, len(times_s), shuffle)]
        )
        sightings = [sightings[k] for k in order]
    places, arcs, errors, sigmas = [], [], [], []
    for index, time_s in enumerate(times_s):
        tracker.observe(sightings[index])
        now_s = float(time_s) + plant.latency_s
        torch_m = plant.speed_m_s * now_s
        if tracker.stop_at_m is not None and torch_m >= tracker.stop_at_m:
            break
        truth = plant.truth(torch_m, now_s) if torch_m >= 0 else None
        if truth is not None:
            target = tracker.target(torch_m, now_s)
            places.append(torch_m)
            arcs.append(now_s)
            errors.append(np.array([target.lateral_m, target.vertical_m]) - truth)
            sigmas.append(target.sigma_m)
    return Weld(
        tracker=tracker,
        arc_length_m=np.array(places),
        arc_s=np.array(arcs),
        errors_m=np.array(errors).reshape(-1, 2),
        sigma_m=np.array(sigmas),
        stopped_at_m=torch_m,
    )


def misplaced(rng: np.random.Generator, *, size_m: float = 10e-3, turn_deg: float = 3.0) -> dict[str, np.ndarray]:
    """A part that stands off by this much, turned by this much about the vertical and a tenth of a degree beside it."""
    direction = rng.normal(size=3) * [1, 1, 0.5]
    turn = np.deg2rad([rng.normal(0, 0.1), rng.normal(0, 0.1), turn_deg * rng.choice([-1, 1])])
    return {"shift_m": size_m * direction / np.linalg.norm(direction), "turn_rad": turn}


def drift_vector(rng: np.random.Generator, size_m: float = 2e-3) -> np.ndarray:
    """A drift of this size in any direction."""
    direction = rng.normal(size=3)
    return size_m * direction / np.linalg.norm(direction)

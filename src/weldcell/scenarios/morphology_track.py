"""A seam followed by P1's morphological point, in the very pictures that the joint's finder works on.

The point's pixel is triangulated like any other. It lies on the bridge between the groove's edges, so what it estimates
is the line midway between them, level with the surface: there P1 sends the torch. How far that is from the groove's own
centre line, across the seam, is reported as well.
"""

from dataclasses import dataclass, field
from functools import partial

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadInput, JobFailed
from weldcell.cell.seam import distance_to_polyline, nearest_on_polyline
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.seam_tracking import TrackedSeam, exact_seam_base, tips_along, track_seam
from weldcell.scenarios.station import Sight, Station
from weldcell.tracking.morphology import seam_point
from weldcell.tracking.seam_fit import fit_seam

_STEPS_EVERY = 25
_FORGOTTEN_AFTER = 20  # pictures without a point: then it may be anywhere again
_METRIC = "seam_centre_morphological"


@dataclass(kw_only=True, eq=False)
class MorphologyWatch:
    """The morphological points of the pictures seen so far, each looked for near the last one."""

    points_px: list[Float[np.ndarray, "2"]] = field(default_factory=list)
    """(u, v); NaN where there is none."""
    _last_px: Float[np.ndarray, "2"] | None = None
    _missing: int = 0

    def look(self, station: Station, sight: Sight) -> None:
        """Takes the next picture; every 25th one's steps go into the recording."""
        if sight.shot.image is None:
            raise BadInput("sensor.profile_only: found true, expected false: P1's morphology needs pictures")
        near_px = self._last_px if self._missing < _FORGOTTEN_AFTER else None
        found = seam_point(sight.shot.image, along=station.config.sensor.stripe_along, near_px=near_px)
        self._missing = 0 if found.valid else self._missing + 1
        self._last_px = found.point_px if found.valid else self._last_px
        if len(self.points_px) % _STEPS_EVERY == 0:
            station.recording.log_steps(vars(found.steps), found.point_px, frame=sight.frame, time_s=sight.shot.time_s)
        self.points_px.append(found.point_px)


def track_both(station: Station, alignment: Alignment) -> tuple[TrackedSeam, MorphologyWatch]:
    """The seam as `track_seam` finds it, and the morphological points of the same pictures."""
    drawn = station.parts.plate.seam_part
    if drawn is None or not {"left", "right"} <= set(drawn.points):
        raise BadInput(f"seam.joint: found {station.config.seam.joint}, expected a joint with a left and a right edge")
    watch = MorphologyWatch()
    return track_seam(station, alignment, watch=partial(watch.look, station)), watch


def morphology_metrics(
    station: Station, tracked: TrackedSeam, alignment: Alignment, watch: MorphologyWatch
) -> dict[str, float | None]:
    """Torch errors of the seam fitted to the morphological points, and the sensor's own in single pictures."""
    points_px = np.array(watch.points_px)
    valid = np.isfinite(points_px).all(axis=1)
    rays_camera = station.belief.camera.unproject(points_px)
    points_camera = alignment.corrected(station.belief.plane.intersect(rays_camera), station.belief)
    exact = exact_seam_base(station)
    midway = (exact["left"] + exact["right"]) / 2
    tips_base = _tips_base(station, tracked, alignment, points_camera)
    by_torch = np.full(len(valid), np.nan) if tips_base is None else 1e3 * distance_to_polyline(tips_base, midway)
    lateral = np.full(len(valid), np.nan) if tips_base is None else 1e3 * _lateral_m(tips_base, exact)
    errors_mm = {"centre by morphology": by_torch, "centre by morphology, lateral": lateral}
    station.recording.log_errors(tracked.frames, tracked.times_s, errors_mm)
    seen_base = tracked.T_base_camera_actual.apply(points_camera)[valid]
    by_sensor = 1e3 * distance_to_polyline(seen_base, midway) if valid.any() else np.array([np.nan])
    metrics: dict[str, float | None] = {"frames_morphological_valid_count": float(valid.sum())}
    for kind, errors in (("", by_torch), ("lateral_", lateral), ("sensor_", by_sensor)):
        metrics[f"{_METRIC}_{kind}mean_error_mm"] = float(errors.mean())
        metrics[f"{_METRIC}_{kind}max_error_mm"] = float(errors.max())
    return metrics


def _tips_base(
    station: Station, tracked: TrackedSeam, alignment: Alignment, points_camera: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"] | None:
    """Where the actual tip goes when it is sent along the seam fitted to these points; None if they give no seam."""
    T_base_camera = tracked.T_base_flange * alignment.T_flange_camera
    try:
        seam = fit_seam({"centre": T_base_camera.apply(points_camera)})
    except JobFailed as failure:
        station.note(f"morphology: {failure}")
        return None
    station.recording.log_lines("by morphology", seam.points, frame=station.frame, time_s=station.time_s)
    places_m = np.linspace(seam.arc_length_m[0], seam.arc_length_m[-1], len(points_camera))
    return tips_along(station, tracked, alignment, seam.at("centre", places_m), "morphology")


def _lateral_m(
    points_base: Float[np.ndarray, "n 3"], exact: dict[str, Float[np.ndarray, "m 3"]]
) -> Float[np.ndarray, "n"]:
    """How far points are to either side of the groove's exact centre line, whatever their height."""
    left, right = exact["left"], exact["right"]
    centre = next((exact[name] for name in ("centre", "root") if name in exact), (left + right) / 2)
    feet = nearest_on_polyline(points_base, centre)
    rows = np.linalg.norm(feet[:, None] - centre, axis=2).argmin(axis=1)
    sideways = (left - right)[rows]
    sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
    return np.abs(np.einsum("ni,ni->n", points_base - feet, sideways))

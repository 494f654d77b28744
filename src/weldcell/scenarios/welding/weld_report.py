"""What a weld missed by: the actual tip against the exact seam on the part as it lay then."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.scenarios.station import Station
from weldcell.scenarios.welding.lookout import Lookout
from weldcell.scenarios.welding.moving_part import MovingPart
from weldcell.scenarios.welding.torch_path import TorchPath
from weldcell.scenarios.welding.weld_pass import WeldTrace
from weldcell.tracking.taught_path import TaughtPath

STOPS = ("end", "lost", "gap-closed", "out-of-reach")


@dataclass(frozen=True, kw_only=True)
class WeldErrors:
    """Errors of the actual tip at the ticks of the weld."""

    arc_length_m: Float[np.ndarray, "n"]
    """Of the exact seam, where the tip was."""
    lateral_m: Float[np.ndarray, "n"]
    """To the left of where it belongs (weave included)."""
    vertical_m: Float[np.ndarray, "n"]
    """Above it."""


def weld_errors(trace: WeldTrace, exact: TaughtPath, path: TorchPath) -> WeldErrors:
    """Errors over all ticks of the trace; NaN where the arc did not burn or the tip was beyond the seam's ends."""
    arc_length_m, lateral_m, vertical_m = exact.project(trace.tips())
    counts = trace.welded() & (arc_length_m >= exact.start_m) & (arc_length_m <= exact.end_m)
    return WeldErrors(
        arc_length_m=np.where(counts, arc_length_m, np.nan),
        lateral_m=np.where(counts, lateral_m - np.array(trace.weave_m), np.nan),
        vertical_m=np.where(counts, vertical_m - path.height_m, np.nan),
    )


def weld_metrics(
    trace: WeldTrace, errors: WeldErrors, exact: TaughtPath, path: TorchPath, lookout: Lookout
) -> dict[str, float | None]:
    """The errors in short, and how the weld ended."""
    metrics: dict[str, float | None] = {}
    for name, values_m in (("lateral", errors.lateral_m), ("vertical", errors.vertical_m)):
        sizes_mm = 1e3 * np.abs(values_m[np.isfinite(values_m)])
        metrics[f"torch_{name}_mean_error_mm"] = float(sizes_mm.mean()) if len(sizes_mm) else None
        metrics[f"torch_{name}_max_error_mm"] = float(sizes_mm.max()) if len(sizes_mm) else None
    metrics["seam_lost_count"] = float(trace.stop_kind in ("lost", "gap-closed"))
    metrics["pictures_count"] = float(lookout.on_seam)
    metrics["pictures_valid_count"] = float(lookout.valid)
    metrics["pictures_lost_count"] = float(lookout.lost)
    welded = trace.welded()
    last_part = trace.tips()[-1:] if welded.any() else np.full((1, 3), np.nan)
    reached_m = float(exact.project(last_part)[0][0]) if welded.any() else 0.0
    metrics["welded_length_mm"] = 1e3 * max(0.0, min(reached_m, exact.end_m) - exact.start_m) if welded.any() else 0.0
    if trace.stop_kind == "end":
        metrics["seam_end_error_mm"] = 1e3 * abs(reached_m - exact.end_m) if welded.any() else None
    metrics["stop_overrun_mm"] = 1e3 * max(0.0, trace.stopped_at_m - trace.trouble_at_m)
    for kind in STOPS:
        metrics[f"stop_{kind.replace('-', '_')}_count"] = float(trace.stop_kind == kind)
    return metrics


def record_weld(station: Station, trace: WeldTrace, errors: WeldErrors, part: MovingPart) -> None:
    """The errors as curves over time, and the exact seam as the part lay at the end."""
    ticks = trace.frame_ticks()
    frames, times_s = np.array(trace.frames)[ticks], np.array(trace.times_s)[ticks]
    curves_mm = {"lateral": 1e3 * errors.lateral_m[ticks], "vertical": 1e3 * errors.vertical_m[ticks]}
    station.recording.log_errors(frames, times_s, curves_mm)
    T_base_part = part.T_base_part(trace.arc_off_s - trace.arc_on_s if not np.isnan(trace.arc_on_s) else 0.0)
    (line_part,) = part.seam_part.points.values()
    welded_base = T_base_part.apply(trace.tips()[trace.welded()])
    lines = {"torch": welded_base} if len(welded_base) > 1 else {}
    station.recording.log_lines(
        "true", {"seam": T_base_part.apply(line_part)}, frame=station.frame, time_s=trace.arc_off_s
    )
    station.recording.log_lines("welded", lines, frame=station.frame, time_s=trace.arc_off_s)

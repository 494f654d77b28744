"""Which views a recording opens with, and from where they look."""

import numpy as np
import rerun.blueprint as rrb
from jaxtyping import Float

from weldcell.scenarios.recording.contents import Contents, StageContents
from weldcell.scenarios.recording.meshes import entity_name
from weldcell.scenarios.recording.sensor import PICTURE, SENSOR
from weldcell.scenarios.recording.shots import STEPS

RESULTS = "results"
GUIDE = "guide"

_BACKGROUND = (30, 32, 36, 255)
_CELL_EYE_BASE = np.array([1.98, -1.42, 1.27])
_CELL_TARGET_BASE = np.array([0.66, 0.04, 0.40])
_STAGE_EYE_DIRECTION = np.array([0.72, -0.52, 0.46])  # from the side that the arm, standing at the origin, leaves free
_STAGE_EYE_NEAREST_M = 0.28
_PLAYBACK = 2.0  # times real time
_TIMELINES = ("frame", "t")
_RECENT_FRAMES, _RECENT_S = 60, 4.0


def blueprint(contents: Contents) -> rrb.Blueprint:
    """The layout: a tab for the whole cell, one for each stage, one for the texts and events."""
    stages = [stage for stage in contents.stages.values() if stage.shown]
    tabs: list[rrb.Container | rrb.View] = [_overview(contents, stages)]
    tabs += [_stage_tab(contents, stage) for stage in stages]
    if contents.steps:
        tabs.append(_steps(contents))
    tabs.append(_report(contents))
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0, name=contents.title),
        rrb.TimePanel(state="collapsed", timeline="t", playback_speed=_PLAYBACK, play_state="playing"),
        collapse_panels=True,
    )


def _overview(contents: Contents, stages: list[StageContents]) -> rrb.Container:
    scene = _scene("The cell", ["+ /points/**"], _recent(stages), _CELL_EYE_BASE, _CELL_TARGET_BASE)
    below = [_page(RESULTS if RESULTS in contents.texts else GUIDE)]
    if any(stage.series for stage in stages):
        below.append(_errors("errors"))
    left = rrb.Vertical(scene, rrb.Horizontal(*below), row_shares=[5, 3])
    right = [*_sensor_views(contents), rrb.StateTimelineView(origin="/stage", name="Stages")]
    shares = [5, 4, 1] if len(right) == 3 else [1]
    return rrb.Horizontal(left, rrb.Vertical(*right, row_shares=shares), column_shares=[5, 3], name="Overview")


def _stage_tab(contents: Contents, stage: StageContents) -> rrb.Container:
    entities = [f"+ /{kind}/{stage.name}/**" for kind in ("points", "lines", "checks")]
    if not stage.shots:
        entities.append(f"- /{SENSOR}/light")
    scene = _scene(f"{stage.title}: points in the robot base", entities, _all_so_far(stage), *_stage_eye(stage))
    side: list[rrb.View] = _sensor_views(contents) if stage.shots else []
    if stage.series:
        side.append(_errors(f"errors/{stage.name}"))
    if stage.events:
        side.append(_events())
    if not side:
        return rrb.Horizontal(scene, name=stage.title)
    return rrb.Horizontal(scene, rrb.Vertical(*side), column_shares=[5, 3], name=stage.title)


def _steps(contents: Contents) -> rrb.Container:
    """A picture's processing, step by step."""
    views = [
        rrb.Spatial2DView(origin=f"/{STEPS}/{name}", name=f"{number}. {name}", background=_BACKGROUND)
        for number, name in enumerate(map(entity_name, contents.steps), start=1)
    ]
    return rrb.Grid(*views, name="Image processing")


def _report(contents: Contents) -> rrb.Container:
    return rrb.Horizontal(*[_page(name) for name in contents.texts], _events(), name="Report")


def _events() -> rrb.View:
    columns = rrb.TextLogColumns(timeline_columns=["frame"], text_log_columns=["LogLevel", "Body"])
    return rrb.TextLogView(origin="/events", name="Events", columns=columns)


def _page(name: str) -> rrb.View:
    return rrb.TextDocumentView(origin=f"/texts/{name}", name=name.capitalize())


def _scene(
    name: str,
    entities: list[str],
    ranges: dict[str, rrb.VisibleTimeRanges],
    eye_base: Float[np.ndarray, "3"],
    target_base: Float[np.ndarray, "3"],
) -> rrb.View:
    """The cell with some more entities, seen from a place (m)."""
    return rrb.Spatial3DView(
        origin="/",
        name=name,
        contents=["+ /cell/**", f"- /{PICTURE}/**", *entities],
        background=_BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=eye_base, look_target=target_base, eye_up=(0.0, 0.0, 1.0)),
        overrides=ranges,
    )


def _all_so_far(stage: StageContents) -> dict[str, rrb.VisibleTimeRanges]:
    """For each of the stage's entities everything from the beginning to the cursor."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    ranges = [rrb.VisibleTimeRange(timeline, start=start, end=end) for timeline in _TIMELINES]
    return {entity: rrb.VisibleTimeRanges(ranges) for entity in sorted(stage.accumulated)}


def _recent(stages: list[StageContents]) -> dict[str, rrb.VisibleTimeRanges]:
    """For each entity only the last moments: the part that it was measured on may be gone a while later."""
    now = rrb.TimeRangeBoundary.cursor_relative()
    ranges = [
        rrb.VisibleTimeRange("frame", start=rrb.TimeRangeBoundary.cursor_relative(seq=-_RECENT_FRAMES), end=now),
        rrb.VisibleTimeRange("t", start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_RECENT_S), end=now),
    ]
    return {entity: rrb.VisibleTimeRanges(ranges) for stage in stages for entity in sorted(stage.accumulated)}


def _sensor_views(contents: Contents) -> list[rrb.View]:
    if contents.picture_px is None or contents.range_mm is None:
        return []
    width, height = contents.picture_px
    low, high = np.nanmin(contents.range_mm, axis=0), np.nanmax(contents.range_mm, axis=0)
    margin = 0.06 * (high - low)
    picture = rrb.Spatial2DView(
        origin=f"/{PICTURE}",
        name="Camera picture, stripe and features",
        visual_bounds=rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height)),
        background=_BACKGROUND,
    )
    profile = rrb.Spatial2DView(
        origin="/profile",
        name="Profile in the light plane [mm], deeper is lower",
        visual_bounds=rrb.VisualBounds2D(
            x_range=(low[0] - margin[0], high[0] + margin[0]), y_range=(low[1] - margin[1], high[1] + margin[1])
        ),
        background=_BACKGROUND,
    )
    return [picture, profile]


def _errors(origin: str) -> rrb.View:
    legend = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
    return rrb.TimeSeriesView(origin=f"/{origin}", name="Errors over time [mm]", plot_legend=legend)


def _stage_eye(stage: StageContents) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Where to look from and at, so that the stage's points fill the view."""
    if not stage.bounded:
        return _CELL_EYE_BASE, _CELL_TARGET_BASE
    target_base = (stage.low_base + stage.high_base) / 2
    extent_m = float(np.linalg.norm(stage.high_base - stage.low_base))
    return target_base + max(_STAGE_EYE_NEAREST_M, 1.5 * extent_m) * _STAGE_EYE_DIRECTION, target_base

"""Everything of a run that a person can review, written as one rerun file with its layout.

Entities: `cell/BODY` (meshes; what moves has a pose for each moment), `cell/sensor` (camera, picture, light sheet),
`points/STAGE` (what was measured, in the base), `lines/STAGE`, `checks/STAGE`, `errors/STAGE`, `profile` (the last
profile, in the light plane), `steps/NAME` (a picture's processing), `texts`, `events`, `stage`. Timelines: `frame`
(number of the picture or touch) and `t` (seconds).
"""

from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np
import rerun as rr
from jaxtyping import Float, Int, UInt8
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import RecordingConfig
from weldcell.cell.errors import JobFailed, NotReady
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import JointFeatures, Profile, Shot, Stripe
from weldcell.scenarios.recording import palette, shots
from weldcell.scenarios.recording.blueprint import blueprint
from weldcell.scenarios.recording.bodies import Bodies
from weldcell.scenarios.recording.contents import Contents, StageContents
from weldcell.scenarios.recording.guide import GUIDE
from weldcell.scenarios.recording.meshes import entity_name
from weldcell.scenarios.recording.motion import MotionLog
from weldcell.scenarios.recording.sensor import DrawnSensor
from weldcell.scenarios.recording.stream import Stream

_ARROW_M = 0.05  # length at which the largest point error is drawn
_TRUE = "true"


class Recording:
    """Writes one recording; without effect if the configuration wants none.

    The file appears under its name when the recording is closed. If the block ends with an error, nothing is left,
    except after `JobFailed`: a run that failed its acceptance deserves a look.
    """

    def __init__(self, path: Path, config: RecordingConfig, *, title: str) -> None:
        self.config, self._contents = config, Contents(title=title)
        self._stage = StageContents(name="run", title=title)
        self._contents.stages["run"] = self._stage
        self._motion: MotionLog | None = None
        self._drawn_sensor: DrawnSensor | None = None
        self._shots = 0
        self._stream = Stream(Path(path), title) if config.enabled else None
        if self._stream:
            self._stream.keep("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP)

    def __enter__(self) -> "Recording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or isinstance(error, JobFailed):
            self.close()
        else:
            self.discard()

    @property
    def enabled(self) -> bool:
        """Whether anything is written (if not, there is no need to gather it)."""
        return self._stream is not None

    def close(self) -> None:
        """Lays out the views and finishes the file; raises WeldcellError if it is not whole."""
        if self._stream:
            try:
                if self._motion:
                    self._motion.flush()
                self.log_text("guide", GUIDE)
                layout = blueprint(self._contents)
            except BaseException:
                self.discard()
                raise
            stream, self._stream = self._stream, None
            stream.close(layout)

    def discard(self) -> None:
        """Leaves no file."""
        if self._stream:
            stream, self._stream = self._stream, None
            stream.discard()

    def begin_stage(self, name: str, title: str, *, frame: int, time_s: float) -> None:
        """From now on everything belongs to this stage, which gets its own tab, called `title`."""
        if self._stream:
            self._stream.log(frame, time_s, "stage", rr.StateChange(state=title))
            self.log_event(f"Stage: {title}", frame=frame, time_s=time_s)
            self._stage = self._contents.stages.setdefault(name, StageContents(name=entity_name(name), title=title))

    def log_cell(self, model: mujoco.MjModel) -> None:
        """The meshes of all visible geoms, and the model's bodies for `log_pose`."""
        if self._stream:
            bodies = Bodies.of(model)
            for entity, what in bodies.drawn():
                self._stream.keep(entity, what)
            self._motion = MotionLog(bodies, self._stream)
            start = mujoco.MjData(model)
            mujoco.mj_kinematics(model, start)
            self.log_pose(0, 0.0, start)  # else everything that moves lies at the origin until it does

    def log_sensor(
        self,
        *,
        camera: CameraModel,
        plane: LaserPlane,
        source_camera: Float[np.ndarray, "3"],
        fan_rad: float,
        site: str = "sensor/camera",
    ) -> None:
        """The camera at a site of the cell (axes as in OpenCV) and its light sheet; they move with the site's body."""
        if self._stream:
            body, T_body_camera = self._motion_log().bodies.site(site)
            sensor = DrawnSensor(
                body=body,
                T_body_camera=T_body_camera,
                camera=camera,
                plane=plane,
                source_camera=source_camera,
                fan_rad=fan_rad,
            )
            for entity, what in sensor.drawn():
                self._stream.keep(entity, what)
            self._drawn_sensor = self._motion_log().sensor = sensor
            self._contents.picture_px = camera.width_px, camera.height_px
            self._contents.range_mm = sensor.range_mm

    def log_pose(self, frame: int, time_s: float, data: mujoco.MjData) -> None:
        """Where all bodies stand at this moment (`xpos` and `xmat` of the model given to `log_cell`).

        A moment between two pictures carries the number of the picture that it leads to: on the `frame` timeline
        the last row of a number is seen, which then is the pose that the picture was taken from.
        """
        if self._stream:
            self._motion_log().add(frame, time_s, data)

    def log_shot(
        self,
        frame: int,
        shot: Shot,
        *,
        T_base_camera: RigidTransform,
        stripe: Stripe | None = None,
        profile: Profile | None = None,
        joint: JointFeatures | None = None,
    ) -> None:
        """One picture and what was found in it; `T_base_camera` is what the pipeline believes.

        Every `picture_every`-th picture is kept, as JPEG, with every twelfth stripe centre drawn on it; of the
        profiles every second point.
        """
        if not self._stream:
            return
        sensor = self._sensor()
        if self._shots % self.config.picture_every == 0:
            for entity, what in shots.drawn_picture(shot.image, self.config.jpeg_quality, stripe, joint, sensor):
                self._stream.log(frame, shot.time_s, entity, what)
        for entity, what in shots.drawn_profile(profile, joint, sensor):
            self._stream.log(frame, shot.time_s, entity, what)
        for name, points_base, what in shots.drawn_in_base(profile, joint, T_base_camera, sensor):
            self._accumulate(frame, shot.time_s, name, points_base, what)
        if joint is not None and not joint.valid:
            self.log_event(f"no joint found: {joint.reason}", frame=frame, time_s=shot.time_s, warning=True)
        self._shots += 1
        self._stage.shots += 1

    def log_steps(
        self,
        pictures: Mapping[str, UInt8[np.ndarray, "h w"]],
        point_px: Float[np.ndarray, "2"],
        *,
        frame: int,
        time_s: float,
    ) -> None:
        """What became of one picture step by step, by name, and the point that was found; all in a tab of their own."""
        if self._stream:
            for name, picture in pictures.items():
                for entity, what in shots.drawn_step(entity_name(name), picture, self.config.jpeg_quality, point_px):
                    self._stream.log(frame, time_s, entity, what)
            self._contents.steps = list(pictures)

    def log_touch(self, tip_base: Float[np.ndarray, "3"], *, frame: int, time_s: float) -> None:
        """The torch tip at one touch (m); all touches so far stay in view."""
        if self._stream:
            point_base = np.reshape(tip_base, (1, 3))
            point = rr.Points3D(point_base, colors=palette.TOUCH, radii=7e-4)
            self._accumulate(frame, time_s, "touches", point_base, point)

    def log_lines(
        self, kind: str, lines_base: Mapping[str, Float[np.ndarray, "n 3"]], *, frame: int, time_s: float
    ) -> None:
        """Lines in the base (m), seen from this moment on; `kind` is `true` (drawn thin and white), `measured`, ..."""
        if not self._stream:
            return
        colours = palette.named_colours(list(lines_base))
        for (name, line_base), colour in zip(lines_base.items(), colours, strict=True):
            line_base = line_base[np.isfinite(line_base).all(axis=1)]
            self._stage.enclose(line_base)
            style = (palette.TRUE, 0.8) if kind == _TRUE else (colour, 1.6)
            strip = rr.LineStrips3D([line_base], colors=style[0], radii=rr.Radius.ui_points(style[1]))
            entity = f"lines/{self._stage.name}/{entity_name(kind)}/{entity_name(name)}"
            self._stream.log(frame, time_s, entity, strip)

    def log_errors(
        self,
        frames: Int[np.ndarray, "n"],
        times_s: Float[np.ndarray, "n"],
        errors_mm: Mapping[str, Float[np.ndarray, "n"]],
    ) -> None:
        """Errors over time as the plot of the stage, one curve a name; NaN leaves a gap."""
        if not self._stream:
            return
        frames, times_s = np.asarray(frames, np.int64), np.asarray(times_s, float)
        colours = palette.named_colours(list(errors_mm))
        for (name, values_mm), colour in zip(errors_mm.items(), colours, strict=True):
            entity = f"errors/{self._stage.name}/{entity_name(name)}_mm"
            self._stream.keep(entity, rr.SeriesLines(colors=colour, names=f"{name} [mm]", widths=1.5))
            columns = rr.Scalars.columns(scalars=np.asarray(values_mm, float))
            self._stream.log_columns(frames, times_s, entity, columns)
        self._stage.series += len(errors_mm)

    def log_points(
        self,
        true_base: Mapping[str, Float[np.ndarray, "3"]],
        measured_base: Mapping[str, Mapping[str, Float[np.ndarray, "n 3"]]],
        *,
        frame: int,
        time_s: float,
    ) -> None:
        """Exact points by name (m), and how far off each kind of measurement (`before`, `after`) found them.

        `measured_base[kind][name]` holds one row for each viewpoint; the errors are drawn as magnified arrows.
        """
        if not self._stream:
            return
        errors = [
            (kind, name, np.atleast_2d(points) - true_base[name])
            for kind, by_name in measured_base.items()
            for name, points in by_name.items()
        ]
        largest_m = max((np.linalg.norm(vectors, axis=1).max() for _, _, vectors in errors), default=_ARROW_M)
        factor = _round_down(_ARROW_M / max(float(largest_m), 1e-9))
        places = np.array(list(true_base.values()), float).reshape(-1, 3)
        labels = [f"{name} (errors x{factor:g})" for name in true_base]
        self._stage.enclose(places)
        points = rr.Points3D(places, colors=palette.TRUE, radii=2e-3, labels=labels, show_labels=True)
        self._stream.log(frame, time_s, f"checks/{self._stage.name}/{_TRUE}", points)
        colours = dict(zip(measured_base, palette.named_colours(list(measured_base)), strict=True))
        for kind, name, vectors in errors:
            origins = np.broadcast_to(true_base[name], vectors.shape)
            arrows = rr.Arrows3D(vectors=factor * vectors, origins=origins, colors=colours[kind], radii=6e-4)
            entity = f"checks/{self._stage.name}/{entity_name(kind)}/{entity_name(name)}"
            self._stream.log(frame, time_s, entity, arrows)

    def log_text(self, name: str, markdown: str) -> None:
        """A page of text; the page `results` stands beside the view of the whole cell."""
        if self._stream:
            name = entity_name(name)
            self._stream.keep(f"texts/{name}", rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN))
            if name not in self._contents.texts:
                self._contents.texts.append(name)

    def log_event(self, text: str, *, frame: int, time_s: float, warning: bool = False) -> None:
        """One line in the list of events."""
        if self._stream:
            level = rr.TextLogLevel.WARN if warning else rr.TextLogLevel.INFO
            self._stream.log(frame, time_s, "events", rr.TextLog(text, level=level))
            self._stage.events += 1

    def _accumulate(
        self, frame: int, time_s: float, name: str, points_base: Float[np.ndarray, "n 3"], what: rr.AsComponents
    ) -> None:
        """Writes one moment's part of something that is seen as a whole."""
        assert self._stream
        entity = f"points/{self._stage.name}/{name}"
        self._stage.accumulated.add(entity)
        self._stage.enclose(points_base)
        self._stream.log(frame, time_s, entity, what)

    def _motion_log(self) -> MotionLog:
        if self._motion is None:
            raise NotReady("recording: log_cell has to come before log_sensor and log_pose")
        return self._motion

    def _sensor(self) -> DrawnSensor:
        if self._drawn_sensor is None:
            raise NotReady("recording: log_sensor has to come before log_shot")
        return self._drawn_sensor


def _round_down(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten that does not exceed the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)))

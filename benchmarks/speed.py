"""Where the time of a frame goes, against primitives measured in the same run, and the time of the whole job."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from benchmarks.table import Figure
from benchmarks.timing import Stopwatch
from weldcell.cell.configuration import CellConfig, SeamConfig
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.scanning import scan
from weldcell.scenarios.seam_tracking import taught_path
from weldcell.scenarios.station import Station
from weldcell.sensor_sim.ambient import AmbientRenderer
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.light_section import light_section
from weldcell.tracking.joint import find_joint
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate

FRAMES = 40
RANDN_ADD, THRESHOLD = "cv2.randn and cv2.add", "cv2.adaptiveThreshold 31x31"
DRAWING, NOISE, EXTRACTION = "stripe drawing", "speckle, noise and 8 bits", "stripe extraction"
PICTURE_MODE, PROFILE_MODE = "picture mode, pose to stripe", "profile-only mode, pose to stripe"


def frame_times(frames: int = FRAMES) -> dict[str, float]:
    """Median milliseconds of each step of a V-groove frame, and of the primitives that they are compared with."""
    config = CellConfig(robot="perfect", seam=SeamConfig(frames=frames))
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.rrd"
        with (
            Recording(path, config.recording, title="benchmark") as recording,
            Station(config, 1, recording, Progress()) as station,
            AmbientRenderer(station.cell.model, station.sensor.camera, 1.0) as ambient,
        ):
            station.place_plate()
            for index, sight in enumerate(scan(station, taught_path(station), "seam")):
                image = _one_frame(watch, station, ambient, index)
                _primitives(watch, image)
                watch.run("recording", lambda sight=sight: station.log_sight(sight, station.head.T_flange_camera))
    return watch.medians_ms()


def _one_frame(watch: Stopwatch, station: Station, ambient: AmbientRenderer, index: int) -> np.ndarray:
    sensor, data, T_base_camera = station.sensor, station.cell.data, station.cell.T_base("camera")
    camera, belief, rng = sensor.camera, station.belief, np.random.default_rng(index)
    section = watch.run("rays", lambda: light_section(sensor.caster, data, T_base_camera, camera, sensor.fan))
    pieces = watch.run("stripe pieces", lambda: sensor.pieces(section))
    watch.run("ambient picture", lambda: ambient.render(data, T_base_camera))
    light = watch.run("all light", lambda: sensor.light(data, T_base_camera))
    watch.run(DRAWING, lambda: draw_stripe(light.stripe, camera.width_px, camera.height_px))
    image = watch.run(NOISE, lambda: sensor.picture(light, rng))
    stripe = watch.run(EXTRACTION, lambda: find_stripe(image))
    profile = watch.run("triangulation", lambda: triangulate(stripe, belief.camera, belief.plane))
    watch.run("joint features", lambda: find_joint(profile, "v", belief.plane))
    watch.run(PICTURE_MODE, lambda: find_stripe(sensor.capture(data, T_base_camera, rng)))
    watch.run(PROFILE_MODE, lambda: sensor.profile(data, T_base_camera, rng))
    assert len(pieces.cut_px) > 0
    return image


def _primitives(watch: Stopwatch, image: np.ndarray) -> None:
    values = np.empty(image.shape, np.float32)
    watch.run(RANDN_ADD, lambda: cv2.add(cv2.randn(values, 0, 1), values))
    watch.run(
        THRESHOLD, lambda: cv2.adaptiveThreshold(image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, 31, -5)
    )


def figures(times_ms: dict[str, float]) -> list[Figure]:
    """Our steps against the primitives of the same run, and the two modes against each other."""
    return [
        Figure(
            name=f"noisy picture (drawing, speckle, noise, 8 bits) over {RANDN_ADD}",
            value=(times_ms[DRAWING] + times_ms[NOISE]) / times_ms[RANDN_ADD],
            at_most=2,
        ),
        Figure(name=f"stripe extraction over {THRESHOLD}", value=times_ms[EXTRACTION] / times_ms[THRESHOLD], at_most=1),
        Figure(
            name="profile-only mode's frames for one of picture mode",
            value=times_ms[PICTURE_MODE] / times_ms[PROFILE_MODE],
            at_least=5,
        ),
    ]


def whole_job_s() -> float:
    """Wall time of `weldcell run commission`, start-up included."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        command = [sys.executable, "-m", "weldcell", "run", "commission", "--out", f"{folder}/run"]
        subprocess.run(command, check=True, capture_output=True)
        return time.perf_counter() - begin

"""Where the time of a frame goes, against primitives measured in the same run, and the time of the whole job."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import mujoco
import numpy as np

from benchmarks.timing import Stopwatch
from weldcell.cell.configuration import CellConfig, SeamConfig
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.scanning import scan
from weldcell.scenarios.seam_tracking import taught_path
from weldcell.scenarios.station import Station
from weldcell.sensor_sim.ambient import AmbientRenderer
from weldcell.sensor_sim.chip import camera_chip, expose
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.laser import laser_fan
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import irradiance, light_reference
from weldcell.sensor_sim.speckle import nominal_speckle, with_speckle
from weldcell.sensor_sim.stripe import stripe_optics, stripe_pieces
from weldcell.tracking.joint import find_joint
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate

FRAMES = 40


def frame_times(frames: int = FRAMES) -> dict[str, float]:
    """Median milliseconds of each step of a V-groove frame, and of the primitives that they are compared with."""
    config = CellConfig(robot="perfect", seam=SeamConfig(frames=frames))
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.rrd"
        with (
            Recording(path, config.recording, title="benchmark") as recording,
            Station(config, 1, recording, Progress()) as station,
        ):
            station.place_plate()
            parts = _Parts(station)
            for index, sight in enumerate(scan(station, taught_path(station), "seam")):
                _one_frame(watch, station, parts, index)
                watch.run("recording", lambda sight=sight: station.log_sight(sight, station.drawing_T_flange_camera))
            parts.ambient.close()
    return watch.medians_ms()


class _Parts:
    """The sensor taken apart."""

    def __init__(self, station: Station) -> None:
        sensor = station.config.sensor
        self.camera, plane = nominal_camera(sensor), nominal_plane(sensor)
        self.fan = laser_fan(sensor, plane, nominal_source_camera(sensor))
        self.reference = light_reference(self.fan)
        self.optics = stripe_optics(sensor, self.camera, self.fan)
        self.speckle, self.chip = nominal_speckle(sensor), camera_chip(sensor)
        self.caster = RayCaster(station.cell.model)
        self.ambient = AmbientRenderer(station.cell.model, self.camera, sensor.ambient_grey)


def _one_frame(watch: Stopwatch, station: Station, parts: _Parts, index: int) -> None:
    data, T_base_camera, camera = station.cell.data, station.cell.T_base("camera"), parts.camera
    rng = np.random.default_rng(index)
    section = watch.run("rays", lambda: light_section(parts.caster, data, T_base_camera, camera, parts.fan))
    brightness = irradiance(section, parts.fan.power_ratio, parts.reference)
    pieces = watch.run("stripe pieces", lambda: stripe_pieces(section, brightness, camera, parts.optics))
    ambient = watch.run("ambient picture", lambda: parts.ambient.render(data, T_base_camera))
    light = watch.run("stripe drawing", lambda: draw_stripe(pieces, camera.width_px, camera.height_px))
    image = watch.run(
        "noise and 8 bits", lambda: expose(ambient, with_speckle(light, parts.speckle, rng), parts.chip, rng)
    )
    stripe = watch.run("stripe extraction", lambda: find_stripe(image))
    belief = station.belief
    profile = watch.run("triangulation", lambda: triangulate(stripe, belief.camera, belief.plane))
    watch.run("joint features", lambda: find_joint(profile, "v", belief.plane))
    _primitives(watch, station, parts, T_base_camera, image)


def _primitives(watch: Stopwatch, station: Station, parts: _Parts, T_base_camera, image: np.ndarray) -> None:
    origin = T_base_camera.apply(parts.fan.source_camera)
    directions = T_base_camera.rotation.apply(parts.fan.directions_camera)
    watch.run("two raw mj_multiRay", lambda: [_raw_rays(station, origin, directions) for _ in range(2)])
    values = np.empty(image.shape, np.float32)
    watch.run("cv2.randn and cv2.add", lambda: cv2.add(cv2.randn(values, 0, 1), values))
    watch.run(
        "cv2.adaptiveThreshold 31x31",
        lambda: cv2.adaptiveThreshold(image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, 31, -5),
    )


def _raw_rays(station: Station, origin: np.ndarray, directions: np.ndarray) -> None:
    count = len(directions)
    geoms, distances = np.zeros(count, np.int32), np.zeros(count)
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    flat = np.ascontiguousarray(directions).ravel()
    mujoco.mj_multiRay(
        station.cell.model, station.cell.data, origin, flat, groups, 1, -1, geoms, distances, None, count, 10.0
    )


RATIOS = {
    "rays over two raw mj_multiRay": ("rays", "two raw mj_multiRay"),
    "noise and 8 bits over cv2.randn and cv2.add": ("noise and 8 bits", "cv2.randn and cv2.add"),
    "stripe extraction over cv2.adaptiveThreshold": ("stripe extraction", "cv2.adaptiveThreshold 31x31"),
}


def ratios(times_ms: dict[str, float]) -> dict[str, float]:
    """Our steps over the primitives of the same run."""
    return {name: times_ms[ours] / times_ms[peer] for name, (ours, peer) in RATIOS.items()}


def whole_job_s() -> float:
    """Wall time of `weldcell run commission`, start-up included."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        command = [sys.executable, "-m", "weldcell", "run", "commission", "--out", f"{folder}/run"]
        subprocess.run(command, check=True, capture_output=True)
        return time.perf_counter() - begin

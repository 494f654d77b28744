"""Makes a data set: plates shared out to worker processes, each plate's files written as soon as they are known.

A plate with its frames is the unit of work. When its pictures, masks and labels stand, its stripe points and its rows
are left in the work folder: a plate that has both is done, and a run that was killed goes on with the others. What is
made depends on settings and seed alone.
"""

import json
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import pyarrow.parquet as pq

import weldcell
from weldcell.cell.errors import BadInput, WeldcellError
from weldcell.scenarios.atomic_file import write_bytes, write_text
from weldcell.scenarios.dataset import coco, yolo
from weldcell.scenarios.dataset.folder import (
    COCO,
    CONFIG,
    FRAMES,
    STRIPE,
    YOLO,
    DatasetFolder,
    State,
    dataset_folder,
    fingerprint,
)
from weldcell.scenarios.dataset.plan import PlatePlan, plan_frame, plate_of
from weldcell.scenarios.dataset.scene import build_plate
from weldcell.scenarios.dataset.table import frame_table, parquet
from weldcell.scenarios.dataset.worker import PlateTask, make_plate, read_plate, start_worker
from weldcell.scenarios.metrics_file import versions
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.settings import Settings
from weldcell.scenarios.yaml_file import write_yaml, yaml_text

MOST_FRAMES = 1_000_000

Layout = Literal["coco", "yolo"]

_GOES_ON = "the same command goes on with what is missing"


@dataclass(frozen=True, kw_only=True)
class DatasetRequest:
    """What the command line asks for."""

    settings: Settings
    count: int
    """Number of frames."""
    place: Path
    layout: Layout
    workers: int

    def __post_init__(self) -> None:
        if not 1 <= self.count <= MOST_FRAMES:
            raise BadInput(f"--count: found {self.count}, expected 1 to {MOST_FRAMES}")
        if not 1 <= self.workers <= 256:
            raise BadInput(f"--workers: found {self.workers}, expected 1 to 256")

    @property
    def identity(self) -> dict[str, Any]:
        """What decides on the data set's bytes, in plain values."""
        config = sha256(yaml_text(self.settings.as_mapping()).encode()).hexdigest()
        seed = self.settings.seed
        return {"count": self.count, "seed": seed, "format": self.layout, "config": config, "versions": versions()}


def make_dataset(request: DatasetRequest, progress: Progress, *, overwrite: bool = False) -> State:
    """What was found in the place, where the data set now is finished."""
    features = _check_ranges(request.settings)
    with dataset_folder(request.place, request.identity, overwrite=overwrite) as folder:
        if folder.state is not State.FINISHED:
            try:
                _make(request, folder, features, progress)
            except KeyboardInterrupt:
                raise KeyboardInterrupt(f"interrupted; {_GOES_ON}") from None
            except BrokenProcessPool as error:
                raise WeldcellError(f"a worker was ended from outside (out of memory?); {_GOES_ON}") from error
            except OSError as error:
                name = error.filename or str(request.place)
                raise OSError(error.errno, f"{error.strerror or error} ({_GOES_ON})", name) from error
        return folder.state


def _check_ranges(settings: Settings) -> tuple[str, ...]:
    """Names of the seam's features; refuses ranges whose widest groove or lowest sensor cannot be."""
    ranges = settings.config.dataset
    widest = PlatePlan(
        number=0,
        groove_angle_deg=ranges.groove_angle_deg[1],
        groove_depth_mm=ranges.groove_depth_mm[1],
        root_gap_mm=ranges.root_gap_mm[1] if ranges.root_gap_ratio else 0.0,
        amplitude_mm=ranges.amplitude_mm[1],
        material=ranges.materials[0],
        texture=ranges.textures[0],
        tack_spots=0,
        texture_seed=0,
    )
    seam = build_plate(settings.config, widest).seam_part
    assert seam is not None
    plan_frame(ranges, settings.config.sensor, settings.seed, 0)
    return tuple(seam.points)


def _make(request: DatasetRequest, folder: DatasetFolder, features: Sequence[str], progress: Progress) -> None:
    write_yaml(request.place / CONFIG, request.settings.as_mapping())
    tasks = _tasks(request, folder)
    missing = [task for task in tasks if read_plate(task) is None]
    done = request.count - sum(len(task.frames) for task in missing)
    with closing(_frames_made(missing, request.workers)) as made:
        for number in progress.track(range(request.count), "frames"):
            while number >= done:
                done += next(made)
    _finish(request, folder, tasks, features)


def _tasks(request: DatasetRequest, folder: DatasetFolder) -> list[PlateTask]:
    ranges = request.settings.config.dataset
    return [
        PlateTask(
            config=request.settings.config,
            seed=request.settings.seed,
            place=request.place,
            work=folder.work,
            layout=request.layout,
            plate=plate_of(ranges, first),
            frames=range(first, min(first + ranges.frames_per_plate, request.count)),
        )
        for first in range(0, request.count, ranges.frames_per_plate)
    ]


def _frames_made(tasks: Sequence[PlateTask], workers: int) -> Generator[int]:
    """The number of frames of each plate, as the plates are done."""
    if not tasks:
        return
    # Spawned, not forked: a renderer's threads and locks do not survive a fork.
    pool = ProcessPoolExecutor(min(workers, len(tasks)), mp_context=get_context("spawn"), initializer=start_worker)
    try:
        for done in as_completed([pool.submit(make_plate, task) for task in tasks]):
            yield done.result()
    finally:
        pool.shutdown(cancel_futures=True)  # what is being made is made, so that it is kept


def _finish(
    request: DatasetRequest, folder: DatasetFolder, tasks: Sequence[PlateTask], features: Sequence[str]
) -> None:
    """Writes what is one file for the whole set, and the manifest."""
    place = request.place
    plates = [plate for plate in map(read_plate, tasks) if plate is not None]
    rows = [row for plate in plates for row in plate["rows"]]
    write_bytes(place / FRAMES, parquet([frame_table(rows)]))
    write_bytes(place / STRIPE, parquet(pq.read_table(task.points_path) for task in tasks))
    if request.layout == "coco":
        annotations = [annotation for plate in plates for annotation in plate["annotations"]]
        pictures = [
            {"id": coco.picture_id(row["frame"]), "file_name": Path(row["file_name"]).name, "width": row["width_px"],
             "height": row["height_px"]}
            for row in rows
        ]  # fmt: skip
        content = coco.document(pictures, annotations, features, weldcell.__version__)
        write_text(place / COCO, json.dumps(content, allow_nan=False))
        last = COCO
    else:
        write_yaml(place / YOLO, yolo.description(features))
        last = YOLO
    files = {name: file for plate in plates for name, file in plate["files"].items()}
    files |= {name: fingerprint(place / name) for name in (CONFIG, FRAMES, STRIPE, last)}
    folder.finish(request.identity, files)

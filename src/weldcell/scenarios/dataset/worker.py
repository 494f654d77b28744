"""What a worker process does: all frames of a plate, and what the whole set needs to know of them."""

import json
import multiprocessing
import os
import signal
import threading
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pyarrow as pa
from jaxtyping import Shaped

from weldcell.cell.configuration import CellConfig
from weldcell.scenarios.atomic_file import write_bytes, write_text
from weldcell.scenarios.dataset import coco, yolo
from weldcell.scenarios.dataset.folder import file_names
from weldcell.scenarios.dataset.plan import plan_frame, plan_plate
from weldcell.scenarios.dataset.scene import PlateScene
from weldcell.scenarios.dataset.table import frame_row, parquet, stripe_table
from weldcell.sensor_sim.labels import FrameTruth

STRIPE, GHOST = 1, 2
"""Values in the mask pictures."""

_FAST_PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1)  # level 1 is twice as fast as the default, files are a tenth larger


@dataclass(frozen=True, kw_only=True)
class PlateTask:
    """One plate of a data set, and its frames."""

    config: CellConfig
    seed: int
    place: Path
    """The data set's folder."""
    work: Path
    """Where to leave what the whole set needs to know."""
    layout: Literal["coco", "yolo"]
    plate: int
    frames: range

    @property
    def points_path(self) -> Path:
        """The stripe points of the plate's frames."""
        return self.work / f"plate-{self.plate:05d}.parquet"

    @property
    def rows_path(self) -> Path:
        """Rows, annotations and files of the plate's frames; written last."""
        return self.work / f"plate-{self.plate:05d}.json"


def start_worker() -> None:
    """Prepares a process: one core for each, and no life of its own after the parent's."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    os.environ["LP_NUM_THREADS"] = "0"  # Mesa's software renderer draws in the calling thread
    cv2.setNumThreads(1)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def make_plate(task: PlateTask) -> int:
    """The number of frames made, after all that belongs to them is on the disk."""
    plate = plan_plate(task.config.dataset, task.seed, task.plate)
    points, rows, annotations = [], [], []
    files: dict[str, Any] = {}
    with PlateScene(task.config, plate, task.seed) as scene:
        for number in task.frames:
            plan = plan_frame(task.config.dataset, task.config.sensor, task.seed, number)
            picture, truth = scene.frame(plan)
            files |= _write_files(task, number, picture, truth)
            points.append(stripe_table(truth, number, scene.geom_names))
            rows.append(frame_row(truth, plan, plate, file_names(number)["images"]))
            annotations.append(coco.annotation(truth, number))
    write_bytes(task.points_path, parquet([pa.concat_tables(points)]))
    known = {"rows": rows, "annotations": [one for one in annotations if one is not None], "files": files}
    write_text(task.rows_path, json.dumps(known))
    return len(task.frames)


def read_plate(task: PlateTask) -> dict[str, Any] | None:
    """What `make_plate` left of a plate that is done; None if it is not, or if a file of it is gone."""
    try:
        known: dict[str, Any] = json.loads(task.rows_path.read_text(encoding="utf-8"))
        sizes = {name: (task.place / name).stat().st_size for name in known["files"]}
    except FileNotFoundError:
        return None
    whole = all(sizes[name] == file["bytes"] for name, file in known["files"].items())
    return known if whole and task.points_path.exists() else None


def mask_picture(truth: FrameTruth) -> Shaped[np.ndarray, "height width"]:
    """The mask as a picture; where stripe and ghost cross, the stripe counts."""
    mask = np.where(truth.ghost_mask, np.uint8(GHOST), np.uint8(0))
    mask[truth.stripe_mask] = STRIPE
    return mask


def _write_files(
    task: PlateTask, number: int, picture: Shaped[np.ndarray, "height width"], truth: FrameTruth
) -> dict[str, Any]:
    """Size and SHA-256 of each file of a frame, by name."""
    contents = {"images": _png(picture), "masks": _png(mask_picture(truth))}
    if task.layout == "yolo":
        contents["labels"] = yolo.label(truth).encode()
    names = file_names(number)
    for folder, content in contents.items():
        write_bytes(task.place / names[folder], content)
    return {
        names[folder]: {"bytes": len(content), "sha256": sha256(content).hexdigest()}
        for folder, content in contents.items()
    }


def _png(picture: Shaped[np.ndarray, "height width"]) -> bytes:
    return bytes(cv2.imencode(".png", picture, _FAST_PNG)[1])


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""The folder of a data set: what is in it, how an interrupted set goes on, and what may be replaced.

    images/000000.png ...     pictures
    masks/000000.png ...      0 nothing, 1 stripe, 2 ghost stripe
    annotations.json          COCO keypoints; or labels/000000.txt ... and data.yaml for YOLO-pose
    stripe.parquet            a row a stripe point
    frames.parquet            a row a frame
    config.yaml               the settings; `--config config.yaml` repeats the set
    manifest.json             count, seed, versions; size and SHA-256 of every other file

manifest.json is written last: a folder that has it is finished. Until then `.unfinished` holds what was asked for and
what is known of the plates that are done; every file appears whole. Files that no data set wrote are never touched.
"""

import errno
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from weldcell.cell.errors import BadInput
from weldcell.scenarios.atomic_file import write_text
from weldcell.scenarios.run_folder import lock_folder, make_folders, remove_empty

MANIFEST, CONFIG, COCO, YOLO = "manifest.json", "config.yaml", "annotations.json", "data.yaml"
STRIPE, FRAMES = "stripe.parquet", "frames.parquet"

_WORK, _REQUEST, _CLEARING = ".unfinished", "request.json", "clearing"
_SINGLE = (CONFIG, COCO, YOLO, STRIPE, FRAMES)
_SERIES = {"images": "png", "masks": "png", "labels": "txt"}
_MADE_BY = "weldcell dataset"
_BLOCK_BYTES = 1 << 20
_TOLD = ("count", "seed", "format")


class State(Enum):
    """What was found in the place of a data set; the values say what became of it."""

    FRESH = "made"
    BEGUN = "made; what an interrupted run had finished was kept"
    FINISHED = "finished already; nothing was changed"


@dataclass(frozen=True, kw_only=True)
class DatasetFolder:
    """The place of a data set while it is being made."""

    place: Path
    state: State

    @property
    def work(self) -> Path:
        """Where what is known of finished plates is kept until all is done."""
        return self.place / _WORK

    def finish(self, request: Mapping[str, Any], files: Mapping[str, Mapping[str, Any]]) -> None:
        """Writes the manifest, from which moment on the set is finished, and tidies up."""
        content = {"made_by": _MADE_BY, **request, "files": dict(sorted(files.items()))}
        write_text(self.place / MANIFEST, json.dumps(content, indent=1) + "\n")
        shutil.rmtree(self.work)


def file_names(frame: int) -> dict[str, str]:
    """Names of a frame's picture, mask and label within the data set."""
    return {folder: f"{folder}/{frame:06d}.{ending}" for folder, ending in _SERIES.items()}


def fingerprint(path: Path) -> dict[str, Any]:
    """Size and SHA-256 of a file."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            digest.update(block)
    return {"bytes": path.stat().st_size, "sha256": digest.hexdigest()}


@contextmanager
def dataset_folder(place: Path, request: Mapping[str, Any], *, overwrite: bool = False) -> Iterator[DatasetFolder]:
    """The folder, locked, with `request` (plain values) noted in it; refused if it holds anything else.

    With `overwrite` another set, finished or not, makes way. What was begun stays for the next try, whatever happens.
    """
    made = make_folders(place)
    try:
        lock = lock_folder(place)
        try:
            folder = DatasetFolder(place=place, state=_prepare(place, dict(request), overwrite))
            try:
                yield folder
            except BaseException:
                _forget_empty(place)
                raise
        finally:
            os.close(lock)
    except BaseException:
        remove_empty(made)
        raise


def _prepare(place: Path, request: dict[str, Any], overwrite: bool) -> State:
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))
    if (place / _WORK / _CLEARING).exists():  # an earlier run was interrupted while it made way
        _clear(place)
    finished, begun = _read(place / MANIFEST), _read(place / _WORK / _REQUEST)
    if finished is not None and finished.get("made_by") != _MADE_BY:
        raise BadInput(f"{place / MANIFEST}: found a manifest of something else, expected a free place")
    found = finished or begun
    if found is None:
        if taken := [name for name in (*_SINGLE, *_SERIES) if (place / name).exists()]:
            raise BadInput(f"{place}: found {taken[0]} that no data set left there, expected a free place")
    elif not overwrite:
        _refuse_other(place, found, request, finished=finished is not None)
        if finished is not None:
            shutil.rmtree(place / _WORK, ignore_errors=True)  # left by an interruption after the manifest
        return State.FINISHED if finished is not None else State.BEGUN
    else:
        write_text(place / _WORK / _CLEARING, "")
        _clear(place)
    write_text(place / _WORK / _REQUEST, json.dumps(request))
    return State.FRESH


def _refuse_other(place: Path, found: Mapping[str, Any], request: Mapping[str, Any], *, finished: bool) -> None:
    """Refuses to go on with a set that was asked for otherwise; a finished one may be of other versions."""
    for name, value in request.items():
        if found.get(name) != value and not (finished and name == "versions"):
            kind = "a finished" if finished else "an unfinished"
            # The configuration's checksum and the versions tell a person nothing.
            what = f"with {name} {found.get(name)}, not {value}" if name in _TOLD else f"of another {name}"
            raise BadInput(f"{place}: found {kind} data set {what}; --overwrite replaces it")


def _read(path: Path) -> dict[str, Any] | None:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (ValueError, OSError):
        content = None
    if not isinstance(content, dict):
        raise BadInput(f"{path}: found something that is not the JSON of a data set")
    return content


def _clear(place: Path) -> None:
    """Removes a data set's files, and nothing else; can be interrupted and done again."""
    (place / MANIFEST).unlink(missing_ok=True)
    for folder, ending in _SERIES.items():
        if (place / folder).is_dir():
            for path in (place / folder).iterdir():
                if re.fullmatch(rf"\d{{6,}}\.{ending}|\.\d{{6,}}\.{ending}\.unfinished", path.name):
                    path.unlink()
            remove_empty([place / folder])
    for name in _SINGLE:
        (place / name).unlink(missing_ok=True)
    for path in (place / _WORK).iterdir():
        if path.name != _CLEARING:
            path.unlink()
    shutil.rmtree(place / _WORK)


def _forget_empty(place: Path) -> None:
    """Leaves no trace of a set of which nothing was finished."""
    work = place / _WORK
    if work.is_dir() and {path.name for path in work.iterdir()} <= {_REQUEST} and not (place / MANIFEST).exists():
        write_text(work / _CLEARING, "")
        _clear(place)

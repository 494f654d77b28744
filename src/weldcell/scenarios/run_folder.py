"""The folder of a run: its files appear when the run is done, and a finished run outlives any interruption.

A run writes into `.unfinished` inside its folder. When all is whole, that is renamed to `.finished` (from this moment
on the run counts), the former run's files are removed, and the new ones move up. Whoever comes after an interruption
clears an `.unfinished` away, or does the rest of the moving. Other files in the folder are left alone.
"""

import errno
import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from weldcell.cell.errors import BadInput

RECORDING = "recording.rrd"
METRICS = "metrics.json"  # removed first and moved last: the folder that has it is finished
CONFIG = "config.yaml"
CALIBRATION = "calibration"

_OWN = (CONFIG, CALIBRATION, RECORDING, METRICS)  # in the order of moving; a run leaves nothing else
_UNFINISHED = ".unfinished"
_FINISHED = ".finished"
_MOVING = ".moving"


@contextmanager
def run_folder(place: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """A folder to write a run into; its files are found in `place` if the block ends well, and nowhere if not."""
    made = make_folders(place)
    try:
        lock = lock_folder(place)
        try:
            unfinished = place / _UNFINISHED
            _move_up(place)
            _remove(unfinished)
            _refuse_taken(place, overwrite)
            unfinished.mkdir()
            try:
                yield unfinished
                unfinished.rename(place / _FINISHED)
            except BaseException:
                _remove(unfinished)
                raise
            _move_up(place)
        finally:
            os.close(lock)
    except BaseException:
        remove_empty(made)
        raise


def recording_of(run: Path) -> Path:
    """The recording of a run's folder, or the recording itself if that is what was given."""
    recording = run / RECORDING if run.is_dir() else run
    if recording.is_file():
        return recording
    found = f"a folder without {RECORDING}" if run.is_dir() else "no such file or folder"
    raise BadInput(f"{run}: found {found}, expected a run's folder or a .rrd file")


def make_folders(place: Path) -> list[Path]:
    """The folders that had to be made for `place` to exist, innermost first."""
    missing = [folder for folder in (place, *place.parents) if not folder.exists()]
    try:
        place.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise BadInput(f"{place}: found a file, expected a folder to write the run into") from None
    except OSError:
        remove_empty(missing)
        raise
    return missing


def remove_empty(folders: list[Path]) -> None:
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:  # never made, or another run uses it by now
            continue


def lock_folder(place: Path) -> int:
    """Locks the folder for this run; the system drops the lock with the process, however that ends."""
    while True:
        place.mkdir(parents=True, exist_ok=True)
        lock = os.open(place, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Between opening and locking, a run that failed may have removed the folder.
            if os.path.samestat(os.fstat(lock), os.stat(place)):
                return lock
        except BlockingIOError:
            os.close(lock)
            raise BadInput(f"{place}: another run is writing there; wait for it, or choose another --out") from None
        except FileNotFoundError:
            pass
        os.close(lock)


def _refuse_taken(place: Path, overwrite: bool) -> None:
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(place))
    if (place / METRICS).exists():
        if not overwrite:
            raise BadInput(f"{place}: found a finished run, expected a free place (--overwrite replaces it)")
    elif taken := [name for name in _OWN if (place / name).exists()]:
        raise BadInput(f"{place}: found {taken[0]} that no run left there, expected a free place")


def _move_up(place: Path) -> None:
    """Puts the files of a whole run in their place, this run's or those of an interrupted one.

    Each step can be interrupted and done again: the former run's files go while none of the new ones has moved.
    """
    finished, moving = place / _FINISHED, place / _MOVING
    if finished.is_dir():
        for name in reversed(_OWN):
            _remove(place / name)
        finished.rename(moving)
    if moving.is_dir():
        for name in _OWN:
            if (moving / name).exists():
                (moving / name).rename(place / name)
        _remove(moving)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)

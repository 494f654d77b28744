"""Checks of a recording that is read."""

import warnings
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader

from weldcell.cell.errors import BadInput

_SUFFIX = ".rrd"


def check_recording(path: Path) -> None:
    """Returns nothing if the recording, read from end to end, is whole; raises BadInput if it is not.

    rerun finds missing ends and broken structure or compression; a flipped bit within a stored number or picture
    passes.
    """
    if not path.is_file():
        raise BadInput(f"{path}: found no such file, expected a recording ({_SUFFIX})")
    with warnings.catch_warnings():
        warnings.simplefilter("error", rr.error_utils.RerunWarning)  # "no footer": the end is missing
        try:
            reader = RrdReader(path)
            rows = sum(len(chunk) for chunk in reader.stream()) if reader.recordings() else 0
        except Exception as error:  # the bindings raise RuntimeError, ValueError, OSError and warnings
            reason = str(error).splitlines()[0]
            raise BadInput(
                f"{path}: the recording is damaged or was cut off, expected a whole one: {reason}"
            ) from error
    if rows == 0:
        raise BadInput(f"{path}: found no data, expected a recording of a run")

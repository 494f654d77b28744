"""The file that is being written."""

import uuid
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Int

from weldcell.cell.errors import WeldcellError
from weldcell.scenarios.recording.reading import check_recording

_APPLICATION = "weldcell"
_CHUNK_BYTES = 2_000_000  # few large chunks: the viewer is slow with thousands of small ones
_NEVER_S = 1e6  # chunks are cut by size alone, never by the clock


class Stream:
    """A rerun file under a temporary name, renamed when it is whole."""

    def __init__(self, path: Path, title: str) -> None:
        self.path = path
        self._unfinished = path.with_name(f".unfinished-{path.stem}.rrd")  # rerun goes by the suffix
        self._stream = rr.RecordingStream(
            _APPLICATION,
            recording_id=uuid.uuid5(uuid.NAMESPACE_OID, title),  # the same run is the same recording
            default_enabled=True,
            send_properties=False,  # else the time of day is written
            batcher_config=rr.ChunkBatcherConfig(flush_tick=_NEVER_S, flush_num_bytes=_CHUNK_BYTES),
        )
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream.save(self._unfinished)
        except Exception as error:
            raise WeldcellError(f"{path}: the recording cannot be written there: {error}") from error
        self._stream.send_recording_name(title)

    def keep(self, entity: str, what: rr.AsComponents) -> None:
        """Writes what holds at all times."""
        self._stream.log(entity, what, static=True, strict=True)

    def log(self, frame: int, time_s: float, entity: str, what: rr.AsComponents) -> None:
        """Writes what holds from this moment on."""
        self._stream.set_time("frame", sequence=frame)
        self._stream.set_time("t", duration=time_s)
        self._stream.log(entity, what, strict=True)

    def log_columns(
        self,
        frames: Int[np.ndarray, "n"],
        times_s: Float[np.ndarray, "n"],
        entity: str,
        columns: rr.ComponentColumnList,
    ) -> None:
        """Writes one row for each moment."""
        moments = [rr.TimeColumn("frame", sequence=frames), rr.TimeColumn("t", duration=times_s)]
        self._stream.send_columns(entity, moments, columns, strict=True)

    def close(self, layout: rrb.Blueprint) -> None:
        """Writes the rest, checks the file and gives it its name."""
        self._stream.send_blueprint(layout)
        self._stream.disconnect()
        try:
            check_recording(self._unfinished)  # rerun does not report a full disk
            self._unfinished.replace(self.path)
        except (OSError, WeldcellError) as error:
            self._unfinished.unlink(missing_ok=True)
            raise WeldcellError(f"{self.path}: the recording was not written whole (disk full?): {error}") from error

    def discard(self) -> None:
        """Leaves no file."""
        self._stream.disconnect()
        self._unfinished.unlink(missing_ok=True)

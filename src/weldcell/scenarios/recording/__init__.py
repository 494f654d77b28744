"""The recording of a run: the only place that knows rerun."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")  # before mujoco's first import: no display is needed

from weldcell.scenarios.recording.reading import check_recording
from weldcell.scenarios.recording.recording import Recording
from weldcell.scenarios.recording.viewer import HeadlessViewer, view

__all__ = ["HeadlessViewer", "Recording", "check_recording", "view"]

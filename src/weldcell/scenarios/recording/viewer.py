"""rerun's viewer: with a screen for a person, without one for pictures. It listens on this machine only."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rerun_cli
from rerun.experimental import ViewerClient

from weldcell.cell.errors import BadInput, WeldcellError
from weldcell.scenarios.recording.reading import check_recording

_LOOPBACK = "127.0.0.1"
_QUIET = {"CI": "1"}  # rerun's own switch that stops its usage statistics
_POLL_S = 0.1
_FALL_S = 2.0
_STILL_S = 0.5  # a view that stays the same for so long is done: pictures are decoded, views laid out

NO_GRAPHICS = (
    "the viewer found no Vulkan graphics driver; on Debian or Ubuntu:"
    " sudo apt-get install -y libvulkan1 mesa-vulkan-drivers"
)


def view(recording: Path) -> None:
    """Shows the recording in rerun's viewer and returns when its window is closed."""
    check_recording(recording)
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise WeldcellError(
            "view: found no display, expected DISPLAY or WAYLAND_DISPLAY to be set;"
            " `weldcell snapshot RUN --out picture.png` makes a picture without one"
        )
    command = [_executable(), "--bind", _LOOPBACK, "--port", "auto", "--hide-welcome-screen", str(recording.resolve())]
    done = subprocess.run(command, env=os.environ | _QUIET, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode != 0:
        raise WeldcellError(f"view: rerun's viewer failed: {_reason(done.stderr)}")


class HeadlessViewer:
    """A viewer without a window that has one recording open."""

    def __init__(self, client: ViewerClient, process: "subprocess.Popen[str]", deadline_s: float) -> None:
        self._client, self._process, self._deadline_s = client, process, deadline_s

    @staticmethod
    @contextmanager
    def open(
        recording: Path, *, width_px: int = 1920, height_px: int = 1080, timeout_s: float = 60.0
    ) -> Iterator["HeadlessViewer"]:
        """A viewer of a whole recording; its process and what it writes are gone when the block ends."""
        check_recording(recording)
        with tempfile.TemporaryDirectory(prefix="weldcell-viewer-") as home, open(f"{home}/log", "w+") as log:
            link = Path(home) / "recording.rrd"  # so that any file name will do
            link.symlink_to(recording.resolve())
            port = _free_port()
            process = subprocess.Popen(
                [_executable(), "--headless", "--bind", _LOOPBACK, "--port", str(port), "--hide-welcome-screen"]
                + ["--window-size", f"{width_px}x{height_px}"],
                env=_environment(home),
                stdout=log,
                stderr=log,
                text=True,
            )
            try:
                deadline_s = time.monotonic() + timeout_s
                viewer = HeadlessViewer(_connect(port, process, deadline_s, Path(log.name)), process, deadline_s)
                viewer._load(link)
                yield viewer
            except (RuntimeError, ConnectionError) as error:  # what the bindings raise
                raise WeldcellError(f"snapshot: {_failure(process, Path(log.name), error)}") from error
            finally:
                _end(process)

    def frames(self) -> tuple[int, int]:
        """First and last number on the `frame` timeline."""
        for timeline in self._client.get_state().recordings[0].timelines:
            if timeline.name == "frame" and timeline.start is not None and timeline.end is not None:
                return timeline.start, timeline.end
        raise BadInput("the recording has no `frame` timeline: expected a recording made by weldcell")

    def tabs(self) -> list[str]:
        """Names of the tabs, in their order."""
        parts = self._blueprint()
        return [_display_name(parts, tab) for tab in _root(parts)["contents"]]

    def show(self, *, frame: int, tab: str | None = None) -> None:
        """Turns to a frame and a tab, and hides the viewer's own panels."""
        parts = self._blueprint()
        if tab is not None:
            by_name = {_display_name(parts, path): path for path in _root(parts)["contents"]}
            if tab not in by_name:
                raise BadInput(f"the recording has no tab {tab!r}. Available: {', '.join(by_name)}")
            _root(parts)["active_tab"] = by_name[tab]
        for panel in _PANELS:
            parts.setdefault(f"/{panel}", {})[_PANELS[panel]] = {"state": "Hidden"}
        self._client.set_blueprint(parts, of="recording")
        self._client.set_time("frame", sequence=frame, play_state="paused")

    def picture(self) -> bytes:
        """What is seen, as PNG, once it no longer changes."""
        before, now = b"", self._client.take_screenshot()
        while now != before and time.monotonic() < self._deadline_s:
            time.sleep(_STILL_S)
            before, now = now, self._client.take_screenshot()
        return now

    def complaints(self) -> list[str]:
        """What the visible views report as not drawable; empty when all is well."""
        views = self._client.get_state().views
        return [f"{view.name}: {report.severity}: {report.summary}" for view in views for report in view.reports]

    def _load(self, link: Path) -> None:
        self._client.open(str(link))
        self._wait("load the recording", self._loaded)

    def _loaded(self) -> bool:
        state = self._client.get_state()
        return bool(state.recordings and state.recordings[0].timelines and not state.loading)

    def _blueprint(self) -> dict[str, Any]:
        return self._client.get_blueprint().blueprint

    def _wait(self, what: str, done: Callable[[], bool]) -> None:
        while not done():
            if time.monotonic() > self._deadline_s:
                raise WeldcellError(f"snapshot: rerun's viewer did not {what} in time")
            time.sleep(_POLL_S)


_PANELS = {"top_panel": "PanelBlueprint", "time_panel": "TimePanelBlueprint"}


def _root(parts: dict[str, Any]) -> dict[str, Any]:
    root = parts["/viewport"]["ViewportBlueprint"]["root_container"]
    container: dict[str, Any] = parts[f"/container/{root}"]["ContainerBlueprint"]
    return container


def _display_name(parts: dict[str, Any], path: str) -> str:
    part = parts["/" + path.strip("/")]
    return str(next(iter(part.values())).get("display_name", ""))


def _connect(port: int, process: "subprocess.Popen[str]", deadline_s: float, log: Path) -> ViewerClient:
    while True:
        if process.poll() is not None:
            raise WeldcellError(f"snapshot: {_reason(log.read_text(errors='replace'))}")
        try:
            client = ViewerClient.connect(f"rerun+http://{_LOOPBACK}:{port}/proxy")
            client.get_state()
            return client
        except Exception as error:  # not up yet: the bindings raise several kinds
            if time.monotonic() > deadline_s:
                raise WeldcellError(f"snapshot: rerun's viewer did not answer in time: {error}") from error
            time.sleep(_POLL_S)


def _failure(process: "subprocess.Popen[str]", log: Path, error: Exception) -> str:
    try:
        process.wait(timeout=_FALL_S)  # it may answer once more while it is falling over
    except subprocess.TimeoutExpired:
        return f"rerun's viewer failed: {error}"
    return _reason(log.read_text(errors="replace"))


def _reason(log: str) -> str:
    """Why the viewer ended, from what it printed."""
    if "render context" in log or "graphics adapter" in log or "NoSuitableAdapter" in log:
        return NO_GRAPHICS
    lines = [line for line in log.splitlines() if "ERROR" in line or "rror:" in line or "panicked" in line]
    return lines[-1].strip() if lines else "rerun's viewer ended without a message"


def _end(process: "subprocess.Popen[str]") -> None:
    process.terminate()
    try:
        process.wait(timeout=5)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _environment(home: str) -> dict[str, str]:
    """The environment with all of the viewer's own files (settings, caches) in a folder that goes away."""
    own = dict.fromkeys(("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME", "XDG_RUNTIME_DIR"), home)
    return os.environ | own | _QUIET


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_LOOPBACK, 0))
        return int(probe.getsockname()[1])


def _executable() -> str:
    suffix = ".exe" if sys.platform == "win32" else ""
    return str(Path(rerun_cli.__file__).parent / f"rerun{suffix}")

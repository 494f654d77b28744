"""Pictures of a recording without a screen, and the messages where that is not possible."""

import ctypes.util
from collections.abc import Iterator
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader

from weldcell.cell.configuration import RecordingConfig
from weldcell.cell.errors import BadInput, WeldcellError
from weldcell.scenarios import snapshot
from weldcell.scenarios.recording import HeadlessViewer, Recording, view

ICD_FOLDERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")
HAS_VULKAN = ctypes.util.find_library("vulkan") is not None and any(
    any(Path(folder).glob("*.json")) for folder in ICD_FOLDERS
)
needs_vulkan = pytest.mark.skipif(
    not HAS_VULKAN, reason="no Vulkan driver (apt-get install -y libvulkan1 mesa-vulkan-drivers)"
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A red ball that leaves the picture after the first frame, under an awkward file name."""
    path = tmp_path_factory.mktemp("run") / "a b#ü%20.rrd"
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body mocap='true' pos='0.7 0 0.4'>"
        "<geom type='sphere' size='0.3' rgba='1 0 0 1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    with Recording(path, RecordingConfig(), title="a ball") as recording:
        recording.log_cell(model)
        recording.begin_stage("ball", "Ball", frame=0, time_s=0.0)
        recording.log_lines("true", {"root": np.eye(3)}, frame=0, time_s=0.0)
        data.mocap_pos[0] = [0, 0, 100]
        mujoco.mj_kinematics(model, data)
        recording.log_pose(5, 1.0, data)
    return path


@pytest.fixture(scope="module")
def viewer(run: Path) -> Iterator[HeadlessViewer]:
    with HeadlessViewer.open(run, width_px=800, height_px=600) as viewer:
        yield viewer


def red_share(png: bytes) -> float:
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).astype(int)
    return float(np.mean((picture[..., 2] > 100) & (picture[..., 2] > 2 * picture[..., 1])))


@needs_vulkan
def test_a_snapshot_shows_the_recording_and_no_view_complains(run: Path, tmp_path: Path) -> None:
    picture = tmp_path / "new" / "out.png"
    assert snapshot.take(run, picture, 0, width_px=800, height_px=600) == []
    assert cv2.imread(str(picture)).shape == (600, 800, 3)
    assert red_share(picture.read_bytes()) > 0.01
    assert [path.name for path in picture.parent.iterdir()] == ["out.png"]


@needs_vulkan
def test_the_frame_decides_what_is_seen(viewer: HeadlessViewer) -> None:
    viewer.show(frame=0)
    assert red_share(viewer.picture()) > 0.01
    viewer.show(frame=5)
    assert red_share(viewer.picture()) < 0.001
    assert viewer.frames() == (0, 5)


@needs_vulkan
def test_each_tab_can_be_shown_and_none_complains(viewer: HeadlessViewer) -> None:
    assert viewer.tabs() == ["Overview", "Ball", "Report"]
    for tab in viewer.tabs():
        viewer.show(frame=0, tab=tab)
        viewer.picture()
        assert viewer.complaints() == []
    with pytest.raises(BadInput, match="Available: Overview, Ball, Report"):
        viewer.show(frame=0, tab="Seam")


@needs_vulkan
def test_a_frame_outside_the_recording_is_refused(run: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no frame 6, expected 0 to 5"):
        snapshot.take(run, tmp_path / "out.png", 6)
    assert list(tmp_path.iterdir()) == []


def test_a_missing_driver_is_named_with_the_command_that_installs_it(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, "/nonexistent")
    with pytest.raises(WeldcellError, match="apt-get install -y libvulkan1 mesa-vulkan-drivers"):
        snapshot.take(run, tmp_path / "out.png", 0)
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_recording_is_refused_before_any_viewer_starts(run: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(run.read_bytes()[:-100])
    with pytest.raises(BadInput, match=r"cut\.rrd"):
        snapshot.take(cut, tmp_path / "out.png")


def test_view_without_a_display_says_what_to_do(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(WeldcellError, match="weldcell snapshot"):
        view(run)


def test_the_recording_carries_its_blueprint(run: Path) -> None:
    assert len(RrdReader(run).blueprints()) == 1

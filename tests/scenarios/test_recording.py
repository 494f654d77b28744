"""What a recording holds, read back with rerun's own reader."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import RecordingConfig
from weldcell.cell.errors import BadInput, JobFailed, NotReady, UnknownFrame
from weldcell.cell.frames import rigid_from, translation
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import JointFeatures, Profile, Shot, Stripe
from weldcell.scenarios.recording import Recording, check_recording
from weldcell.scenarios.recording.meshes import carriers, drawn_geoms

SOURCE_CAMERA = np.array([0, -0.1375, 0.1375])  # of a plane at 45 deg, level with the camera
FLOAT32_M = 1e-6  # positions are stored as float32: 6e-8 of a metre or so

CELL = """
<mujoco><worldbody>
  <geom name="floor" type="plane" size="0 0 1"/>
  <body name="table" pos="1 0 0.2"><geom name="top" type="box" size="0.3 0.4 0.02" pos="0 0 0.1" rgba="0 0 1 1"/></body>
  <body name="arm/link" pos="0 0 0.5"><joint name="j" axis="0 0 1"/><geom type="capsule" size="0.05 0.2"/>
    <body name="head" pos="0.4 0 0" quat="0 1 0 0"><geom type="sphere" size="0.05"/><site name="sensor/camera"/></body>
  </body>
  <body name="part" mocap="true" pos="0.9 0 0.4"><geom type="cylinder" size="0.05 0.02"/></body>
  <geom name="unseen" type="box" size="1 1 1" rgba="1 1 1 0"/>
</worldbody></mujoco>
"""


@pytest.fixture
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(CELL)


@pytest.fixture
def camera() -> CameraModel:
    return CameraModel(
        width_px=1440, height_px=1080, focal_px=np.full(2, 3478.0), principal_px=np.array([719.5, 539.5])
    )


@pytest.fixture
def plane() -> LaserPlane:
    return LaserPlane(normal_camera=np.array([0, -1, 1]) / np.sqrt(2), offset_m=0.275 / np.sqrt(2))


def noisy_picture(rng: np.random.Generator) -> np.ndarray:
    """A stripe on a dim, noisy ground: JPEG has to store the noise."""
    picture = 14 + 1.6 * rng.standard_normal((1080, 1440), np.float32)
    rows = np.arange(1080)[:, None] - (540 + 100 * np.sin(np.arange(1440) / 200))
    return np.clip(picture + 200 * np.exp(-0.5 * (rows / 2) ** 2), 0, 255).astype(np.uint8)


def shot_of(rng: np.random.Generator, camera: CameraModel, plane: LaserPlane, time_s: float) -> dict:
    """A picture with 1400 stripe points, its profile and its features."""
    u_px = np.arange(20.0, 1420.0)
    v_px = 540 + 100 * np.sin(u_px / 200)
    points_camera = plane.intersect(camera.unproject(np.column_stack([u_px, v_px])))
    points_camera += 2e-5 * rng.standard_normal(points_camera.shape)
    sigma = np.full(1400, 1e-5)
    return {
        "shot": Shot(image=noisy_picture(rng), T_base_flange=RigidTransform.identity(), time_s=time_s),
        "stripe": Stripe(u_px=u_px, v_px=v_px, sigma_px=np.full(1400, 0.03)),
        "profile": Profile(points_camera=points_camera, sigma_m=sigma, valid=np.ones(1400, bool)),
        "joint": JointFeatures(
            names=("left", "root", "right"),
            points_camera=points_camera[[100, 700, 1300]],
            sigma_m=np.full(3, 1e-5),
            valid=True,
        ),
    }


def record(path: Path, model: mujoco.MjModel, camera: CameraModel, plane: LaserPlane, count: int) -> Path:
    """A small run: `count` pictures while the arm turns."""
    rng, data = np.random.default_rng(7), mujoco.MjData(model)
    with Recording(path, RecordingConfig(), title="a small run") as recording:
        recording.log_cell(model)
        recording.log_sensor(camera=camera, plane=plane, source_camera=SOURCE_CAMERA, fan_rad=0.7)
        recording.begin_stage("seam", "V-groove seam", frame=0, time_s=0.0)
        for frame in range(count):
            data.qpos[:] = 0.1 * frame
            mujoco.mj_kinematics(model, data)
            recording.log_pose(frame, 0.5 * frame, data)
            T_base_camera = translation(np.array([1.0, 0.001 * frame, 0.5]))
            recording.log_shot(frame, T_base_camera=T_base_camera, **shot_of(rng, camera, plane, 0.5 * frame))
        line_base = np.linspace([1, 0, 0.3], [1, 0.3, 0.3], 10)
        recording.log_lines("true", {"root": line_base}, frame=count - 1, time_s=0.5 * count)
        recording.log_touch(np.array([1.0, 0.1, 0.4]), frame=count - 1, time_s=0.5 * count)
        recording.log_errors(np.arange(count), 0.5 * np.arange(count), {"root": np.full(count, 0.1)})
        recording.log_points(
            {"point 1": np.ones(3)},
            {"before": {"point 1": np.ones((2, 3)) + [1e-3, 0, 0]}},
            frame=count - 1,
            time_s=0.5 * count,
        )
        recording.log_text("results", "# It worked")
    return path


@pytest.fixture(scope="module")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    camera = CameraModel(
        width_px=1440, height_px=1080, focal_px=np.full(2, 3478.0), principal_px=np.array([719.5, 539.5])
    )
    plane = LaserPlane(normal_camera=np.array([0, -1, 1]) / np.sqrt(2), offset_m=0.275 / np.sqrt(2))
    path = tmp_path_factory.mktemp("run") / "recording.rrd"
    return record(path, mujoco.MjModel.from_xml_string(CELL), camera, plane, count=4)


def columns_of(path: Path, entity: str) -> dict[str, list]:
    """All values of an entity by column, in the order of writing."""
    columns: dict[str, list] = {}
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity:
            for name, column in chunk.to_record_batch().to_pydict().items():
                columns.setdefault(name, []).extend(column)
    assert columns, f"{entity} is not in the recording"
    return columns


def component(path: Path, entity: str, name: str) -> list:
    columns = columns_of(path, entity)
    return next(values for key, values in columns.items() if key.endswith(f":{name}"))


def test_every_kind_of_thing_is_in_the_recording(small_run: Path) -> None:
    entities = {chunk.entity_path for chunk in RrdReader(small_run).stream()}
    assert {
        "/cell/world/floor",
        "/cell/table/top",
        "/cell/arm_link",
        "/cell/arm_link/head",
        "/cell/sensor/picture",
        "/cell/sensor/picture/stripe",
        "/cell/sensor/light",
        "/points/seam/profile",
        "/points/seam/features/root",
        "/points/seam/touches",
        "/lines/seam/true/root",
        "/checks/seam/before/point_1",
        "/errors/seam/root_mm",
        "/profile/points",
        "/texts/results",
        "/texts/guide",
        "/events",
        "/stage",
    } <= entities
    assert RrdReader(small_run).blueprints()


def test_the_only_timelines_are_frame_and_t(small_run: Path) -> None:
    timelines = {name for chunk in RrdReader(small_run).stream() for name in chunk.timeline_names}
    assert timelines == {"frame", "t"}


def test_a_body_stands_where_its_joint_puts_it(small_run: Path) -> None:
    turned = component(small_run, "/cell/arm_link", "quaternion")
    angles_rad = [Rotation.from_quat(q[0], scalar_first=False).magnitude() for q in turned]
    assert np.allclose(angles_rad[-4:], [0.0, 0.1, 0.2, 0.3], atol=FLOAT32_M)
    places = component(small_run, "/cell/arm_link", "translation")
    assert np.allclose([p[0] for p in places], [0, 0, 0.5], atol=FLOAT32_M)


def test_the_sensor_moves_with_its_site(small_run: Path) -> None:
    # The head is 0.4 m out on the arm, turned half round about x, and the arm turns about z by 0.3 rad at last.
    place = component(small_run, "/cell/sensor", "translation")[-1][0]
    assert np.allclose(place, [0.4 * np.cos(0.3), 0.4 * np.sin(0.3), 0.5], atol=FLOAT32_M)
    quaternion = component(small_run, "/cell/sensor", "quaternion")[-1][0]
    y_base = Rotation.from_quat(quaternion, scalar_first=False).apply([0, 1, 0])
    assert np.allclose(y_base, [np.sin(0.3), -np.cos(0.3), 0], atol=FLOAT32_M)


def test_a_part_that_stands_still_is_written_once(small_run: Path) -> None:
    assert len(component(small_run, "/cell/part", "translation")) == 1


def test_stripe_dots_lie_half_a_pixel_off_because_the_viewer_counts_from_the_corner(small_run: Path) -> None:
    dots = component(small_run, "/cell/sensor/picture/stripe", "positions")[0]
    assert np.allclose(dots[0], [20.5, 540.5 + 100 * np.sin(20 / 200)], atol=1e-3)  # px, float32 of 1e3


def test_every_second_picture_is_kept(small_run: Path) -> None:
    assert columns_of(small_run, "/cell/sensor/picture")["frame"] == [0, 2]
    assert columns_of(small_run, "/points/seam/profile")["frame"] == [0, 1, 2, 3]


def test_profile_points_are_placed_by_the_transform_given(small_run: Path) -> None:
    clouds = component(small_run, "/points/seam/profile", "positions")
    steps = np.diff([np.mean(cloud, axis=0) for cloud in clouds], axis=0)
    assert np.allclose(steps, [0, 0.001, 0], atol=5e-6)  # m: 20 um of noise on 700 points
    assert len(clouds[0]) == 700


def test_point_errors_are_magnified_by_a_round_number(small_run: Path) -> None:
    arrows = component(small_run, "/checks/seam/before/point_1", "vectors")[0]
    assert np.allclose(arrows, [[0.05, 0, 0]] * 2, atol=1e-6)  # 1 mm fifty times


def test_profiles_are_drawn_with_the_depth_downwards(small_run: Path) -> None:
    # Row 540 of the picture is the camera's axis, which meets the plane 0.275 cos45 m along the light.
    points_mm = np.array(component(small_run, "/profile/points", "positions")[0])
    deepest = np.argmax(np.sin(np.arange(20.0, 1420.0)[::2] / 200))
    assert points_mm[:, 1].min() < 275 / np.sqrt(2) < points_mm[:, 1].max()
    assert abs(np.argmax(points_mm[:, 1]) - deepest) < 20  # columns: noise decides between neighbours


def test_the_light_sheet_starts_at_the_laser_and_opens_as_wide_as_its_fan(small_run: Path) -> None:
    apex, left, right = np.array(component(small_run, "/cell/sensor/light", "vertex_positions")[0], float)
    assert np.allclose(apex, SOURCE_CAMERA, atol=FLOAT32_M)
    opening = (left - apex) @ (right - apex) / np.linalg.norm(left - apex) / np.linalg.norm(right - apex)
    assert np.arccos(opening) == pytest.approx(0.7, abs=1e-5)
    assert (left + right)[2] / 2 > 0.275  # m: past the crossing


def test_standing_geoms_are_drawn_where_the_model_has_them(model: mujoco.MjModel) -> None:
    geoms = {geom.name: geom for geom in drawn_geoms(model)}
    top = geoms["top"]
    assert np.allclose(top.points_body.min(axis=0), [-0.3, -0.4, 0.08])
    assert np.allclose(top.points_body.max(axis=0), [0.3, 0.4, 0.12])
    assert top.rgba.tolist() == [0, 0, 255, 255]
    assert "unseen" not in geoms


def test_normals_point_outwards(model: mujoco.MjModel) -> None:
    for geom in drawn_geoms(model):
        if geom.name != "floor":
            middle = (geom.points_body.min(axis=0) + geom.points_body.max(axis=0)) / 2
            assert np.all(np.sum((geom.points_body - middle) * geom.normals_body, axis=1) > 0)


def test_a_meshs_triangles_are_those_of_the_file() -> None:
    corners = "0 0 0  1 0 0  0 1 0  0 0 1"
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset><mesh name='m' vertex='{corners}' face='0 2 1 0 1 3 0 3 2 1 2 3'/></asset><worldbody>"
        "<body pos='3 0 0'><geom type='mesh' mesh='m' pos='0 0 2'/></body></worldbody></mujoco>"
    )
    (geom,) = drawn_geoms(model)
    found = np.unique(np.round(geom.points_body, 5), axis=0)
    assert np.allclose(found, [[0, 0, 2], [0, 0, 3], [0, 1, 2], [1, 0, 2]], atol=FLOAT32_M)
    assert len(geom.faces) == 4


def test_what_is_fixed_to_a_link_is_carried_by_it(model: mujoco.MjModel) -> None:
    names = [model.body(k).name for k in range(model.nbody)]
    carried = {names[k]: names[c] for k, c in enumerate(carriers(model))}
    assert carried == {
        "world": "world",
        "table": "world",
        "arm/link": "arm/link",
        "head": "arm/link",
        "part": "part",
    }


def test_the_same_run_is_written_the_same(
    tmp_path: Path, model: mujoco.MjModel, camera: CameraModel, plane: LaserPlane
) -> None:
    paths = [record(tmp_path / name, model, camera, plane, count=2) for name in ("a.rrd", "b.rrd")]
    entities = {chunk.entity_path for chunk in RrdReader(paths[0]).stream()} - {"/__properties"}
    for entity in entities:
        first, second = (columns_of(path, entity) for path in paths)
        own = {name for name in first if "RowId" in name or "row_id" in name}
        assert {k: v for k, v in first.items() if k not in own} == {k: v for k, v in second.items() if k not in own}


def test_a_long_run_stays_under_60_mb(
    tmp_path: Path, model: mujoco.MjModel, camera: CameraModel, plane: LaserPlane
) -> None:
    few, more = (record(tmp_path / f"{n}.rrd", model, camera, plane, count=n).stat().st_size for n in (4, 12))
    assert (more - few) / 8 * 600 < 60e6  # bytes


def test_a_recording_that_is_not_wanted_writes_nothing(tmp_path: Path, model: mujoco.MjModel) -> None:
    with Recording(tmp_path / "no.rrd", RecordingConfig(enabled=False), title="none") as recording:
        recording.log_cell(model)
        recording.log_pose(0, 0.0, mujoco.MjData(model))
        recording.log_text("results", "none")
        assert not recording.enabled
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_recording_leaves_nothing(tmp_path: Path, model: mujoco.MjModel) -> None:
    with pytest.raises(KeyError), Recording(tmp_path / "a.rrd", RecordingConfig(), title="cut") as recording:
        recording.log_cell(model)
        raise KeyError
    assert list(tmp_path.iterdir()) == []


def test_a_failed_job_keeps_its_recording(tmp_path: Path, model: mujoco.MjModel) -> None:
    with pytest.raises(JobFailed), Recording(tmp_path / "a.rrd", RecordingConfig(), title="failed") as recording:
        recording.log_cell(model)
        raise JobFailed("seam lost")
    check_recording(tmp_path / "a.rrd")
    assert [path.name for path in tmp_path.iterdir()] == ["a.rrd"]


def test_what_comes_too_early_is_refused(
    tmp_path: Path, model: mujoco.MjModel, camera: CameraModel, plane: LaserPlane
) -> None:
    shot = shot_of(np.random.default_rng(1), camera, plane, 0.0)
    with Recording(tmp_path / "a.rrd", RecordingConfig(), title="early") as recording:
        with pytest.raises(NotReady, match="log_cell"):
            recording.log_pose(0, 0.0, mujoco.MjData(model))
        with pytest.raises(NotReady, match="log_sensor"):
            recording.log_shot(0, T_base_camera=RigidTransform.identity(), **shot)
        recording.log_cell(model)
        with pytest.raises(UnknownFrame, match="sensor/camera"):
            recording.log_sensor(camera=camera, plane=plane, source_camera=SOURCE_CAMERA, fan_rad=0.7, site="nowhere")


def test_pictures_without_findings_wipe_out_the_former_ones(
    tmp_path: Path, model: mujoco.MjModel, camera: CameraModel, plane: LaserPlane
) -> None:
    found = shot_of(np.random.default_rng(1), camera, plane, 0.0)
    nothing = JointFeatures(
        names=(), points_camera=np.zeros((0, 3)), sigma_m=np.zeros(0), valid=False, reason="no stripe"
    )
    with Recording(tmp_path / "a.rrd", RecordingConfig(picture_every=1), title="lost") as recording:
        recording.log_cell(model)
        recording.log_sensor(camera=camera, plane=plane, source_camera=SOURCE_CAMERA, fan_rad=0.7)
        T_base_camera = rigid_from(Rotation.identity(), np.zeros(3))
        recording.log_shot(0, T_base_camera=T_base_camera, **found)
        recording.log_shot(1, found["shot"], T_base_camera=T_base_camera, joint=nothing)
    for entity in ("/profile/points", "/profile/features", "/cell/sensor/picture/stripe"):
        counts = [len(points) for points in component(tmp_path / "a.rrd", entity, "positions")]
        assert counts[0] > 0
        assert counts[1] == 0
    assert component(tmp_path / "a.rrd", "/events", "text")[-1] == ["no joint found: no stripe"]


@pytest.mark.parametrize("kept", [0.0, 0.001, 0.5, 0.999])
def test_a_recording_that_was_cut_off_is_refused(tmp_path: Path, small_run: Path, kept: float) -> None:
    whole = small_run.read_bytes()
    cut = tmp_path / "cut.rrd"
    cut.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(BadInput, match=r"cut\.rrd"):
        check_recording(cut)


def test_a_whole_recording_is_accepted(small_run: Path) -> None:
    check_recording(small_run)


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no such file"):
        check_recording(tmp_path / "none.rrd")
    (tmp_path / "text.rrd").write_text("not a recording at all, only a line of text")
    with pytest.raises(BadInput, match=r"text\.rrd"):
        check_recording(tmp_path / "text.rrd")


def test_nothing_is_written_when_it_is_switched_off(tmp_path):
    with Recording(tmp_path / "recording.rrd", RecordingConfig(enabled=False), title="off") as recording:
        recording.log_text("results", "# none")
    assert list(tmp_path.iterdir()) == []

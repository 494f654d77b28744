"""Rendered pictures against `CameraModel.project`; the renderer's life from opening to exit."""

import copy
import subprocess
import sys

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.errors import BadGeometry, NotReady
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim import ambient
from weldcell.sensor_sim.ambient import AmbientRenderer

MARKS = '<material name="m" emission="1" rgba="1 1 1 1" specular="0"/>'


def camera_of(principal_px=(300.0, 260.0), distortion=(0.0,) * 5, focal_px=(1500.0, 1560.0)) -> CameraModel:
    return CameraModel(
        width_px=640,
        height_px=480,
        focal_px=np.array(focal_px),
        principal_px=np.array(principal_px),
        distortion=np.array([*distortion, *np.zeros(9)]),
    )


@pytest.mark.parametrize(
    "camera",
    [
        camera_of(),
        camera_of(principal_px=(420.0, 150.0)),
        camera_of(principal_px=(200.0, 330.0), distortion=(-0.3, 0.1, 2e-3, -3e-3, 0.05)),
        camera_of(distortion=(0.4, -0.1, -3e-3, 2e-3, 0.0)),
    ],
    ids=["off-centre", "far off-centre", "barrel", "pincushion"],
)
def test_bright_spheres_are_rendered_where_the_camera_model_projects_them(scene, camera):
    """Spheres of 2 mm at 0.3 m, seen from an oblique pose that also rolls."""
    T_base_camera = rigid_from(Rotation.from_euler("xyz", [2.0, 0.3, -0.8]), np.array([0.2, -0.1, 0.4]))
    places = np.array([(u, v) for u in np.linspace(40.3, 599.1, 8) for v in np.linspace(40.1, 439.4, 6)])
    centres_camera = 0.3 * camera.unproject(places)
    centres = T_base_camera.apply(centres_camera)
    world = "".join(f'<geom size=".002" material="m" pos="{x} {y} {z}"/>' for x, y, z in centres)
    model, data = scene(world, MARKS)
    with AmbientRenderer(model, camera, 255.0) as renderer:
        picture = renderer.render(data, T_base_camera)
    v, u = np.mgrid[:480, :640]
    errors_px = []
    for place in camera.project(centres_camera):
        near = picture * (np.hypot(u - place[0], v - place[1]) < 20)
        errors_px.append(np.array([(near * u).sum(), (near * v).sum()]) / near.sum() - place)
    # a hard-edged disc of 10 px radius has a centroid good to 0.05 px; 48 of them average to 0.007 px; perspective and
    # distortion move the outline's centroid by 0.03 px in the corners, to either side
    assert np.abs(errors_px).max() < 0.25
    assert np.abs(np.mean(errors_px, axis=0)).max() < 0.03
    slopes = np.linalg.lstsq(np.column_stack([np.ones(48), places - places.mean(axis=0)]), np.array(errors_px))[0][1:]
    assert np.abs(slopes).max() < 3e-4  # 0.1 px over the half picture: the scale is right


def test_white_is_the_ambient_grey_and_the_empty_background_is_dark(scene, camera, overhead):
    model, data = scene('<geom type="box" size=".01 .01 .001" material="m"/>', MARKS)
    with AmbientRenderer(model, camera, 18.0) as renderer:
        picture = renderer.render(data, overhead())
    assert picture.dtype == np.float32 and picture.shape == (1080, 1440)
    assert picture.max() == pytest.approx(18.0, abs=1e-4) and picture.min() == 0


def test_the_sensors_own_head_is_not_rendered(scene, camera, overhead):
    model, data = scene('<geom size=".01" material="m" group="3"/>', MARKS)
    with AmbientRenderer(model, camera, 18.0) as renderer:
        assert renderer.render(data, overhead()).max() == 0


@pytest.mark.parametrize("seed", range(6))
def test_leaving_out_what_is_out_of_view_changes_no_bit_of_the_picture(scene, monkeypatch, seed):
    """Random solids all around, many cut by the picture's border, seen from random poses near and far."""
    rng = np.random.default_rng(seed)
    kinds = {"sphere": 1, "capsule": 2, "ellipsoid": 3, "cylinder": 2, "box": 3, "mesh": 0}
    world = '<geom type="plane" size="0 0 1" pos="0 0 -.4" rgba=".5 .6 .4 1"/><light pos="0 0 3"/>'
    for number in range(120):
        kind = list(kinds)[number % 6]
        size = " ".join(f"{x:.4f}" for x in rng.uniform(0.005, 0.06, kinds[kind]))
        shape = f'size="{size}"' if kinds[kind] else 'mesh="wedge"'
        place = " ".join(f"{x:.4f}" for x in rng.uniform(-0.4, 0.4, 3))
        turn = " ".join(f"{x:.1f}" for x in rng.uniform(-180, 180, 3))
        colour = " ".join(f"{x:.3f}" for x in rng.uniform(0.2, 1, 3)) + (" .5" if number % 10 == 0 else " 1")
        world += f'<geom type="{kind}" {shape} pos="{place}" euler="{turn}" rgba="{colour}" group="{number % 3}"/>'
    model, data = scene(world, '<mesh name="wedge" vertex="0 0 0  .15 0 0  0 .02 0  0 0 .05  .1 .05 .05"/>')
    lens = (-0.3, 0.1, 2e-3, -3e-3, 0.05) if seed % 2 else (0.0,) * 5
    poses = [rigid_from(Rotation.random(rng=rng), reach * rng.normal(size=3)) for reach in (0.05, 0.1, 0.3, 0.6) * 2]
    with AmbientRenderer(model, camera_of(distortion=lens), 255.0) as renderer:
        fast = [renderer.render(data, pose) for pose in poses]
        counts = [np.count_nonzero(_geoms_in_view(renderer, model, data, pose)) for pose in poses]
        monkeypatch.setattr(ambient, "_in_view", lambda model, *_: np.ones(model.ngeom, bool))
        whole = [renderer.render(data, pose) for pose in poses]
        renderer._layers[:] = 0  # MuJoCo's own order
        unordered = [renderer.render(data, pose) for pose in poses]
    assert min(counts) < 60  # much is left out
    assert np.mean([picture.std() > 5 for picture in whole]) > 0.2  # there is something to see
    np.testing.assert_array_equal(fast, whole)
    # the order shows only where surfaces meet: the last level (of 255) of some pixels
    assert np.abs(np.subtract(unordered, whole)).max() <= 1.001
    assert np.mean(np.not_equal(unordered, whole)) < 1e-4


def _geoms_in_view(renderer, model, data, pose):
    return ambient._in_view(model, data, pose.translation, pose.rotation.as_matrix(), renderer._pinhole)


def test_a_geom_that_only_its_corner_brings_into_the_picture_is_drawn(scene, overhead):
    """A long thin box whose centre and both ends are out of view, across a corner of the picture."""
    camera = camera_of(principal_px=(319.5, 239.5), focal_px=(1500.0, 1500.0))
    T_base_camera = overhead()
    middle = 0.275 * camera.unproject(np.array([[-2.0, 470.0]]))[0]
    centre = T_base_camera.apply(middle)
    quat = T_base_camera.rotation.as_quat(scalar_first=True)
    world = '<body pos="{} {} {}" quat="{} {} {} {}"><geom type="box" size=".0006 .2 .0006" material="m" {}/></body>'
    model, data = scene(world.format(*centre, *quat, 'euler="0 0 10"'), MARKS)
    with AmbientRenderer(model, camera, 255.0) as renderer:
        assert (renderer.render(data, T_base_camera) > 200).sum() > 20


def test_rendering_changes_neither_model_nor_data(scene, camera, overhead):
    model, data = scene('<geom size=".01"/><camera pos="1 0 0"/>')
    before_quality = (model.vis.quality.offsamples, model.vis.global_.offwidth, model.vis.quality.shadowsize)
    before = copy.copy(data)
    with AmbientRenderer(model, camera, 18.0) as renderer:
        renderer.render(data, overhead())
    assert before_quality == (model.vis.quality.offsamples, model.vis.global_.offwidth, model.vis.quality.shadowsize)
    np.testing.assert_array_equal(before.cam_xpos, data.cam_xpos)
    np.testing.assert_array_equal(before.geom_xpos, data.geom_xpos)


def test_four_renderers_at_once_give_the_same_picture(scene, overhead):
    model, data = scene('<geom size=".02"/>')
    renderers = [AmbientRenderer(model, camera_of(), 100.0) for _ in range(4)]
    pictures = [renderer.render(data, overhead()) for renderer in renderers]
    for renderer in renderers:
        renderer.close()
        renderer.close()  # a second time does nothing
    assert pictures[0].max() > 10
    for picture in pictures[1:]:
        np.testing.assert_array_equal(picture, pictures[0])


def test_a_closed_renderer_says_so(scene, overhead):
    model, data = scene('<geom size=".02"/>')
    with AmbientRenderer(model, camera_of(), 100.0) as renderer:
        pass
    with pytest.raises(NotReady, match="closed"):
        renderer.render(data, overhead())


def test_a_renderer_open_at_exit_ends_quietly():
    script = (
        "import mujoco, numpy as np\n"
        "from weldcell.sensor_sim.ambient import AmbientRenderer\n"
        "from weldcell.cell.optics import CameraModel\n"
        "m = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size=\".1\"/></worldbody></mujoco>')\n"
        "two = np.array([100., 100.])\n"
        "c = CameraModel(width_px=64, height_px=48, focal_px=two, principal_px=two / 3)\n"
        "r = AmbientRenderer(m, c, 18.0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0 and done.stderr == "", done.stderr


def test_missing_opengl_names_the_packages(scene, monkeypatch):
    model, _ = scene('<geom size=".02"/>')

    def no_egl(*_args):
        raise AttributeError("'NoneType' object has no attribute 'eglQueryString'")

    monkeypatch.setattr(ambient, "_context_class", lambda: no_egl)
    with pytest.raises(NotReady, match="apt-get install libegl1 libopengl0 libgl1-mesa-dri"):
        AmbientRenderer(model, camera_of(), 18.0)
    assert model.vis.quality.offsamples == mujoco.MjSpec().visual.quality.offsamples


def test_a_distortion_that_cannot_be_inverted_is_refused(scene):
    model, _ = scene('<geom size=".02"/>')
    with pytest.raises(BadGeometry, match="distortion cannot be inverted"):
        AmbientRenderer(model, camera_of(distortion=(-30.0, 0, 0, 0, 0)), 18.0)

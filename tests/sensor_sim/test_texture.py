"""A part's texture in the laser's stripe: the same as in the rendered picture, wherever the part stands."""

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.frames import rigid_from, translation
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.ambient import AmbientRenderer
from weldcell.sensor_sim.design import nominal_camera
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.texture import SceneTextures


def plate_scene(T_base_part, kind="scratched"):
    spec = mujoco.MjSpec()
    plate = v_groove_plate(0.3, 0.16, 0.06, np.pi / 4, 0.0, 0.004, 0.02).with_surface("ground-steel", kind, 3)
    plate.add_to(spec, T_base_part)
    spec.worldbody.add_light(
        pos=[0, 0, 3], dir=[0, 0, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=[0.5] * 3
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return plate, model, data


@pytest.fixture(scope="module")
def seen(overhead):
    """The rendered picture of a turned and moved plate, the stripe's factor for each pixel, and the faces' normals."""
    T_base_part = rigid_from(Rotation.from_euler("z", 25, degrees=True), np.array([0.3, 0.2, 0.1]))
    _, model, data = plate_scene(T_base_part)
    camera, T_base_camera = nominal_camera(SensorConfig()), overhead((0.3, 0.2, 0.15))
    with AmbientRenderer(model, camera, 255.0) as renderer:
        picture = renderer.render(data, T_base_camera)[300:900, 300:1100]
    v_px, u_px = np.mgrid[300:900, 300:1100].reshape(2, -1)
    rays = camera.unproject(np.column_stack([u_px, v_px]).astype(float))
    rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ T_base_camera.rotation.as_matrix().T
    hits = RayCaster(model).cast(data, T_base_camera.translation, rays)
    factor = SceneTextures(model).factor(data, hits.points, hits.normals, hits.geom_id)
    return picture, factor.reshape(picture.shape).astype(np.float32), hits.normals.reshape(*picture.shape, 3)


@pytest.mark.parametrize(("face", "size_px"), [("top", 128), ("wall", 256)])
def test_a_scratch_is_at_the_same_place_in_picture_and_stripe(seen, face, size_px):
    """Phase correlation of both over windows of one face: apart by 0.4 px (0.03 mm) at most, and alike.

    Smoothing of the rendered texture takes the rest: a tenth of a pixel on average.
    """
    picture, factor, normals = seen
    on_face = normals[..., 2] > 0.9 if face == "top" else np.abs(normals[..., 2]) < 0.5
    shifts = []
    for v in range(0, picture.shape[0] - size_px, size_px // 2):
        for u in range(0, picture.shape[1] - size_px, size_px // 2):
            window = slice(v, v + size_px), slice(u, u + size_px)
            facing = normals[window][..., 1]
            if on_face[window].all() and np.ptp(facing) < 0.5:
                rendered, known = (detail(image[window]) for image in (picture, factor))
                assert np.corrcoef(rendered.ravel(), known.ravel())[0, 1] > 0.9
                shifts.append(
                    cv2.phaseCorrelate(rendered, known, cv2.createHanningWindow((size_px, size_px), cv2.CV_32F))[0]
                )
    assert len(shifts) >= 2
    assert np.linalg.norm(shifts, axis=1).max() < 0.4 and np.linalg.norm(np.mean(shifts, axis=0)) < 0.15


def detail(image):
    """What is finer than 8 pixels."""
    image = image.astype(np.float32)
    return image - cv2.GaussianBlur(image, (0, 0), 8)


def test_the_texture_goes_with_the_part():
    """The same places of the part, found by rays from above, for two placings; 0.01: 8 bits, single precision."""
    found = []
    rng = np.random.default_rng(1)
    places_part = np.column_stack([rng.uniform(-0.14, 0.14, 500), rng.uniform(-0.07, 0.07, 500), np.full(500, 0.2)])
    for T_base_part in (translation([0, 0, 0]), rigid_from(Rotation.from_euler("z", 2.2), np.array([1.0, -0.4, 0.3]))):
        _, model, data = plate_scene(T_base_part, "brushed")
        hits = RayCaster(model).cast(data, T_base_part.apply(places_part), np.tile([0, 0, -1.0], (500, 1)))
        found.append(SceneTextures(model).factor(data, hits.points, hits.normals, hits.geom_id))
    np.testing.assert_allclose(found[0], found[1], atol=0.01)
    assert found[0].std() > 0.03


def test_the_model_holds_the_parts_own_texture():
    plate, model, data = plate_scene(translation([0, 0, 0]))
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-0.1, 0.1, 200), rng.uniform(-0.07, -0.05, 200), np.full(200, 0.06)])
    up, geom = np.tile([0, 0, 1.0], (200, 1)), np.full(200, model.geom("v_groove_plate").id)
    from_model = SceneTextures(model).factor(data, points, up, geom)
    np.testing.assert_allclose(from_model, plate.texture.factor(points, up), atol=1e-12)


def test_places_without_texture_are_plain(scene):
    model, data = scene('<geom size=".1"/>')
    up = np.array([[0, 0, 1.0]])
    assert SceneTextures(model).factor(data, 0.1 * up, up, np.array([0])).tolist() == [1.0]
    _, model, data = plate_scene(translation([0, 0, 0]))
    assert SceneTextures(model).factor(data, np.nan * up, np.nan * up, np.array([-1])).tolist() == [1.0]

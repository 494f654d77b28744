"""The sensor head: its optical layout, and that it blocks neither view nor light nor torch."""

import mujoco
import numpy as np
import pytest
from manifold3d import Manifold

from weldcell.models.sensor_head import (
    LASER_SOURCE_CAMERA,
    SENSOR_MASS_KG,
    T_FLANGE_CAMERA,
    build_sensor_head,
    head_pieces,
)
from weldcell.models.torch import T_FLANGE_TORCH, torch_pieces

CROSSING_CAMERA = np.array([0, 0, 0.275])
FALL_M = 0.275 / np.sqrt(2)  # from the laser source to the crossing
WINDOW_M = 0.0225  # just outside the windows, from camera centre and laser source


@pytest.fixture(scope="module")
def head():
    return [piece.solid for piece in head_pieces()]


@pytest.fixture(scope="module")
def torch():
    return [piece.solid for piece in torch_pieces()]


def in_flange(points_camera):
    return T_FLANGE_CAMERA.apply(np.asarray(points_camera, float))


def test_camera_stands_where_the_design_says():
    T_torch_camera = T_FLANGE_TORCH.inv() * T_FLANGE_CAMERA
    root = np.sqrt(2)
    np.testing.assert_allclose(T_torch_camera.translation, [0.060 + 0.275 / root, 0, 0.025 - 0.275 / root], atol=1e-12)
    expected = np.array([[0, 1 / root, -1 / root], [-1, 0, 0], [0, 1 / root, 1 / root]])
    np.testing.assert_allclose(T_torch_camera.rotation.as_matrix(), expected, atol=1e-12)
    np.testing.assert_allclose(T_torch_camera.apply(CROSSING_CAMERA), [0.060, 0, 0.025], atol=1e-12)


def test_laser_source_lies_in_the_light_plane_above_the_crossing():
    """The plane n.p = d with n = (0, -1, 1)/sqrt 2 and d = 0.275/sqrt 2; 0.275 cos 45 from the crossing."""
    assert np.array([0, -1, 1]) @ LASER_SOURCE_CAMERA == pytest.approx(0.275, abs=1e-12)
    assert np.linalg.norm(CROSSING_CAMERA - LASER_SOURCE_CAMERA) == pytest.approx(0.275 / np.sqrt(2), abs=1e-12)
    source_torch = (T_FLANGE_TORCH.inv() * T_FLANGE_CAMERA).apply(LASER_SOURCE_CAMERA)
    np.testing.assert_allclose(source_torch, [0.060, 0, 0.025 - 0.275 / np.sqrt(2)], atol=1e-12)


def test_sites_are_camera_and_laser_source():
    model = build_sensor_head().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.site("camera").xpos, T_FLANGE_CAMERA.translation, atol=1e-12)
    np.testing.assert_allclose(data.site("laser_source").xpos, in_flange(LASER_SOURCE_CAMERA), atol=1e-12)
    assert set(model.geom_group) == {3}
    assert set(model.geom_contype) == {1}
    assert set(model.geom_conaffinity) == {2}
    assert model.body("sensor_head").mass[0] == pytest.approx(SENSOR_MASS_KG)


def view_cone():
    """What the camera sees from just outside its window to the light plane."""
    half_u, half_v = 720 / 3478, 540 / 3478  # half the picture over the focal length, px
    corners = np.array([[u * half_u, v * half_v, 1] for u in (-1, 1) for v in (-1, 1)])
    depth_m = 0.275 / (corners[:, 2] - corners[:, 1])  # where each corner ray meets -y + z = 0.275
    far = corners * depth_m[:, None]
    return Manifold.hull_points(in_flange(np.concatenate([corners * WINDOW_M * 1.03, far])))


def light_fan(thickness_m=0.002):
    """The light sheet of 40 deg, from just outside the laser's window to 60 mm past the crossing."""
    along = (CROSSING_CAMERA - LASER_SOURCE_CAMERA) / FALL_M
    side, normal = np.array([1.0, 0, 0]), np.array([0, -1, 1]) / np.sqrt(2)
    points = [
        LASER_SOURCE_CAMERA + length * (along + s * np.tan(np.deg2rad(20)) * side) + n * thickness_m / 2 * normal
        for length in (WINDOW_M, FALL_M + 0.060)
        for s in (-1, 1)
        for n in (-1, 1)
    ]
    return Manifold.hull_points(in_flange(points))


@pytest.mark.parametrize("light", [view_cone, light_fan])
def test_nothing_stands_in_the_light(light, head, torch):
    beam = light()
    assert beam.volume() > 1e-6
    for solid in head + torch:
        assert (beam ^ solid).volume() < 1e-15  # m3


def test_housing_encloses_camera_and_laser_with_margin(head):
    housing = head[0] + head[1] + head[2]
    for centre_camera in (np.zeros(3), LASER_SOURCE_CAMERA):
        ball = Manifold.sphere(0.015, 32).translate(tuple(in_flange(centre_camera)))
        assert (ball - housing).volume() < 1e-12  # m3: 15 mm of housing all round


def test_head_keeps_clear_of_the_torch(head, torch):
    gap_m = min(a.min_gap(b, 0.1) for a in head for b in torch)
    assert gap_m > 0.001


def test_all_solids_are_closed(head):
    assert all(solid.volume() > 0 for solid in head)

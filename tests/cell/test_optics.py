"""The camera model against OpenCV and its own inverse; the light plane against hand-computed geometry."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import SENSOR_PRESETS
from weldcell.cell.errors import BadGeometry
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.sensor_sim.design import nominal_camera

OPENCV_PX = 1e-9  # px: both are the same formulas in double precision on numbers of order 1e3
ROUND_TRIP_PX = 1e-9  # px: Newton's method runs to 1e-14 of normalised units, times a focal length of 3.5e3 px

coefficient = st.floats(-1, 1)
SCALES = np.array([0.2, 0.2, 2e-3, 2e-3, 0.1, 0.1, 0.1, 0.05, 2e-3, 2e-3, 2e-3, 2e-3, 0.15, 0.15])


@st.composite
def cameras(draw) -> CameraModel:
    return CameraModel(
        width_px=1440,
        height_px=1080,
        focal_px=np.array([3478.0, 3478.0]) * (1 + 0.1 * draw(coefficient)),
        principal_px=np.array([719.5, 539.5]) + 100 * np.array([draw(coefficient), draw(coefficient)]),
        distortion=SCALES * np.array([draw(coefficient) for _ in SCALES]),
    )


def points_in_view(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(-0.05, 0.05, 200), rng.uniform(-0.04, 0.04, 200), rng.uniform(0.2, 0.35, 200)])


def sensor_grid(camera: CameraModel) -> np.ndarray:
    """Pixels over the whole sensor, out to its border."""
    u, v = np.meshgrid(np.linspace(-0.5, camera.width_px - 0.5, 25), np.linspace(-0.5, camera.height_px - 0.5, 19))
    return np.column_stack([u.ravel(), v.ravel()])


@given(cameras())
@settings(max_examples=50, deadline=None)
def test_project_agrees_with_opencv_for_all_fourteen_coefficients(camera):
    points = points_in_view()
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0][:, 0]
    assert np.abs(camera.project(points) - expected).max() < OPENCV_PX


@given(cameras())
@settings(max_examples=50, deadline=None)
def test_unproject_inverts_project_over_the_whole_sensor(camera):
    pixels = sensor_grid(camera)
    rays = camera.unproject(pixels)
    found = np.isfinite(rays).all(axis=1)
    assert found.mean() > 0.99  # beyond the fold of a strong lens a pixel has no ray
    assert np.abs(camera.project(rays[found]) - pixels[found]).max() < ROUND_TRIP_PX


@pytest.mark.parametrize("name", list(SENSOR_PRESETS))
def test_each_preset_sees_with_its_whole_sensor(name):
    camera = nominal_camera(SENSOR_PRESETS[name])
    pixels = sensor_grid(camera)
    rays = camera.unproject(pixels)
    assert np.isfinite(rays).all()
    again = cv2.projectPoints(0.3 * rays, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0][:, 0]
    assert np.abs(again - pixels).max() < OPENCV_PX
    assert np.abs(camera.project(rays) - pixels).max() < ROUND_TRIP_PX


@pytest.mark.parametrize("seed", range(6))
def test_strong_wide_angle_lenses_give_back_the_rays_that_made_the_picture(seed):
    """Twice the usual coefficients, tilts up to 17 degrees, fields up to 60: every ray up to the lens's fold."""
    rng = np.random.default_rng(seed)
    camera = CameraModel(
        width_px=1440,
        height_px=1080,
        focal_px=rng.uniform(1200, 4000, 2),
        principal_px=np.array([719.5, 539.5]) + rng.uniform(-100, 100, 2),
        distortion=2 * SCALES * rng.uniform(-1, 1, 14),
    )
    away, turn = np.meshgrid(np.linspace(0, 1, 80), np.linspace(0, 2 * np.pi, 60))
    normalised = away[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    upright = np.linalg.det(camera.distortion_jacobian(normalised)) > 0.02  # below, a pixel hardly fixes its ray
    rays = np.concatenate([normalised, np.ones_like(away)[..., None]], axis=-1)
    pixels = cv2.projectPoints(rays.reshape(-1, 3), np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0]
    pixels = pixels.reshape(normalised.shape)
    wanted = np.logical_and.accumulate(upright, axis=1) & camera.in_picture(pixels)
    found = camera.unproject(pixels[wanted])
    assert wanted.sum() > 1000
    np.testing.assert_allclose(found, rays[wanted], rtol=0, atol=1e-11)  # 1e-13 over the least slope
    assert np.abs(camera.project(found) - pixels[wanted]).max() < ROUND_TRIP_PX


@given(cameras())
@settings(max_examples=20, deadline=None)
def test_distortion_jacobian_agrees_with_differences_of_opencv(camera):
    rays, step = points_in_view() / points_in_view()[:, 2:], 1e-6
    zero, columns = np.zeros(3), []
    for shift in step * np.eye(3)[:2]:
        before, after = (
            cv2.projectPoints(rays + sign * shift, zero, zero, camera.matrix, camera.distortion)[0][:, 0]
            for sign in (-1, 1)
        )
        columns.append((after - before) / (2 * step * camera.focal_px))
    # rounding 1e-16 and a curvature of order 1 over the step
    np.testing.assert_allclose(camera.distortion_jacobian(rays[:, :2]), np.stack(columns, axis=-1), atol=1e-8)


@given(cameras())
@settings(max_examples=20, deadline=None)
def test_slopes_of_unprojected_pixels_are_those_of_the_distortion_there(camera):
    for one in (camera, replace(camera, distortion=np.zeros(14))):
        rays, slopes = one.unproject_with_slopes(sensor_grid(one))
        assert np.array_equal(rays, one.unproject(sensor_grid(one)), equal_nan=True)
        found = np.isfinite(rays).all(axis=1)
        expected = one.distortion_jacobian(rays[found, :2])
        np.testing.assert_allclose(slopes[found], expected, rtol=0, atol=1e-13)  # rounding, some ulp


@given(cameras())
@settings(max_examples=20, deadline=None)
def test_the_tilted_picture_plane_is_a_plane_with_even_pixels(camera):
    """Where OpenCV's rays pierce the plane of `picture_depth`, distances are those of the pixels."""
    tilted = replace(camera, distortion=np.concatenate([np.zeros(12), camera.distortion[12:]]))
    one, other = np.random.default_rng(1).uniform(0, 1440, (2, 100, 2))
    points = [tilted.unproject(pixels) * tilted.picture_depth(pixels)[:, None] for pixels in (one, other)]
    distance_px = np.linalg.norm((one - other) / tilted.focal_px, axis=1)  # in principal distances
    np.testing.assert_allclose(np.linalg.norm(points[0] - points[1], axis=1), distance_px, rtol=1e-9)
    assert tilted.picture_depth(tilted.principal_px) == 1


def test_pixel_zero_is_the_centre_of_the_top_left_pixel():
    camera = CameraModel(width_px=4, height_px=2, focal_px=np.array([100.0, 100.0]), principal_px=np.zeros(2))
    assert np.array_equal(camera.project(np.array([0.0, 0.0, 1.0])), [0.0, 0.0])
    corners = np.array([[-0.5, -0.5], [3.49, 1.49], [3.5, 0.0], [0.0, -0.51]])
    assert camera.in_picture(corners).tolist() == [True, True, False, False]


def test_points_behind_the_camera_have_no_pixel():
    camera = CameraModel(width_px=4, height_px=2, focal_px=np.array([100.0, 100.0]), principal_px=np.zeros(2))
    assert np.isnan(camera.project(np.array([[0.0, 0.0, -1.0], [0.1, 0.0, 0.0]]))).all()


def test_a_pixel_beyond_the_lens_fold_has_no_ray():
    # x (1 - x^2) is at most 2 / (3 sqrt 3) = 0.385: a pixel at 0.4 focal lengths is seen by no ray.
    distortion = np.zeros(14)
    distortion[0] = -1.0
    camera = CameraModel(
        width_px=2000,
        height_px=2000,
        focal_px=np.array([1000.0, 1000.0]),
        principal_px=np.array([1000.0, 1000.0]),
        distortion=distortion,
    )
    rays = camera.unproject(np.array([[1400.0, 1000.0], [1300.0, 1000.0]]))
    assert np.isnan(rays[0]).all()
    assert np.isfinite(rays[1]).all()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"focal_px": np.array([0.012, 0.012])}, "not metres"),
        ({"focal_px": np.array([np.nan, 3000.0])}, "focal_px"),
        ({"width_px": 0}, "no pixel"),
        ({"distortion": np.zeros(5)}, "distortion"),
    ],
)
def test_a_camera_that_is_none_is_refused_with_the_reason(changes, reason):
    given = {
        "width_px": 1440,
        "height_px": 1080,
        "focal_px": np.array([3478.0, 3478.0]),
        "principal_px": np.array([719.5, 539.5]),
    }
    with pytest.raises(BadGeometry, match=reason):
        CameraModel(**(given | changes))


def plane_45(offset_m: float = 0.275 / np.sqrt(2)) -> LaserPlane:
    return LaserPlane(normal_camera=np.array([0.0, -1.0, 1.0]) / np.sqrt(2), offset_m=offset_m)


def test_the_axis_meets_a_45_degree_plane_where_paper_one_says():
    # P1 Eq. 2 with cot(theta) = 1: depth f b / (f cot theta - x), here b = 0.275 m: on the axis z = b.
    assert np.allclose(plane_45().intersect(np.array([0.0, 0.0, 1.0])), [0, 0, 0.275], atol=1e-15)
    ray = np.array([0.1, 0.2, 1.0])  # in the camera's y the plane rises: z = b / (1 - y/z)
    assert np.allclose(plane_45().intersect(ray), ray * 0.275 / (1 - 0.2), atol=1e-15)


def test_the_laser_frame_lies_in_the_plane_and_deeper_is_larger_z():
    plane = plane_45()
    points_camera = plane.intersect(np.array([[0.0, 0.0, 1.0], [0.1, 0.1, 1.0], [-0.1, -0.1, 1.0]]))
    points_laser = plane.T_camera_laser.inv().apply(points_camera)
    assert np.abs(points_laser[:, 1]).max() < 1e-15
    assert points_laser[1, 2] > points_laser[0, 2] > points_laser[2, 2]
    assert points_laser[1, 0] > 0
    assert np.allclose(plane.T_camera_laser.inv().apply([0, 0, 0])[1], plane.offset_m)  # the camera is at +y


def test_the_laser_frame_of_a_stripe_along_columns_turns_with_the_light():
    """P1: the plane holds the camera's y, light goes towards +x and +z. By hand: x = -y of the camera."""
    plane = LaserPlane(normal_camera=np.array([-1.0, 0.0, 1.0]) / np.sqrt(2), offset_m=0.1)
    axes = plane.T_camera_laser.rotation.as_matrix()
    expected = np.column_stack([[0, -1, 0], np.array([1, 0, -1]) / np.sqrt(2), np.array([1, 0, 1]) / np.sqrt(2)])
    np.testing.assert_allclose(axes, expected, atol=1e-15)


def test_the_laser_frame_goes_with_the_camera_rolled_about_its_axis():
    """A sensor whose camera is mounted rolled has the same laser frame, seen from outside."""
    for roll_rad in np.linspace(-3, 3, 7):
        roll = Rotation.from_euler("z", roll_rad)
        rolled = LaserPlane(normal_camera=roll.apply(plane_45().normal_camera), offset_m=plane_45().offset_m)
        expected = roll.as_matrix() @ plane_45().T_camera_laser.rotation.as_matrix()
        np.testing.assert_allclose(rolled.T_camera_laser.rotation.as_matrix(), expected, atol=1e-12)


def test_a_plane_across_the_axis_has_no_laser_frame():
    with pytest.raises(BadGeometry, match="across the camera's axis"):
        _ = LaserPlane(normal_camera=np.array([0.0, 0.0, 1.0]), offset_m=0.1).T_camera_laser


def test_a_ray_that_never_meets_the_plane_has_no_point():
    assert np.isnan(plane_45().intersect(np.array([0.0, 1.0, 1.0]))).all()


@pytest.mark.parametrize(
    ("normal", "offset_m", "reason"),
    [([0, 0, 2.0], 0.1, "unit"), ([0, 0, 1.0], -0.1, "turn the normal"), ([0, np.nan, 1.0], 0.1, "finite")],
)
def test_a_plane_that_is_none_is_refused_with_the_reason(normal, offset_m, reason):
    with pytest.raises(BadGeometry, match=reason):
        LaserPlane(normal_camera=np.array(normal), offset_m=offset_m)

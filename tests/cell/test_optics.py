"""The camera model against OpenCV and its own inverse; the light plane against hand-computed geometry."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from weldcell.cell.errors import BadGeometry
from weldcell.cell.optics import CameraModel, LaserPlane

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


@given(cameras())
@settings(max_examples=50, deadline=None)
def test_project_agrees_with_opencv_for_all_fourteen_coefficients(camera):
    points = points_in_view()
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0][:, 0]
    assert np.abs(camera.project(points) - expected).max() < OPENCV_PX


@given(cameras())
@settings(max_examples=50, deadline=None)
def test_unproject_inverts_project_over_the_whole_sensor(camera):
    u, v = np.meshgrid(np.linspace(0, 1439, 25), np.linspace(0, 1079, 19))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    rays = camera.unproject(pixels)
    found = np.isfinite(rays).all(axis=1)
    assert found.mean() > 0.99  # beyond the fold of a strong lens a pixel has no ray
    assert np.abs(camera.project(rays[found]) - pixels[found]).max() < ROUND_TRIP_PX


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


def test_a_ray_that_never_meets_the_plane_has_no_point():
    assert np.isnan(plane_45().intersect(np.array([0.0, 1.0, 1.0]))).all()


@pytest.mark.parametrize(
    ("normal", "offset_m", "reason"),
    [([0, 0, 2.0], 0.1, "unit"), ([0, 0, 1.0], -0.1, "turn the normal"), ([0, np.nan, 1.0], 0.1, "finite")],
)
def test_a_plane_that_is_none_is_refused_with_the_reason(normal, offset_m, reason):
    with pytest.raises(BadGeometry, match=reason):
        LaserPlane(normal_camera=np.array(normal), offset_m=offset_m)

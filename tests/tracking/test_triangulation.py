"""Stripe points become points of the light plane."""

import numpy as np
import pytest

from tracking.fabricated_profiles import p2_camera, p2_plane
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import Stripe
from weldcell.tracking.triangulation import noise_slopes, triangulate

BENT = np.array([-0.1, 0.15, 5e-4, -3e-4, 0.0, 0, 0, 0, 0, 0, 0, 0, 0.02, -0.01])


def _stripe(sigma_px=0.25):
    u_px = np.arange(0.0, 1440.0, 3)
    return Stripe(u_px=u_px, v_px=540 + 400 * np.sin(u_px / 200), sigma_px=np.full(len(u_px), sigma_px))


def test_the_crossing_point_lies_275_mm_ahead():
    camera, plane = p2_camera(), p2_plane()
    stripe = Stripe(u_px=np.array([724.3]), v_px=np.array([533.8]), sigma_px=np.array([0.1]))
    profile = triangulate(stripe, camera, plane)
    assert np.allclose(profile.points_camera, [[0, 0, 0.275]], atol=1e-12)  # m; rounding
    # One pixel is 0.275 / 3478.26 m across; along light that meets the axis at 45 deg it is sqrt(2) times that.
    assert profile.sigma_m[0] == pytest.approx(0.1 * np.sqrt(2) * 0.275 / 3478.26, rel=1e-4)


@pytest.mark.parametrize("distortion", [None, BENT], ids=["pinhole", "distorted and tilted"])
def test_points_lie_in_the_plane_and_project_back(distortion):
    camera, plane, stripe = p2_camera(distortion), p2_plane(), _stripe()
    profile = triangulate(stripe, camera, plane)
    assert profile.valid.all()
    assert np.abs(plane.distance_m(profile.points_camera)).max() < 1e-12  # m; rounding
    back_px = camera.project(profile.points_camera)
    assert np.abs(back_px - np.column_stack([stripe.u_px, stripe.v_px])).max() < 1e-8  # px; Newton's tolerance


@pytest.mark.parametrize("distortion", [None, BENT], ids=["pinhole", "distorted and tilted"])
def test_sigma_and_noise_direction_match_a_moved_stripe(distortion):
    camera, plane, stripe = p2_camera(distortion), p2_plane(), _stripe()
    moved = Stripe(u_px=stripe.u_px, v_px=stripe.v_px + 0.01, sigma_px=stripe.sigma_px)
    before, after = (triangulate(s, camera, plane).points_camera for s in (stripe, moved))
    sigma_m = triangulate(stripe, camera, plane).sigma_m
    step = plane.T_camera_laser.rotation.inv().apply(after - before)
    assert np.allclose(sigma_m, 0.25 * np.abs(step[:, 2]) / 0.01, rtol=0.01)  # 1 %: second order, and lens shear
    assert np.abs(step[:, 0] / step[:, 2] - noise_slopes(before, plane)).max() < 0.02  # rad; lens distortion


def test_a_camera_rolled_by_a_quarter_turn_measures_the_same_profile():
    """Rolled, its x is the other's y and its y the other's -x: the stripe runs along its columns."""
    camera, plane, stripe = p2_camera(), p2_plane(), _stripe()
    rolled_camera = CameraModel(
        width_px=1080,
        height_px=1440,
        focal_px=camera.focal_px,
        principal_px=np.array([533.8, 1439 - 724.3]),
    )
    x, y, z = plane.normal_camera
    rolled_plane = LaserPlane(normal_camera=np.array([y, -x, z]), offset_m=plane.offset_m)
    rolled_stripe = Stripe(u_px=stripe.v_px, v_px=1439 - stripe.u_px, sigma_px=stripe.sigma_px)
    plain, rolled = triangulate(stripe, camera, plane), triangulate(rolled_stripe, rolled_camera, rolled_plane)
    points_laser = plane.T_camera_laser.inv().apply(plain.points_camera)
    rolled_laser = rolled_plane.T_camera_laser.inv().apply(rolled.points_camera)
    assert np.allclose(rolled_laser, points_laser, atol=1e-12)  # m; rounding
    assert np.allclose(rolled.sigma_m, plain.sigma_m, rtol=1e-12)  # rounding
    rolled_slopes, slopes = noise_slopes(rolled.points_camera, rolled_plane), noise_slopes(plain.points_camera, plane)
    assert np.allclose(rolled_slopes, slopes, atol=1e-12)


def test_points_out_of_range_are_not_valid():
    camera, plane, stripe = p2_camera(), p2_plane(), _stripe()
    everything = triangulate(stripe, camera, plane)
    some = triangulate(stripe, camera, plane, depth_range_m=(0.26, 0.29))
    depth_m = everything.points_camera[:, 2]
    assert np.array_equal(some.valid, (depth_m >= 0.26) & (depth_m <= 0.29))
    assert np.isnan(some.points_camera[~some.valid]).all() and np.isnan(some.sigma_m[~some.valid]).all()
    assert some.reason == ""


def test_nothing_in_range_has_a_reason():
    profile = triangulate(_stripe(), p2_camera(), p2_plane(), depth_range_m=(0.01, 0.02))
    assert not profile.valid.any() and "range" in profile.reason


def test_no_stripe_has_a_reason():
    empty = Stripe(u_px=np.zeros(0), v_px=np.zeros(0), sigma_px=np.zeros(0))
    profile = triangulate(empty, p2_camera(), p2_plane())
    assert profile.points_camera.shape == (0, 3) and profile.reason == "no stripe in the picture"

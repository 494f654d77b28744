"""The light plane from boards, lines and steps: exact recovery, agreement with P1's table, honest covariance."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import fabricated_boards as made
from weldcell.calib import dual_step, laser_plane, vanishing_point
from weldcell.calib.board_bundle import StripePoints
from weldcell.calib.camera import FREE
from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import LaserPlane

ROUGH = LaserPlane(
    normal_camera=np.array([0.02, -1.0, 1.03]) / np.linalg.norm([0.02, -1.0, 1.03]), offset_m=0.196
)  # 1.3 deg and 1.6 mm off, as a drawing would be


def boards(seed=1, count=6, corner_px=0.0, stripe_px=0.0, poses=None, **settings):
    rng = np.random.default_rng(seed)
    poses = made.board_poses(rng, count) if poses is None else poses
    return laser_plane.LaserPlaneProblem(
        camera=settings.pop("camera", made.CAMERA),
        corners=made.corners(rng, poses, corner_px),
        stripe=made.stripe(rng, poses, stripe_px),
        corner_sigma_px=max(corner_px, 0.01),
        **settings,
    )


def lines(seed=1, sigma_px=0.0, places_m=(-0.015, 0.015), count=10):
    pixels = made.line_crossings(
        np.random.default_rng(seed),
        made.CAMERA_P1,
        made.PLANE_P1,
        np.linspace(0.065, 0.16, count),
        places_m,
        1,
        sigma_px,
    )
    spacing_m = abs(places_m[1] - places_m[0])
    return vanishing_point.VanishingPointProblem(
        camera=made.CAMERA_P1, pixels=pixels, spacing_m=spacing_m, sigma_px=max(sigma_px, 0.01)
    )


def steps(seed=1, count=4, sigma_px=0.0, edge_px=0.0):
    targets = made.step_targets(np.random.default_rng(seed), count, sigma_px, edge_px)
    return dual_step.DualStepProblem(camera=made.CAMERA, targets=targets, start=ROUGH)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("method", ["board", "bundle"])
def test_exact_boards_give_the_plane_exactly(seed, method):
    result = laser_plane.solve(boards(seed, method=method))
    assert result.verdict == "accepted"
    assert np.abs(made.plane_offsets(result.plane, made.PLANE)).max() < 1e-9  # rad and m


def test_exact_boards_give_plane_and_intrinsics_together():
    result = laser_plane.solve(boards(3, count=8, free=FREE["plain"]))
    assert np.abs(made.plane_offsets(result.plane, made.PLANE)).max() < 1e-9
    np.testing.assert_allclose(result.camera.focal_px, made.CAMERA.focal_px, rtol=1e-9)


@pytest.mark.parametrize("places_m", [(-0.015, 0.015), (0.02, -0.02), (-0.02, -0.01, 0.0, 0.01, 0.02)])
def test_exact_crossings_give_the_vanishing_point_of_paper_one(places_m):
    result = vanishing_point.solve(lines(places_m=places_m))
    angle_rad, base_m = laser_plane.angle_and_base(result.plane)
    assert angle_rad == pytest.approx(made.ANGLE_P1_RAD, abs=1e-9)
    assert base_m == pytest.approx(made.BASE_P1_M, abs=1e-9)
    # P1: cot(theta) = x_inf / f; x_inf = 6.9122 mm on its chip is, to the digits printed, 6.7595 mm / tan(44.37 deg)
    x_inf_mm = (result.vanishing_px[0] - made.CAMERA_P1.principal_px[0]) * 5.2e-3
    assert x_inf_mm == pytest.approx(6.9122, abs=0.003)
    closed_rad, closed_m = laser_plane.angle_and_base(result.closed_form)
    assert closed_rad == pytest.approx(made.ANGLE_P1_RAD, abs=1e-9) and closed_m == pytest.approx(
        made.BASE_P1_M, abs=1e-9
    )


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("count", [1, 4])
def test_exact_steps_give_the_plane_exactly(seed, count):
    result = dual_step.solve(steps(seed, count))
    assert result.verdict == "accepted"
    assert np.abs(made.plane_offsets(result.plane, made.PLANE)).max() < 1e-9


@pytest.mark.parametrize(("sigma_px", "limit_deg"), [(0.1, 0.015), (0.3, 0.04)])
def test_vanishing_point_angle_is_as_good_as_the_noise_allows(sigma_px, limit_deg):
    errors = []
    for seed in range(30):
        angle_rad, _ = laser_plane.angle_and_base(vanishing_point.solve(lines(seed, sigma_px)).plane)
        errors.append(np.degrees(abs(angle_rad - made.ANGLE_P1_RAD)))
    assert np.median(errors) < limit_deg


@pytest.mark.parametrize("kind", ["board", "bundle", "vanishing_point", "dual_step"])
def test_predicted_spread_of_the_plane_is_what_noise_makes(kind):
    poses = made.board_poses(np.random.default_rng(11), 6)
    scores = []
    for seed in range(16):
        if kind == "vanishing_point":
            result, truth = vanishing_point.solve(lines(seed, 0.2, np.linspace(-0.02, 0.02, 6))), made.PLANE_P1
        elif kind == "dual_step":
            result, truth = dual_step.solve(steps(seed, 3, 0.1, 0.3)), made.PLANE
        else:
            result = laser_plane.solve(boards(seed, corner_px=0.1, stripe_px=0.2, poses=poses, method=kind))
            truth = made.PLANE
        error = made.plane_offsets(result.plane, truth)
        scores.append(error @ np.linalg.solve(result.covariance, error))
    # chi square of 3 degrees over 16 trials: mean 3, standard deviation sqrt(6 / 16) = 0.6
    assert 1.4 < np.mean(scores) < 4.8


def test_the_bundle_beats_the_plane_fit_on_the_same_pictures():
    errors = {"board": [], "bundle": []}
    for seed in range(8):
        for method, found in errors.items():
            plane = laser_plane.solve(boards(seed, corner_px=0.1, stripe_px=0.2, method=method)).plane
            found.append(laser_plane.agreement(made.CAMERA, made.PLANE, made.CAMERA, plane).plane_rms_m)
    assert np.median(errors["bundle"]) <= np.median(errors["board"])


def test_wrong_stripe_points_do_not_move_the_plane():
    good = boards(4, corner_px=0.1, stripe_px=0.2)
    pixels = good.stripe.pixels.copy()
    pixels[::4, 1] += 30.0  # a quarter of them on a reflection
    stripe = dataclasses.replace(good.stripe, pixels=pixels)
    clean, soiled = (laser_plane.solve(dataclasses.replace(good, stripe=s)) for s in (good.stripe, stripe))
    moved = laser_plane.agreement(made.CAMERA, clean.plane, made.CAMERA, soiled.plane)
    assert moved.plane_rms_m < 0.25e-3  # 30 px are 4 mm


def test_boards_that_cut_the_light_in_one_line_are_refused():
    """Boards turned about their common line with the light tell nothing about the plane's turn around it."""
    rng = np.random.default_rng(5)
    along = np.array([1.0, 0.0, 0.0])
    foot = made.PLANE.intersect(np.array([0.0, 0.0, 1.0]))
    turns = Rotation.from_rotvec(np.linspace(-0.6, 0.5, 6)[:, None] * along)
    poses = rigid_from(turns, foot - turns.apply(made.BOARD.mean(axis=0)))
    result = laser_plane.solve(
        laser_plane.LaserPlaneProblem(
            camera=made.CAMERA, corners=made.corners(rng, poses, 0.0), stripe=made.stripe(rng, poses, 0.0)
        )
    )
    assert result.verdict == "refused"
    assert "one line" in result.reasons[0]


def test_parallel_boards_cannot_give_intrinsics_and_plane_together():
    rng = np.random.default_rng(6)
    shift = rng.uniform([-0.045, -0.035, 0.26], [-0.04, -0.03, 0.30], (6, 3))
    poses = rigid_from(Rotation.from_euler("xyz", np.zeros((6, 3))), shift)
    result = laser_plane.solve(boards(6, corner_px=0.1, stripe_px=0.2, poses=poses, free=FREE["plain"]))
    assert result.verdict == "refused"
    assert "focal length" in " ".join(result.reasons)


def test_agreement_takes_out_a_turn_of_the_camera_frame():
    turn = Rotation.from_rotvec([1e-3, -2e-3, 0.0])
    f = made.CAMERA_P1.focal_px[0]
    turned = LaserPlane(normal_camera=turn.apply(made.PLANE_P1.normal_camera), offset_m=made.PLANE_P1.offset_m)
    # Rays turned by (1, -2) mrad are, to first order, a principal point that is off by (2, 1) mrad times f.
    camera = dataclasses.replace(made.CAMERA_P1, principal_px=made.CAMERA_P1.principal_px + f * np.array([2e-3, 1e-3]))
    found = laser_plane.agreement(made.CAMERA_P1, made.PLANE_P1, camera, turned)
    assert found.frame_rad == pytest.approx(np.sqrt(5) * 1e-3, rel=0.1)
    assert found.normal_rad < 3e-4  # second order of the picture's half angle (26 deg) is left


def test_a_stripe_without_its_board_is_refused_by_name():
    good = boards(7)
    stripe = StripePoints(pixels=good.stripe.pixels, picture=good.stripe.picture + 1, sigma_px=good.stripe.sigma_px)
    with pytest.raises(BadInput, match="stripe but no board"):
        dataclasses.replace(good, stripe=stripe)


def test_a_step_target_without_ends_is_refused_by_picture():
    good = steps(8, 3)
    edges = np.where(good.targets.picture == 1, np.nan, good.targets.edge_m)
    with pytest.raises(BadInput, match=r"picture 1 .* has 0 ends"):
        dataclasses.replace(good, targets=dataclasses.replace(good.targets, edge_m=edges))

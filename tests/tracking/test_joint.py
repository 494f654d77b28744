"""The V-groove's left edge, root and right edge."""

import numpy as np
import pytest

from tracking.fabricated_profiles import p2_camera, p2_plane, shifted, stripe_of_corners, v_corners
from weldcell.cell.errors import BadInput
from weldcell.cell.profile import Profile, Stripe
from weldcell.tracking.joint import find_joint
from weldcell.tracking.triangulation import triangulate

CAMERA, PLANE = p2_camera(), p2_plane()
GROOVES = {
    "P2's plate": {"depth_m": 0.06, "z_m": 0.155},
    "3 mm deep": {"depth_m": 0.003, "z_m": 0.2},
    "aside": {"depth_m": 0.02, "z_m": 0.2, "x_m": -0.035},
    "tilted left": {"depth_m": 0.03, "z_m": 0.18, "tilt_rad": np.deg2rad(-20)},
    "tilted right": {"depth_m": 0.03, "z_m": 0.18, "tilt_rad": np.deg2rad(20)},
    "wide": {"depth_m": 0.015, "z_m": 0.18, "groove_angle_rad": np.deg2rad(120)},
}


def _profile(corners, noise_px=0.0, rng=None, change=lambda stripe: stripe):
    stripe = stripe_of_corners(corners, CAMERA, PLANE, sigma_px=max(noise_px, 1e-3))
    if noise_px:
        stripe = shifted(stripe, rng.normal(0, noise_px, len(stripe.u_px)))
    return triangulate(change(stripe), CAMERA, PLANE)


def _corners_of(features):
    """In the laser frame, by rising x: from the right edge to the left one."""
    return PLANE.T_camera_laser.inv().apply(features.points_camera)[::-1, [0, 2]]


def _strays(share, span_px, rng):
    def add(stripe):
        stray = rng.random(len(stripe.u_px)) < share
        v_px = np.clip(stripe.v_px + stray * rng.uniform(-span_px, span_px, len(stray)), 0, 1079)
        return Stripe(u_px=stripe.u_px, v_px=v_px, sigma_px=stripe.sigma_px)

    return add


def _without(first_px, last_px):
    def cut(stripe):
        keep = (stripe.u_px < first_px) | (stripe.u_px > last_px)
        return Stripe(u_px=stripe.u_px[keep], v_px=stripe.v_px[keep], sigma_px=stripe.sigma_px[keep])

    return cut


@pytest.mark.parametrize("groove", GROOVES.values(), ids=GROOVES.keys())
def test_exact_points_give_the_exact_corners(groove):
    corners = v_corners(**groove)
    features = find_joint(_profile(corners), "v", PLANE)
    assert features.valid and features.names == ("left", "root", "right")
    assert np.abs(_corners_of(features) - corners[1:4]).max() < 1e-9  # m; solver precision
    assert np.abs(PLANE.distance_m(features.points_camera)).max() < 1e-12  # m; rounding


@pytest.mark.parametrize("groove", GROOVES.values(), ids=GROOVES.keys())
def test_corners_scatter_as_predicted(groove):
    rng, corners = np.random.default_rng(7), v_corners(**groove)
    features = [find_joint(_profile(corners, 0.25, rng), "v", PLANE) for _ in range(60)]
    assert all(one.valid for one in features)
    errors = np.array([_corners_of(one) for one in features]) - corners[1:4]
    actual_m = np.sqrt((errors**2).sum(axis=2).mean(axis=0))
    predicted_m = np.mean([one.sigma_m[::-1] for one in features], axis=0)
    assert np.all(np.abs(np.log(actual_m / predicted_m)) < np.log(1.4))  # 60 draws fix a ratio to 13 %, three sigma
    assert np.all(np.abs(errors.mean(axis=0)).max(axis=1) < 4 * predicted_m / np.sqrt(60))  # no bias


@pytest.mark.parametrize("depth_m", [0.06, 0.02])
def test_thirty_percent_strays_do_not_matter(depth_m):
    rng = np.random.default_rng(8)
    corners = v_corners(depth_m=depth_m, z_m=0.155)
    for _ in range(20):
        features = find_joint(_profile(corners, 0.25, rng, _strays(0.3, 100, rng)), "v", PLANE)
        assert features.valid
        distance_m = np.linalg.norm(_corners_of(features) - corners[1:4], axis=1)
        assert np.all(distance_m < 4.5 * features.sigma_m)  # as good as the remaining points allow


def test_the_table_beside_the_plate_does_not_matter():
    corners = v_corners(z_m=0.155)
    inner = [[-0.055, 0.155], *corners[1:4].tolist(), [0.05, 0.155]]
    around = np.array([[-0.08, 0.225], [-0.0551, 0.225], *inner, [0.0501, 0.225], [0.08, 0.225]])
    features = find_joint(_profile(around, 0.25, np.random.default_rng(9)), "v", PLANE)
    assert features.valid
    assert np.linalg.norm(_corners_of(features) - corners[1:4], axis=1).max() < 2e-5  # m; 5 sigma


@pytest.mark.parametrize("hidden", [(600, 680), (690, 760)], ids=["part of a wall", "the root"])
def test_a_hidden_part_does_not_matter(hidden):
    corners = v_corners(z_m=0.155)
    features = find_joint(_profile(corners, 0.25, np.random.default_rng(3), _without(*hidden)), "v", PLANE)
    assert features.valid
    assert np.linalg.norm(_corners_of(features) - corners[1:4], axis=1).max() < 2e-5  # m; 5 sigma


def test_left_is_left_of_the_travel_which_the_camera_looks_back_on():
    # Torch frame: x travel, z down, hence y to the right; camera x is -y of the torch, so left has the larger x.
    features = find_joint(_profile(v_corners(z_m=0.155)), "v", PLANE)
    assert np.all(np.diff(features.points_camera[:, 0]) < 0)


def test_a_mirrored_profile_swaps_left_and_right():
    profile = _profile(v_corners(depth_m=0.02, z_m=0.19, x_m=0.004, tilt_rad=0.1), 0.25, np.random.default_rng(4))
    mirrored = Profile(points_camera=profile.points_camera * [-1, 1, 1], sigma_m=profile.sigma_m, valid=profile.valid)
    features, turned = find_joint(profile, "v", PLANE), find_joint(mirrored, "v", PLANE)
    # 1 um: the splitting is not symmetric, so the fits start from slightly other pieces
    assert np.abs(turned.points_camera[::-1] * [-1, 1, 1] - features.points_camera).max() < 1e-6


@pytest.mark.parametrize(
    "corners",
    [
        [[-0.08, 0.19], [0.08, 0.19]],
        [[-0.05, 0.17], [0.0, 0.2], [0.05, 0.17]],
        [[-0.05, 0.19], [-0.01, 0.19], [0.0, 0.17], [0.01, 0.19], [0.05, 0.19]],
        [[-0.08, 0.2], [-0.0301, 0.2], [-0.03, 0.18], [0.03, 0.18], [0.0301, 0.2], [0.08, 0.2]],
    ],
    ids=["flat plate", "fillet", "ridge", "plate on a table"],
)
def test_what_is_no_v_is_not_found_and_says_why(corners):
    features = find_joint(_profile(np.array(corners), 0.25, np.random.default_rng(5)), "v", PLANE)
    assert not features.valid and "V-groove" in features.reason
    assert np.isnan(features.points_camera).all() and np.isnan(features.sigma_m).all()


def test_random_points_are_no_groove():
    rng = np.random.default_rng(6)
    for _ in range(20):
        flat = np.array([[-0.08, 0.19], [0.08, 0.19]])
        assert not find_joint(_profile(flat, 0.25, rng, _strays(1.0, 400, rng)), "v", PLANE).valid


def test_an_empty_profile_passes_its_reason_on():
    nothing = np.zeros(0)
    stripe = Stripe(u_px=nothing, v_px=nothing, sigma_px=nothing)
    features = find_joint(triangulate(stripe, CAMERA, PLANE), "v", PLANE)
    assert not features.valid and features.reason == "no stripe in the picture"


def test_the_last_frame_gates_the_next():
    near = find_joint(_profile(v_corners(depth_m=0.01, z_m=0.19, x_m=-0.03)), "v", PLANE)
    there = find_joint(_profile(v_corners(depth_m=0.01, z_m=0.19, x_m=-0.025)), "v", PLANE, previous=near)
    away = find_joint(_profile(v_corners(depth_m=0.01, z_m=0.19, x_m=0.0)), "v", PLANE, previous=near)
    assert there.valid and not away.valid and "15 mm" in away.reason


def test_an_unknown_kind_names_the_known_ones():
    with pytest.raises(BadInput, match=r"'w' is not known. Available: .*v"):
        find_joint(_profile(v_corners()), "w", PLANE)


@pytest.mark.parametrize("gap_m", [0.002, 0.005])
def test_with_a_root_gap_the_root_is_the_middle_between_the_walls_ends(gap_m):
    # A V of 45 degrees whose walls end 20 mm below the plates, the table 4 mm further down in the gap between them.
    half_m, depth_m, z_m = gap_m / 2, 0.020, 0.19
    edge_m = half_m + depth_m * np.tan(np.pi / 8)
    left = [[-edge_m - 0.03, z_m], [-edge_m, z_m], [-half_m, z_m + depth_m]]
    below = [[-half_m + 1e-5, z_m + depth_m + 0.004], [half_m - 1e-5, z_m + depth_m + 0.004]]
    corners = np.array([*left, *below, *([-x, z] for x, z in reversed(left))])
    features = find_joint(_profile(corners, 0.25, np.random.default_rng(9)), "v-gap", PLANE)
    assert features.valid
    right, root, left_edge = _corners_of(features)
    assert np.abs([right[0] + edge_m, left_edge[0] - edge_m]).max() < 5e-5  # m
    assert np.abs(root - [0, z_m + depth_m]).max() < 2.5e-4  # m: a column's spacing along the wall

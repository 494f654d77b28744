"""Planes of a scanned boss, its edges and its angles."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tracking.fabricated_profiles import boss_planes, boss_scan
from weldcell.tracking.boss import measure_boss
from weldcell.tracking.planes import fit_planes

SLOPE_RAD = np.deg2rad(53.13010235)  # 3-4-5 triangle


def _scan(seed=0, frames=120, columns=500, **kwargs):
    return boss_scan(frames=frames, columns=columns, rng=np.random.default_rng(seed), **kwargs)


def test_exact_points_give_the_exact_planes():
    planes = fit_planes(_scan())
    normals, offsets = boss_planes()
    assert len(planes) == 6
    for normal, offset in zip(normals, offsets, strict=True):
        nearest = min(planes, key=lambda p: np.linalg.norm(p.normal - normal) + abs(p.offset_m - offset))
        assert np.abs(nearest.normal - normal).max() < 1e-9 and abs(nearest.offset_m - offset) < 1e-10  # rounding
        assert nearest.rms_m < 1e-9


def test_exact_points_give_the_exact_boss():
    boss = measure_boss(fit_planes(_scan()))
    assert boss.valid
    assert np.allclose(boss.edge_lengths_m, 0.05, atol=1e-9)  # m
    assert np.allclose(boss.dihedral_angles_rad, SLOPE_RAD, atol=1e-9)
    # run 0.05 / sqrt(2 + 16/9) = 25.725 mm: the base is a square of 30 + 51.45 mm
    assert np.allclose(np.linalg.norm(np.diff(boss.base_corners, axis=0), axis=1), 0.0814496, atol=1e-6)
    assert np.allclose(np.linalg.norm(np.diff(boss.top_corners, axis=0), axis=1), 0.03, atol=1e-9)


def test_white_noise_averages_out():
    boss = measure_boss(fit_planes(_scan(noise_m=3e-5)))
    assert np.abs(boss.edge_lengths_m - 0.05).max() < 3e-5  # m; thousands of points a face
    assert np.rad2deg(np.abs(boss.dihedral_angles_rad - SLOPE_RAD)).max() < 0.03  # deg


def test_pose_noise_of_the_frames_is_the_limit():
    # 40 um of each frame's own: a face 20 mm wide in some 29 frames tilts by 40 um / (20 mm sqrt(29 / 12)) = 0.08 deg.
    boss = measure_boss(fit_planes(_scan(noise_m=3e-5, frame_noise_m=4e-5)))
    assert np.abs(boss.edge_lengths_m - 0.05).mean() < 1e-4  # m
    assert np.rad2deg(np.abs(boss.dihedral_angles_rad - SLOPE_RAD)).max() < 0.25  # deg; three sigma


def test_strays_do_not_matter():
    rng, points = np.random.default_rng(1), _scan(noise_m=3e-5)
    stray = rng.random(len(points)) < 0.3
    points[stray, 2] += rng.uniform(-0.01, 0.03, stray.sum())
    points[rng.random(len(points)) < 0.05] = np.nan
    boss = measure_boss(fit_planes(points))
    assert boss.valid and np.abs(boss.edge_lengths_m - 0.05).max() < 5e-5  # m


def test_the_measure_does_not_depend_on_where_the_boss_stands():
    points = _scan(noise_m=3e-5)
    turn = Rotation.from_euler("xyz", [0.2, -0.3, 1.1])
    towards = tuple(turn.apply([0.0, 0.0, 1.0]))
    here = measure_boss(fit_planes(points))
    there = measure_boss(fit_planes(turn.apply(points) + [0.9, 0.2, 0.3], towards=towards))
    # The cells lie differently, so each face loses other points at its rim: well below the noise of 5 um.
    assert np.allclose(np.sort(there.edge_lengths_m), np.sort(here.edge_lengths_m), atol=1e-5)  # m


def test_the_same_points_give_the_same_planes():
    points = _scan(noise_m=3e-5)
    first, second = fit_planes(points), fit_planes(points)
    assert all(
        np.array_equal(a.normal, b.normal) and a.offset_m == b.offset_m for a, b in zip(first, second, strict=False)
    )


def test_inliers_are_clear_of_the_edges():
    points = _scan(noise_m=3e-5)
    normals, offsets = boss_planes()
    for plane in fit_planes(points):
        own = np.argmin(np.linalg.norm(normals - plane.normal, axis=1) + np.abs(offsets - plane.offset_m))
        distance_m = np.abs(points[plane.inliers] @ normals[own] - offsets[own])
        assert distance_m.max() < 2e-4  # m; nothing of the neighbouring faces


def test_missing_faces_are_named():
    planes = fit_planes(_scan())
    slanted = [plane for plane in planes if plane.normal[2] < 0.9]
    boss = measure_boss([plane for plane in planes if plane is not slanted[0]])
    assert not boss.valid and "3 slanted faces" in boss.reason and np.isnan(boss.edge_lengths_m).all()
    assert "no base and top" in measure_boss(slanted).reason
    assert not measure_boss([]).valid


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((500, 3), np.nan), np.zeros((500, 3))])
def test_a_cloud_without_planes_gives_none(points):
    assert fit_planes(points) == []


def test_noise_is_no_boss():
    points = np.random.default_rng(2).uniform(-0.05, 0.05, (20000, 3))
    assert not measure_boss(fit_planes(points)).valid

"""The seam through noisy, gappy, spattered frames."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.errors import JobFailed
from weldcell.cell.seam import distance_to_polyline
from weldcell.tracking.seam_fit import fit_seam

FINE = np.linspace(-0.003, 0.303, 6001)


def _s_curve(x_m):
    """P2's S: 300 mm long, 15 mm to both sides."""
    return np.stack([0.9 + x_m, 0.015 * np.sin(2 * np.pi * x_m / 0.3), 0.3 + 0.002 * np.cos(np.pi * x_m / 0.3)], -1)


def _frames(noise_m, rng=None, count=300):
    root = _s_curve(np.linspace(0, 0.3, count))
    points = {"left": root + [0, 0.024, 0], "root": root, "right": root - [0, 0.024, 0]}
    return {name: rows + (rng.normal(0, noise_m, rows.shape) if noise_m else 0) for name, rows in points.items()}


def _error_m(seam):
    return distance_to_polyline(seam.points["root"], _s_curve(FINE))


def test_exact_points_give_the_exact_seam():
    seam = fit_seam(_frames(0))
    assert _error_m(seam).max() < 1e-7  # m; the spline between points 1 mm apart, and the polyline's own chords
    length_m = np.linalg.norm(np.diff(_s_curve(np.linspace(0, 0.3, 20001)), axis=0), axis=1).sum()
    assert seam.arc_length_m[-1] == pytest.approx(length_m, abs=1e-7)
    steps_m = np.linalg.norm(np.diff(seam.points["root"], axis=0), axis=1)
    assert np.abs(steps_m / np.diff(seam.arc_length_m) - 1).max() < 1e-4  # chords of arcs 100 mm in radius
    assert np.allclose(seam.points["left"] - seam.points["root"], [0, 0.024, 0], atol=1e-7)  # m


def test_smoothing_averages_the_noise_of_the_frames():
    rng = np.random.default_rng(0)
    errors_m = np.concatenate([_error_m(fit_seam(_frames(3e-5, rng))) for _ in range(4)])
    # An S needs some fifteen parameters: 30 um sqrt(15 / 300) = 7 um in each of two directions across.
    assert errors_m.mean() < 1.3e-5 and errors_m.max() < 6e-5  # m; the most at the ends


def test_a_straight_seam_is_drawn_straight():
    rng = np.random.default_rng(1)
    straight = np.stack([np.linspace(0, 0.3, 300), np.zeros(300), np.zeros(300)], -1)
    seam = fit_seam({"root": straight + rng.normal(0, 5e-5, straight.shape)})
    assert np.linalg.norm(seam.points["root"][:, 1:], axis=1).mean() < 1.2e-5  # m; 50 um sqrt(3 / 300) = 5 um an axis


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_strays_do_not_matter(share):
    rng = np.random.default_rng(2)
    frames = _frames(5e-5, rng)
    for rows in frames.values():
        stray = rng.random(len(rows)) < share
        rows[stray] += rng.normal(0, 2e-3, (stray.sum(), 3))
    error_m = _error_m(fit_seam(frames))
    assert error_m.mean() < 3e-5 and error_m.max() < 1.5e-4  # m; without strays 1.6e-5 and 5e-5


def test_frames_without_a_feature_are_bridged():
    rng = np.random.default_rng(3)
    frames = _frames(3e-5, rng)
    for name, rows in frames.items():
        rows[rng.random(300) < 0.2] = np.nan
        rows[{"left": slice(50, 80), "root": slice(120, 150), "right": slice(0, 10)}[name]] = np.nan
    seam = fit_seam(frames)
    assert np.isfinite(seam.points["right"]).all()
    assert _error_m(seam).mean() < 3e-5 and _error_m(seam).max() < 2e-4  # m; 30 mm of curve without a point


def test_precise_frames_count_more():
    rng = np.random.default_rng(4)
    sigma_m = np.where(np.arange(300) % 2, 5e-4, 1e-5)
    exact = _frames(0)["root"]
    frames = {"root": exact + sigma_m[:, None] * rng.normal(size=exact.shape)}
    weighted = fit_seam(frames, sigma_m={"root": sigma_m}, robot_sigma_m=1e-5)
    assert _error_m(weighted).mean() < 1e-5  # m; half the frames have 10 um


def test_the_seam_turns_and_moves_with_its_points():
    frames = _frames(3e-5, np.random.default_rng(5))
    turn, shift = Rotation.from_euler("xyz", [0.4, -1.0, 2.0]), np.array([0.2, -0.5, 0.1])
    there = fit_seam({name: turn.apply(rows) + shift for name, rows in frames.items()})
    here = fit_seam(frames)
    count = min(len(here.arc_length_m), len(there.arc_length_m))
    assert np.abs(turn.apply(here.points["root"]) + shift - there.points["root"])[:count].max() < 1e-8  # m; rounding


def test_too_few_frames_are_refused():
    frames = _frames(0, count=20)
    frames["left"][5:] = np.nan
    with pytest.raises(JobFailed, match="left has 5 valid frames"):
        fit_seam(frames)

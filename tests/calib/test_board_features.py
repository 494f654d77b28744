"""Straight lines, printed lines and step pieces in pictures drawn by formula, without the simulator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from calib.fabricated_boards import CAMERA
from weldcell.calib.printed_lines import find_lines, line_crossings
from weldcell.calib.step_pieces import step_pieces
from weldcell.calib.straight_line import crossing, fit_line
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import CameraModel

PINHOLE = replace(CAMERA, width_px=600, height_px=400, principal_px=np.array([299.5, 199.5]), distortion=np.zeros(14))


def test_a_line_is_found_among_a_third_of_strays():
    rng = np.random.default_rng(1)
    x = rng.uniform(0, 100, 150)
    points = np.column_stack([x, 3 + 0.5 * x + 0.1 * rng.normal(size=150)])
    points[::3, 1] += rng.uniform(5, 40, 50)
    middle, direction, kept = fit_line(points, 1.0)
    assert abs(direction[1] / direction[0] - 0.5) < 2e-3  # 0.1 / (29 sqrt(100)): six sigma
    assert abs(middle[1] - 0.5 * middle[0] - 3) < 0.06
    assert not kept[::3].any()


def test_lines_cross_where_they_should():
    found = crossing((np.array([0.0, 1.0]), np.array([1.0, 0.0])), (np.array([3.0, 0.0]), np.array([0.6, 0.8])))
    np.testing.assert_allclose(found, [3.75, 1.0])


def test_too_few_points_are_refused():
    with pytest.raises(BadInput, match="3 points"):
        fit_line(np.zeros((3, 2)), 1.0)


def line_picture(camera: CameraModel, along: str, noise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A white board with two dark lines at +-60 px (undistorted), a stripe across, and where they cross."""
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    rays = camera.unproject(np.stack([u, v], axis=-1).astype(float))
    x, y = (rays[..., k] * camera.focal_px[0] for k in (0, 1))
    across, lengthwise = (y, x) if along == "rows" else (x, y)
    dark = sum(ndtr((w + 6) / 0.8) - ndtr((w - 6) / 0.8) for w in (across - 60 - 0.01 * lengthwise, across + 60))
    stripe_at = 25 + 0.05 * across
    stripe = np.exp(-0.5 * ((lengthwise - stripe_at) / 1.3) ** 2)
    picture = (100 + 100 * stripe) * (1 - 0.94 * dark)
    picture += noise * np.random.default_rng(3).normal(size=picture.shape)
    t = np.linspace(-150, 150, 200)
    flat = np.column_stack([25 + 0.05 * t, t] if along == "rows" else [t, 25 + 0.05 * t])
    stripe_px = camera.project(np.column_stack([flat / camera.focal_px[0], np.ones(200)]))
    places = np.array([-60.0, (60 + 0.25) / (1 - 0.0005)])
    flat = np.column_stack([25 + 0.05 * places, places] if along == "rows" else [places, 25 + 0.05 * places])
    return picture, stripe_px, camera.project(np.column_stack([flat / camera.focal_px[0], np.ones(2)]))


@pytest.mark.parametrize("along", ["rows", "columns"])
@pytest.mark.parametrize("distorted", [False, True])
def test_crossings_of_printed_lines_are_found(along, distorted):
    bent = np.array([-0.6, 2.0, *np.zeros(12)]) if distorted else np.zeros(14)
    camera = replace(PINHOLE, distortion=bent, focal_px=np.full(2, 600.0))
    picture, stripe_px, expected = line_picture(camera, along, noise=1.0)
    found = line_crossings(np.clip(picture, 0, 255).astype(np.uint8), stripe_px, camera, lines=2, along=along)
    # 0.02 px: a grey level of noise on 100, averaged over hundreds of columns, and rounding down
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_a_picture_without_all_lines_gives_none():
    picture, stripe_px, _ = line_picture(PINHOLE, "rows")
    picture[:, :] = 100
    assert find_lines(picture, along="rows") == []
    assert line_crossings(picture, stripe_px, PINHOLE, lines=2, along="rows") is None


@pytest.mark.parametrize("along", ["rows", "columns"])
@pytest.mark.parametrize("forward", [1, -1])
def test_pieces_and_their_ends_are_found(along, forward):
    edges = np.array([80.3, 230.6, 380.2, 520.7])  # px along the stripe, in the picture's order
    rows = (260.2, 200.4, 140.3)
    v, u = np.mgrid[:400, :600].astype(float)
    rng = np.random.default_rng(4)
    light = np.zeros(u.shape)
    for (start, end), row in zip(zip(edges[:-1], edges[1:], strict=True), rows, strict=True):
        inside = ndtr((u - start) / 0.8) - ndtr((u - end) / 0.8)
        light += 110 * inside * np.exp(-0.5 * ((v - row) / 1.2) ** 2)
    picture = 40 + light * rng.gamma(12, 1 / 12, 600) + rng.normal(size=u.shape)
    columns = np.arange(82, 520)
    stripe_px = np.column_stack([columns, np.select([columns < 231, columns < 381], rows[:2], rows[2])]).astype(float)
    if along == "columns":
        picture, stripe_px = picture.T, stripe_px[:, ::-1]
    levels = (0, 1, 2) if forward > 0 else (2, 1, 0)  # of the pieces in the picture's order
    ends = ((0, 0), (1, 1), (2, 2), (2, 3))
    found = step_pieces(
        picture, stripe_px, np.full(len(stripe_px), 0.1), along=along, forward=forward, levels=3, ends=ends
    )
    axis = 0 if along == "rows" else 1
    for level, row in zip(levels, rows, strict=True):
        own = (found.level == level) & (found.edge < 0)
        assert own.sum() > 90 and np.abs(found.pixels[own, 1 - axis] - row).max() < 0.01
    known = edges if forward > 0 else edges[::-1]
    for _, edge in ends:
        at = found.pixels[found.edge == edge, axis]
        assert at == pytest.approx([known[edge]], abs=0.8)  # px: speckle of 30 % on an edge blurred by 0.8 px


def test_two_pieces_are_not_taken_for_three():
    u = np.arange(50.0, 350)
    stripe_px = np.column_stack([u, np.where(u < 200, 100.0, 150.0)])
    assert (
        step_pieces(np.zeros((200, 400)), stripe_px, np.ones(300), along="rows", forward=1, levels=3, ends=((0, 0),))
        is None
    )

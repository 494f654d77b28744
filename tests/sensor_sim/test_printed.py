"""Printed boards in pictures: exact means under the blur, corners where they are projected, and on the stripe."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.chessboard import find_corners
from weldcell.cell.configuration import SENSOR_PRESETS
from weldcell.cell.frames import rigid_from, translation
from weldcell.models.board import Chessboard, LineBoard
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.focus import lens
from weldcell.sensor_sim.line_sensor import Exposure, FrameLight, LineSensor
from weldcell.sensor_sim.printed import PrintedBoards, reflectance

BOARD = Chessboard(columns=9, rows=7, square_m=0.007)
SHARP = replace(SENSOR_PRESETS["p2"], width_px=720, height_px=540, pixel_um=6.9, noise=False)
HERE = RigidTransform.identity()
ROOM = Exposure(exposure_ms=1.0, gain_db=0.0, ambient_grey=110.0)


@cache
def printer() -> PrintedBoards:
    return PrintedBoards(nominal_camera(SHARP), lens(SHARP))


def sensor_and_light(T_camera_board, board=BOARD) -> tuple[LineSensor, FrameLight]:
    """The sensor, and its light on a board that is still white."""
    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.5] * 3, [0.5] * 3
    board.add_to(spec, T_camera_board)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    sensor = LineSensor(SHARP, nominal_camera(SHARP), nominal_plane(SHARP), nominal_source_camera(SHARP), model)
    return sensor, sensor.light(data, HERE, exposure=ROOM)


def leaning(lean_deg: float, towards_deg: float, turn_deg: float = 8.0, distance_m: float = 0.285) -> RigidTransform:
    axis = np.array([np.cos(np.radians(towards_deg)), np.sin(np.radians(towards_deg)), 0.0])
    rotation = Rotation.from_rotvec(np.radians(lean_deg) * axis) * Rotation.from_euler("z", turn_deg, degrees=True)
    return rigid_from(rotation, np.array([0, 0, distance_m]) - rotation.apply(BOARD.corners_board.mean(axis=0)))


@pytest.mark.parametrize("correlation", [0.0, 0.5, -0.4])
def test_mean_reflectance_is_the_integral_under_the_gaussian(correlation):
    """Against Gauss-Hermite's brute force: a dense grid of points under the bivariate normal density."""
    sigma = np.array([0.3e-3, 0.2e-3])
    covariance = np.outer(sigma, sigma) * np.array([[1, correlation], [correlation, 1]])
    rng = np.random.default_rng(2)
    places = np.array([0.014, 0.007]) + rng.uniform(-3, 3, (25, 2)) * sigma
    places = np.vstack([places, [[0.0, 0.0], [-0.007, -0.007], [0.063, 0.0]]])  # an inner corner, the print's corners
    steps = np.linspace(-5, 5, 401)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    weight = np.exp(-np.sum(grid**2, axis=1) / 2)
    offsets = grid @ np.linalg.cholesky(covariance).T
    expected = [
        1 - (1 - BOARD.black_ratio) * np.average(BOARD.pattern.blackness(place + offsets), weights=weight)
        for place in places
    ]
    found = reflectance(BOARD.pattern, places, np.broadcast_to(covariance, (len(places), 2, 2)))
    # 0.01: half of the grid's step (1/40 sigma) times the steepest density 0.4
    np.testing.assert_allclose(found, expected, atol=0.01)


@pytest.mark.parametrize(("lean_deg", "towards_deg"), [(0, 0), (25, 40), (48, 200), (48, 95)])
def test_corners_are_found_where_they_are_projected(lean_deg, towards_deg):
    T_camera_board = leaning(lean_deg, towards_deg)
    sensor, light = sensor_and_light(T_camera_board)
    with sensor:
        picture = sensor.picture(printer().printed(light, BOARD.pattern, T_camera_board), np.random.default_rng(0))
    found = find_corners(picture, BOARD.columns, BOARD.rows)
    expected = nominal_camera(SHARP).project(T_camera_board.apply(BOARD.corners_board))
    candidates = [found - expected, found[::-1] - expected]  # this board is its own half turn
    errors = min(candidates, key=lambda error: np.nansum(error**2))
    errors = errors[np.isfinite(errors[:, 0])]
    assert len(errors) > 0.75 * BOARD.columns * BOARD.rows  # what the stripe crosses is left out
    assert np.sqrt(np.mean(errors**2)) < 0.03  # px: the detector's own
    assert np.abs(errors.mean(axis=0)).max() < 0.01  # px: no bias


def test_the_picture_of_the_print_is_the_blurred_pattern():
    """Against a picture made 5 times as fine without blur, then blurred and averaged numerically."""
    T_camera_board = leaning(20, 30, turn_deg=20)
    white = np.ones((SHARP.height_px, SHARP.width_px), np.float32)
    found = printer()._on_ambient(white, BOARD.pattern, T_camera_board)
    camera, fine = nominal_camera(SHARP), 9
    rows, columns = slice(240, 300), slice(330, 400)
    offsets = (np.arange(fine) - fine // 2) / fine
    margin = 6
    v = (np.arange(rows.start - margin, rows.stop + margin)[:, None] + offsets).ravel()
    u = (np.arange(columns.start - margin, columns.stop + margin)[:, None] + offsets).ravel()
    rays = camera.unproject(np.stack(np.meshgrid(u, v), axis=-1)).reshape(-1, 3)
    axes = T_camera_board.rotation.as_matrix()
    points = rays * ((axes[:, 2] @ T_camera_board.translation) / (rays @ axes[:, 2]))[:, None]
    black = BOARD.pattern.blackness(T_camera_board.inv().apply(points)[:, :2]).reshape(len(v), len(u))
    sigma = lens(SHARP).blur_sigma_px(points[:1] * 0 + points.mean(axis=0), camera.principal_px[None], camera)[0]
    taps = np.exp(-0.5 * (np.arange(-5 * fine, 5 * fine + 1) / fine / sigma) ** 2)
    taps /= taps.sum()
    for axis in (0, 1):
        black = np.apply_along_axis(lambda line: np.convolve(line, taps, mode="same"), axis, black)
    middle = slice(margin * fine + fine // 2, -margin * fine, fine)
    expected = 1 - (1 - BOARD.black_ratio) * black[middle, middle]
    # 0.02 of white: the fine picture's steps (1/9 px at a slope of 0.4 / 0.7 px); the blur is taken in the middle
    np.testing.assert_allclose(found[rows, columns], expected, atol=0.03)
    assert np.sqrt(np.mean((found[rows, columns] - expected) ** 2)) < 5e-3


def test_the_stripe_is_as_dark_as_the_print_under_it():
    board = LineBoard(lines=2, spacing_m=0.03, width_m=0.004, length_m=0.05)
    T_camera_board = translation([0.0, 0.0, 0.275])
    sensor, light = sensor_and_light(T_camera_board, board)
    sensor.close()
    dimmed = printer().printed(light, board.pattern, T_camera_board).laser.grey.sum(axis=0)
    ratio = dimmed / np.maximum(light.laser.grey.sum(axis=0), 1e-9)
    camera = nominal_camera(SHARP)
    u = camera.project(np.array([[-0.015, 0, 0.275], [0.0, 0, 0.275], [0.015, 0, 0.275]]))[:, 0]
    np.testing.assert_allclose(ratio[np.rint(u).astype(int)], [0.06, 1.0, 0.06], atol=1e-3)
    edge = camera.project(np.array([[-0.013, 0.0, 0.275]]))[0, 0]
    column = int(np.floor(edge))
    half = np.interp(edge, [column, column + 1], ratio[column : column + 2])
    assert half == pytest.approx(0.53, abs=0.06)  # (1 + 0.06) / 2 at the edge itself, linear between columns


def test_an_edge_askew_under_the_stripe_moves_its_centre_as_the_blurred_light_does():
    """Against the two-dimensional picture: the thin ridge times the print, on a fine grid, blurred."""
    board = LineBoard(lines=3, spacing_m=0.007, width_m=0.003, length_m=0.06)
    rotation = Rotation.from_euler("z", 60, degrees=True)
    T_camera_board = rigid_from(rotation, np.array([0.0, 0.0, 0.275]))
    sensor, light = sensor_and_light(T_camera_board, board)
    sensor.close()
    columns = np.arange(300, 440)
    plain, dimmed = light.laser.grey, printer().printed(light, board.pattern, T_camera_board).laser.grey
    rows = np.arange(len(plain))[:, None]
    found, before = ((grey * rows).sum(axis=0)[columns] / grey.sum(axis=0)[columns] for grey in (dimmed, plain))
    camera, stripe = nominal_camera(SHARP), light.stripe
    total2 = float(np.interp(360, stripe.cut_px, stripe.sigma_px)) ** 2
    blur2 = float(lens(SHARP).blur_sigma_px(np.array([[0, 0, 0.275]]), camera.principal_px[None], camera)[0]) ** 2
    fine = 10
    v, u = np.arange(-8 * fine, 8 * fine + 1) / fine, np.arange(290 * fine, 450 * fine) / fine
    scale_m = 0.275 / camera.focal_px[0]
    points = np.stack(np.meshgrid((u - camera.principal_px[0]) * scale_m, v * scale_m), axis=-1).reshape(-1, 2)
    black = board.pattern.blackness(points @ rotation.as_matrix()[:2, :2]).reshape(len(v), len(u))
    ridge = np.exp(-(v**2) / (2 * (total2 - blur2)))[:, None] * (1 - 0.94 * black)
    taps = np.exp(-0.5 * (np.arange(-6 * fine, 6 * fine + 1) / fine) ** 2 / blur2)
    for axis in (0, 1):
        ridge = np.apply_along_axis(lambda line: np.convolve(line, taps, mode="same"), axis, ridge)
    expected = np.interp(columns, u, (ridge * v[:, None]).sum(axis=0) / ridge.sum(axis=0))
    assert np.abs(expected).max() > 0.1  # px: the edges do pull
    # 0.03 px: the fine grid's steps of 0.1 px; the lens's distortion is not in it
    np.testing.assert_allclose(found - before, expected, atol=0.03)


def test_a_board_that_turns_its_back_shows_nothing():
    T_camera_board = leaning(180, 0)
    sensor, light = sensor_and_light(T_camera_board)
    sensor.close()
    assert printer().printed(light, BOARD.pattern, T_camera_board) is light

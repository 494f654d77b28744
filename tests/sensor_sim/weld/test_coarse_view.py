"""Coarse cells: linear fields come back exactly, and a picture lends a field its edges and texture."""

import numpy as np
import pytest

from weldcell.sensor_sim.weld.coarse_view import CoarseView


@pytest.fixture(scope="module")
def view(camera):
    return CoarseView(camera)


def test_linear_fields_come_back_between_the_cells(view):
    field = 3 + 0.02 * view.pixels[:, 0] - 0.01 * view.pixels[:, 1]
    whole = view.whole(field)
    rows, columns = np.indices(whole.shape)
    inner = (slice(40, -40), slice(40, -40))
    expected = 3 + 0.02 * columns - 0.01 * rows
    np.testing.assert_allclose(
        whole[inner], expected[inner], atol=0.011
    )  # middles are whole pixels: off by half of one
    pixels = np.random.default_rng(0).uniform([40, 40], [1400, 1040], (100, 2))
    np.testing.assert_allclose(view.at(field, pixels), 3 + pixels @ [0.02, -0.01], atol=0.011)


def test_a_field_gets_the_edges_of_the_picture(view):
    """Two surfaces whose slanting border runs through the cells: each pixel has its own side's value."""
    rows, columns = np.indices((1080, 1440))
    bright = columns > 600 + 0.3 * rows
    guide = np.where(bright, 12.0, 5.0).astype(np.float32)
    field = np.where(view.pixels[:, 0] > 600 + 0.3 * view.pixels[:, 1], 20.0, 90.0)
    slope, offset = view.detail(field, guide)
    rebuilt = view.whole(slope) * guide + view.whole(offset)
    error = np.abs(rebuilt - np.where(bright, 20.0, 90.0))
    assert error.max() < 10 and np.abs(view.whole(field) - np.where(bright, 20.0, 90.0)).max() > 30


def test_a_field_gets_the_texture_of_the_picture(view):
    texture = 1 + 0.1 * np.sin(np.indices((1080, 1440))[1] * 0.9).astype(np.float32)
    field = np.full(len(view.pixels), 50.0)
    u, v = view.pixels.astype(int).T
    slope, offset = view.detail(field * texture[v, u], 9 * texture)
    rebuilt = view.whole(slope) * 9 * texture + view.whole(offset)
    np.testing.assert_allclose(rebuilt, 50 * texture, rtol=0.01)

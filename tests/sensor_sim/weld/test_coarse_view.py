"""Coarse cells: linear fields come back exactly."""

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

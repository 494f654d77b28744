"""Seams and distances to their lines, by hand-computed numbers."""

import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import Seam, distance_to_polyline, nearest_on_polyline

L_SHAPE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])


@pytest.mark.parametrize(
    ("point", "nearest"),
    [
        ([0.5, 0.2, 0], [0.5, 0, 0]),
        ([-1, 0, 1], [0, 0, 0]),
        ([1.5, -0.5, 0], [1, 0, 0]),
        ([0.9, 0.5, 0.3], [1, 0.5, 0]),
    ],
)
def test_the_nearest_place_on_an_l_shape(point, nearest):
    point = np.array([point], float)
    assert np.allclose(nearest_on_polyline(point, L_SHAPE), [nearest], atol=1e-15)
    assert distance_to_polyline(point, L_SHAPE)[0] == pytest.approx(np.linalg.norm(point[0] - nearest))


def test_a_seam_is_interpolated_as_a_cubic():
    s = np.linspace(0, 1, 20)
    seam = Seam(arc_length_m=s, points={"root": np.column_stack([s, s**3, 0 * s])})
    assert np.allclose(seam.at("root", np.array([0.123])), [[0.123, 0.123**3, 0]], atol=1e-12)


def test_arc_lengths_that_do_not_increase_are_refused():
    with pytest.raises(BadGeometry, match="increasing"):
        Seam(arc_length_m=np.array([0.0, 1.0, 1.0]), points={})
    with pytest.raises(BadGeometry, match="root has shape"):
        Seam(arc_length_m=np.array([0.0, 1.0]), points={"root": np.zeros((3, 3))})

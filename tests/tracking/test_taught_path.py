"""Taught paths: places, deviations, and what lies beyond their ends."""

import numpy as np
import pytest

from tracking.seam_plant import path
from weldcell.cell.errors import BadGeometry
from weldcell.tracking.taught_path import TaughtPath

RADIUS_M = 0.2


def _circle() -> TaughtPath:
    """A quarter of a circle about the origin, to the left, a point every 2 mm."""
    angle = np.linspace(0, np.pi / 2, 158)
    inwards = -np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    return TaughtPath(
        arc_length_m=RADIUS_M * angle,
        points_base=-RADIUS_M * inwards,
        lefts_base=inwards,
        ups_base=np.tile([0.0, 0.0, 1.0], (len(angle), 1)),
    )


def test_deviations_from_a_circle_are_those_of_geometry():
    angle, radius, height = np.array([0.3, 0.8, 1.2]), np.array([0.19, 0.2, 0.215]), np.array([0.0, 0.004, -0.01])
    points = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), height])
    arc_length_m, lateral_m, vertical_m = _circle().project(points)
    # 1 nm: cubics between points 2 mm apart err by h^4 / (384 R^3), and slopes by h^3 / (24 R^3) of 15 mm.
    assert np.allclose(arc_length_m, RADIUS_M * angle, atol=2e-9)
    assert np.allclose(lateral_m, RADIUS_M - radius, atol=1e-9)
    assert np.allclose(vertical_m, height, atol=1e-12)


@pytest.mark.parametrize("kind", ["s", "straight"])
def test_projecting_takes_back_what_placing_did(kind):
    rng = np.random.default_rng(3)
    taught = path(kind)
    arc_length_m = rng.uniform(taught.start_m - 0.02, taught.end_m + 0.02, 50)
    lateral_m, vertical_m = rng.uniform(-0.015, 0.015, (2, 50))
    again = taught.project(taught.place(arc_length_m, lateral_m, vertical_m))
    assert np.allclose(again, [arc_length_m, lateral_m, vertical_m], atol=1e-8)  # m; left and tangent square to 1e-6


def test_the_path_goes_on_straight_beyond_its_ends():
    taught = _circle()
    at = taught.places(np.array([-0.03, taught.end_m + 0.05]))
    assert np.allclose(
        at.points, [[RADIUS_M, -0.03, 0], [-0.05, RADIUS_M, 0]], atol=1e-7
    )  # m; slopes of a spline's end
    assert np.allclose(at.lefts, [[-1, 0, 0], [0, -1, 0]], atol=1e-6)
    assert np.allclose(taught.tangent_at(np.array([-0.03, 0.0])), [0, 1, 0], atol=1e-6)


def test_left_and_up_are_made_square_to_the_path():
    leaning = TaughtPath(
        arc_length_m=np.array([0.0, 0.1]),
        points_base=np.array([[0.0, 0, 0], [0.1, 0, 0]]),
        lefts_base=np.array([[0.5, 1, 0], [0.5, 1, 0]]),
        ups_base=np.array([[0.3, 0, 1], [0.3, 0, 1]]),
    )
    assert np.allclose(leaning.place(np.array([0.04]), np.array([0.01]), np.array([0.02])), [[0.04, 0.01, 0.02]])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"arc_length_m": np.array([0.0, 0.0])}, "increasing"),
        ({"points_base": np.array([[0.0, 0, 0], [np.nan, 0, 0]])}, "finite"),
        ({"points_base": np.zeros((2, 3))}, "stand still"),
        ({"lefts_base": np.array([[1.0, 0, 0], [1.0, 0, 0]])}, "run along"),
        ({"ups_base": np.array([[0, 0, -1.0], [0, 0, -1.0]])}, "point down"),
    ],
)
def test_what_is_no_path_is_refused(change, words):
    given = {
        "arc_length_m": np.array([0.0, 0.1]),
        "points_base": np.array([[0.0, 0, 0], [0.1, 0, 0]]),
        "lefts_base": np.array([[0, 1.0, 0], [0, 1.0, 0]]),
        "ups_base": np.array([[0, 0, 1.0], [0, 0, 1.0]]),
    }
    with pytest.raises(BadGeometry, match=words):
        TaughtPath(**(given | change))

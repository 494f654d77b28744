"""What is seen through a root gap is told from the groove's own bottom."""

import numpy as np
import pytest

from weldcell.tracking.root_gap import seen_through_gap
from weldcell.tracking.section import Section

SPACING_M = 8e-5


def _section(x_m, z_m, sigma_m=2e-5, seed=0):
    rng = np.random.default_rng(seed)
    return Section(
        x_m=x_m,
        z_m=z_m + sigma_m * rng.standard_normal(len(x_m)),
        sigma_m=np.full(len(x_m), sigma_m),
        noise_slope=np.zeros(len(x_m)),
        amplitude_grey=np.full(len(x_m), np.nan),
    )


def _u(gap_m, *, radius_m=4e-3, face_m=2e-3, lowest_wall_m=0.0):
    """A U of this radius 10 mm deep, walls 10 degrees off the vertical, over a backing; and which points are that."""
    x_m = np.arange(-7e-3, 7e-3, SPACING_M)
    away_m = np.maximum(np.abs(x_m) - gap_m / 2, 0.0)
    tangent = np.tan(np.radians(10))
    end_m = radius_m / np.hypot(1, tangent)
    arc_m = np.sqrt(radius_m**2 - np.minimum(away_m, end_m) ** 2)
    z_m = 10e-3 - radius_m + arc_m - np.maximum(away_m - end_m, 0.0) / tangent
    backing = np.abs(x_m) < gap_m / 2
    z_m[backing] = 10e-3 + face_m
    dark = (z_m < 10e-3 - radius_m + lowest_wall_m) & (z_m > 2e-3) & (lowest_wall_m > 0)
    seen = (z_m > 0) & ~dark
    return x_m[seen], z_m[seen], backing[seen]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("sigma_m", [5e-6, 7e-5])
@pytest.mark.parametrize("gap_m", [1e-3, 2.5e-3])
def test_a_backing_is_seen_through_the_gap_and_the_groove_is_not(gap_m, sigma_m, seed):
    x_m, z_m, backing = _u(gap_m)
    assert seen_through_gap(_section(x_m, z_m, sigma_m, seed)).tolist() == backing.tolist()


def test_beside_a_square_face_it_has_the_circle_on_one_side_only():
    x_m, z_m, backing = _u(2e-3)
    right = x_m > -1e-3  # the face is there
    assert seen_through_gap(_section(x_m[right], z_m[right])).tolist() == backing[right].tolist()


@pytest.mark.parametrize("lowest_wall_m", [0.0, 1e-3])
def test_a_groove_without_a_gap_is_all_groove_even_if_parts_of_its_walls_are_dark(lowest_wall_m):
    x_m, z_m, _ = _u(0.0, lowest_wall_m=lowest_wall_m)
    assert not seen_through_gap(_section(x_m, z_m)).any()


@pytest.mark.parametrize("at_m", [-2e-3, 0.0, 3e-3])
def test_a_drop_of_spatter_leaves_the_bottom_where_it_is(at_m):
    x_m, z_m, _ = _u(0.0)
    z_m[np.abs(x_m - at_m) < 5e-4] = 5e-3
    assert not seen_through_gap(_section(x_m, z_m)).any()


def test_few_points_are_no_groove():
    assert seen_through_gap(_section(np.arange(3.0), np.arange(3.0))).tolist() == [False] * 3

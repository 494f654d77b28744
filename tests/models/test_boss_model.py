"""The boss against school geometry."""

import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.models.boss import boss, frustum_height

SLOPE = np.arctan2(4, 3)  # 53.13 deg


@pytest.fixture(scope="module")
def part():
    return boss(0.050, SLOPE, 0.040)


def test_height_is_that_of_the_three_four_five_triangle():
    """With cot = 3/4 the edge is h sqrt(1 + 2 * 9/16) = h sqrt(34)/4."""
    assert frustum_height(0.050, SLOPE) == pytest.approx(0.200 / np.sqrt(34), abs=1e-15)


def test_slanted_edges_have_the_length_asked_for(part):
    edges = part.corners_part["top"] - part.corners_part["foot"]
    np.testing.assert_allclose(np.linalg.norm(edges, axis=1), 0.050, atol=1e-15)


def test_corners_are_vertices_of_the_mesh(part):
    for corner in np.concatenate(list(part.corners_part.values())):
        assert np.linalg.norm(part.vertices_part - corner, axis=1).min() == 0


def test_volume_is_frustum_plus_slab(part):
    height = 0.200 / np.sqrt(34)
    foot = 0.040 + 2 * 0.75 * height
    frustum_m3 = height / 3 * (foot**2 + foot * 0.040 + 0.040**2)
    slab_m3 = (foot + 0.04) ** 2 * 0.015
    assert part.mesh_part().volume == pytest.approx(frustum_m3 + slab_m3, rel=1e-12)


def test_planes_contain_their_corners_and_meet_the_base_at_the_slope(part):
    up = np.array([0, 0, 1])
    for name, first in {"+x": 3, "+y": 0, "-x": 1, "-y": 2}.items():
        *normal, offset_m = part.planes_part[name]
        corners = [part.corners_part[ring][k % 4] for ring in ("top", "foot") for k in (first, first + 1)]
        np.testing.assert_allclose(np.array(corners) @ normal, offset_m, atol=1e-15)
        assert np.arccos(normal @ up) == pytest.approx(SLOPE, abs=1e-12)  # 180 deg less the dihedral angle
        assert np.linalg.norm(normal) == pytest.approx(1, abs=1e-15)


def test_mesh_faces_lie_in_the_named_planes(part):
    mesh = part.mesh_part()
    for normal_and_offset in part.planes_part.values():
        normal, offset_m = normal_and_offset[:3], normal_and_offset[3]
        on_plane = np.abs(mesh.triangles @ normal - offset_m).max(axis=1) < 1e-12
        assert on_plane.sum() >= 2
        np.testing.assert_allclose(mesh.face_normals[on_plane] @ normal, 1, atol=1e-12)


@pytest.mark.parametrize("arguments", [(0.0, SLOPE, 0.04), (0.05, 0.0, 0.04), (0.05, np.pi / 2, 0.04), (np.nan, 1, 1)])
def test_impossible_bosses_are_refused(arguments):
    with pytest.raises(BadGeometry, match="boss"):
        boss(*arguments)

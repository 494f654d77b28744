"""Rigid transforms: checked construction, group laws, differences."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import axes_rotation, difference, rigid, rigid_from, translation

EXACT = 1e-12  # m and rad: rounding of a handful of operations on numbers of order one

vectors = st.tuples(*[st.floats(-2, 2)] * 3).map(np.array)


@st.composite
def transforms(draw) -> RigidTransform:
    return rigid_from(Rotation.from_rotvec(draw(vectors)), draw(vectors))


@given(transforms(), transforms(), vectors)
def test_composition_maps_points_in_turn(T_base_flange, T_flange_camera, point_camera):
    composed = (T_base_flange * T_flange_camera).apply(point_camera)
    in_turn = T_base_flange.apply(T_flange_camera.apply(point_camera))
    assert np.allclose(composed, in_turn, atol=EXACT)


@given(transforms(), vectors)
def test_inverse_undoes(T_base_flange, point_flange):
    assert np.allclose(T_base_flange.inv().apply(T_base_flange.apply(point_flange)), point_flange, atol=EXACT)


@given(transforms())
def test_rigid_keeps_what_is_rigid(T):
    assert np.allclose(rigid(T.as_matrix()).as_matrix(), T.as_matrix(), atol=EXACT)


@given(transforms(), st.floats(0, 3), vectors)
def test_difference_is_the_angle_and_distance_put_in(T, angle_rad, offset):
    axis = np.array([0.6, 0.0, 0.8])
    moved = rigid_from(T.rotation * Rotation.from_rotvec(angle_rad * axis), T.translation + offset)
    found_rad, found_m = difference(T, moved)
    assert found_rad == pytest.approx(angle_rad, abs=1e-7)  # rad: arccos-like loss near zero
    assert found_m == pytest.approx(np.linalg.norm(offset), abs=EXACT)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda M: M * 1.01, "orthonormal"),
        (lambda M: M @ np.diag([1, 1, -1, 1]), "reflection"),
        (lambda M: M + np.where(np.eye(4) > 0, np.nan, 0), "finite"),
        (lambda M: M[:3], "4x4"),
        (lambda M: M + np.array([[0, 0, 0, 0]] * 3 + [[1, 0, 0, 0]]), "last row"),
    ],
)
def test_what_is_not_rigid_is_refused_with_the_reason(spoil, reason):
    with pytest.raises(BadGeometry, match=reason):
        rigid(spoil(np.eye(4)))


def test_axes_rotation_has_its_z_exactly_and_its_x_nearest():
    rotation = axes_rotation(np.array([1.0, 0.2, 0.3]), np.array([0.0, 0.0, 2.0])).as_matrix()
    assert np.allclose(rotation[:, 2], [0, 0, 1], atol=EXACT)
    assert np.allclose(rotation[:, 0], np.array([1, 0.2, 0]) / np.hypot(1, 0.2), atol=EXACT)


def test_translation_only_moves():
    assert np.allclose(translation(np.array([1.0, 2.0, 3.0])).apply([0.5, 0, 0]), [1.5, 2, 3], atol=EXACT)

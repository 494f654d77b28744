"""The torch: where its tip is, and what may touch."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from
from weldcell.models.torch import T_FLANGE_TORCH, TORCH_MASS_KG, build_torch


def forward(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_nominal_tip_is_where_the_drawing_says():
    """0.22 m along the flange's z, then 0.12 m at 35 deg: x = -0.12 sin 35, z = 0.22 + 0.12 cos 35."""
    np.testing.assert_allclose(T_FLANGE_TORCH.translation, [-0.0688, 0, 0.3183], atol=5e-5)  # m, printed digits
    s, c = np.sin(np.deg2rad(35)), np.cos(np.deg2rad(35))
    np.testing.assert_allclose(T_FLANGE_TORCH.rotation.as_matrix(), [[c, 0, -s], [0, 1, 0], [s, 0, c]], atol=1e-15)


def test_tip_sphere_and_site_are_the_torch_frame_for_any_mount():
    T_flange_torch = rigid_from(Rotation.from_rotvec([0.02, -0.6, 0.05]), np.array([-0.066, 0.003, 0.321]))
    model = build_torch(T_flange_torch, tip_radius_m=0.0008).compile()
    data = forward(model)
    np.testing.assert_allclose(data.geom("torch_tip").xpos, T_flange_torch.translation, atol=1e-12)
    np.testing.assert_allclose(data.site("torch").xpos, T_flange_torch.translation, atol=1e-12)
    np.testing.assert_allclose(data.site("torch").xmat.reshape(3, 3), T_flange_torch.rotation.as_matrix(), atol=1e-12)
    assert model.geom("torch_tip").size[0] == 0.0008


def test_wire_and_tip_collide_with_nothing_and_the_rest_with_parts_only():
    model = build_torch().compile()
    for i in range(model.ngeom):
        expected = (0, 0) if model.geom(i).name in ("torch_tip", "torch_wire") else (1, 2)
        assert (model.geom_contype[i], model.geom_conaffinity[i]) == expected
        assert model.geom_group[i] == 2


def test_nothing_but_the_wire_reaches_within_ten_millimetres_of_the_tip():
    model = build_torch().compile()
    data = forward(model)
    x_t_flange, z_t_flange = T_FLANGE_TORCH.rotation.apply([[1.0, 0, 0], [0, 0, 1]])
    geom_id = np.zeros(1, np.int32)
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):  # rays towards the tip's plane, 5 mm off the wire
        offset = 0.005 * Rotation.from_rotvec(angle * z_t_flange).apply(x_t_flange)
        start = T_FLANGE_TORCH.translation + offset + 0.1 * z_t_flange
        distance = mujoco.mj_ray(model, data, start, -z_t_flange, None, 1, -1, geom_id)
        assert distance == -1 or distance > 0.110


def test_mass_is_explicit():
    assert build_torch().compile().body("torch_body").mass[0] == pytest.approx(TORCH_MASS_KG)


def test_a_tip_without_radius_is_refused():
    with pytest.raises(BadGeometry, match="tip radius"):
        build_torch(tip_radius_m=0.0)

"""The standard sphere is exact, free where it is measured, and stands on its foot."""

import mujoco
import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.models.sphere import sphere_stand


def compiled(**more):
    model = sphere_stand(0.020, **more).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def test_sphere_is_an_exact_sphere_at_the_bodys_origin():
    model, data = compiled()
    geom = model.geom("standard_sphere")
    assert geom.type[0] == mujoco.mjtGeom.mjGEOM_SPHERE
    assert geom.size[0] == 0.020
    assert np.all(data.geom("standard_sphere").xpos == 0)
    assert geom.group[0] == 0


@pytest.mark.parametrize("crank_m", [0.0, 0.085])
def test_rays_at_the_upper_three_quarters_meet_the_sphere_first(crank_m):
    model, data = compiled(crank_m=crank_m)
    sphere, hit = model.geom("standard_sphere").id, np.zeros(1, np.int32)
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for direction in directions[directions[:, 2] > -0.5]:
        distance = mujoco.mj_ray(model, data, direction * 0.5, -direction, None, 1, -1, hit)
        assert hit[0] == sphere, direction
        assert distance == pytest.approx(0.480, abs=1e-12)


def test_foot_stands_at_the_given_depth():
    model, data = compiled(centre_height_m=0.13)
    distance = mujoco.mj_ray(
        model, data, np.array([-0.085, 0.001, -1.0]), np.array([0, 0, 1.0]), None, 1, -1, np.zeros(1, np.int32)
    )
    assert distance == pytest.approx(0.87, abs=1e-6)


@pytest.mark.parametrize("arguments", [{"radius_m": 0.0}, {"radius_m": np.nan}, {"radius_m": 0.1}])
def test_impossible_stands_are_refused(arguments):
    with pytest.raises(BadGeometry, match="sphere"):
        sphere_stand(**arguments)

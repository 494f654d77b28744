import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import synthetic
from weldcell.calib.sight_model import (
    cross_matrix,
    perturbation,
    perturbed,
    right_jacobian,
    sight_covariances_base,
    sight_jacobian,
    targets_base,
)


def test_exact_sights_all_point_at_the_target():
    sights = synthetic.sights(np.random.default_rng(0))
    found = targets_base(sights.T_base_flange, sights.T_flange_camera, sights.centres_camera)
    assert np.abs(found - sights.target_base).max() < 1e-14


def test_jacobian_agrees_with_differences():
    sights = synthetic.sights(np.random.default_rng(1), translations=1, free=3)
    step, columns = 1e-6, []

    def residual(parameters):
        T_flange_camera = perturbed(sights.T_flange_camera, parameters[:6])
        found = targets_base(sights.T_base_flange, T_flange_camera, sights.centres_camera)
        return found - (sights.target_base + parameters[6:])

    for direction in step * np.eye(9):
        columns.append((residual(direction) - residual(-direction)) / (2 * step))
    jacobian = sight_jacobian(sights.T_base_flange, sights.T_flange_camera, sights.centres_camera)
    assert jacobian == pytest.approx(np.stack(columns, axis=-1), abs=1e-9)  # rounding over the step


def test_perturbation_undoes_perturbed():
    T_flange_camera = synthetic.camera_on_flange()
    parameters = np.array([0.3, -0.2, 0.1, 0.01, 0.02, -0.03])
    assert perturbation(T_flange_camera, perturbed(T_flange_camera, parameters)) == pytest.approx(parameters, abs=1e-14)


@pytest.mark.parametrize("size", [1e-6, 0.9e-4, 1.1e-4, 0.1, 2.0])
def test_right_jacobian_is_the_exponentials_derivative(size):
    vector = size * np.array([0.6, -0.64, 0.48])
    step, columns = 1e-6, []
    for direction in step * np.eye(3):
        ahead, behind = Rotation.from_rotvec(vector + direction), Rotation.from_rotvec(vector - direction)
        columns.append((behind.inv() * ahead).as_rotvec() / (2 * step))
    assert right_jacobian(vector) == pytest.approx(np.stack(columns, axis=-1), abs=1e-9)


def test_cross_matrix_is_the_cross_product():
    a, b = np.array([1.0, 2.0, 3.0]), np.array([-4.0, 5.0, 6.0])
    assert cross_matrix(a) @ b == pytest.approx([-3, -18, 13], abs=1e-14)  # by hand


def test_sight_covariance_turns_with_the_camera_and_adds_the_robot():
    sights = synthetic.sights(np.random.default_rng(2), translations=1, free=4)
    along_depth = np.broadcast_to(np.diag([0.0, 0.0, 4e-8]), (5, 3, 3))
    found = sight_covariances_base(sights.T_base_flange, sights.T_flange_camera, along_depth, 1e-4)
    depth_base = (sights.T_base_flange.rotation * sights.T_flange_camera.rotation).apply([0.0, 0.0, 1.0])
    assert np.einsum("ni,nij,nj->n", depth_base, found, depth_base) == pytest.approx(4e-8 + 1e-8, rel=1e-12)
    assert np.trace(found, axis1=1, axis2=2) == pytest.approx(4e-8 + 3e-8, rel=1e-12)

import numpy as np
import pytest

import synthetic
from weldcell.calib.apex_sight import ApexSightProblem, solve
from weldcell.cell.errors import BadInput

SLOPE = np.tan(np.radians(40))
HALF_WIDTH_M = 0.016


def profile(rng, *, apex=(0.003, 0.19), miss_m=0.0, sigma_m=0.0, tilt=0.0):
    """A pyramid's section on a deep background; a plane that misses the apex cuts its third face flat."""
    x = np.linspace(apex[0] - 0.03, apex[0] + 0.03, 600)
    depth = apex[1] + SLOPE * np.maximum(np.abs(x - apex[0]), abs(miss_m)) + tilt * (x - apex[0])
    depth[np.abs(x - apex[0]) > HALF_WIDTH_M] = np.nan
    points_laser = np.column_stack([x, np.zeros(600), depth + rng.normal(0, sigma_m, 600)])
    return ApexSightProblem(
        points_camera=synthetic.PLANE.T_camera_laser.apply(points_laser),
        sigma_m=np.full(600, max(sigma_m, 1e-6)),
        plane=synthetic.PLANE,
    )


def in_laser(found):
    return synthetic.PLANE.T_camera_laser.inv().apply(found.apex_camera)


@pytest.mark.parametrize("miss_m", [0.0, 3e-4])
@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_the_apex_is_exact_even_where_the_plane_misses_it(miss_m, tilt):
    found = solve(profile(np.random.default_rng(0), miss_m=miss_m, tilt=tilt))
    assert found.valid and in_laser(found) == pytest.approx([0.003, 0, 0.19], abs=1e-9)


def test_errors_scatter_as_the_covariance_says():
    """150 trials: both standard deviations within 20 % (their own is 6 %)."""
    rng = np.random.default_rng(1)
    found = [solve(profile(rng, sigma_m=2e-5)) for _ in range(150)]
    spread = np.std([in_laser(one)[[0, 2]] for one in found], axis=0)
    R = synthetic.PLANE.T_camera_laser.rotation.as_matrix()
    predicted = np.mean([np.diag(R.T @ one.covariance_camera @ R) for one in found], axis=0)
    assert spread == pytest.approx(np.sqrt(predicted[[0, 2]]), rel=0.2)
    assert np.sqrt(predicted[1]) == pytest.approx(1e-4, rel=1e-6)  # the aim


def test_spatter_and_a_torn_flank_hardly_pull():
    rng = np.random.default_rng(2)
    given = profile(rng, sigma_m=2e-5)
    spoilt = given.points_camera.copy()
    spoilt[rng.choice(600, 40, replace=False)] += synthetic.PLANE.T_camera_laser.rotation.apply([0, 0, 4e-3])
    spoilt[320:340] = np.nan
    found = solve(ApexSightProblem(points_camera=spoilt, sigma_m=given.sigma_m, plane=given.plane))
    assert found.valid and in_laser(found) == pytest.approx([0.003, 0, 0.19], abs=5e-5)


def test_a_flat_a_sphere_and_an_empty_profile_are_no_apex():
    given = profile(np.random.default_rng(3))
    x = np.linspace(-0.03, 0.03, 600)
    for depth in (np.full(600, 0.19), 0.21 - np.sqrt(np.maximum(0.02**2 - x**2, 0))):
        points = synthetic.PLANE.T_camera_laser.apply(np.column_stack([x, np.zeros(600), depth]))
        found = solve(ApexSightProblem(points_camera=points, sigma_m=np.full(600, 2e-5), plane=given.plane))
        assert not found.valid and found.reason and np.isnan(found.apex_camera).all()
    found = solve(ApexSightProblem(points_camera=np.full((600, 3), np.nan), sigma_m=given.sigma_m, plane=given.plane))
    assert not found.valid and "0 points" in found.reason
    with pytest.raises(BadInput, match="aim_sigma_m"):
        ApexSightProblem(points_camera=np.zeros((2, 3)), sigma_m=np.ones(2), plane=given.plane, aim_sigma_m=-1.0)

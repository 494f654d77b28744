"""The whole way from a picture to the joint's features."""

import numpy as np
import pytest

from tracking.fabricated_profiles import p2_camera, p2_plane, picture_of_corners, v_corners
from weldcell.tracking.joint import find_joint
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate


@pytest.mark.parametrize(("depth_m", "limit_m"), [(0.06, 2e-5), (0.005, 1e-4)])
def test_a_speckled_picture_gives_the_groove_to_its_predicted_sigma(depth_m, limit_m):
    camera, plane = p2_camera(), p2_plane()
    corners = v_corners(depth_m=depth_m, z_m=0.155 if depth_m > 0.05 else 0.19)
    picture = picture_of_corners(corners, camera, plane, rng=np.random.default_rng(11))
    features = find_joint(triangulate(find_stripe(picture), camera, plane), "v", plane)
    assert features.valid
    found = plane.T_camera_laser.inv().apply(features.points_camera)[:, [0, 2]]
    distance_m = np.linalg.norm(found - corners[3:0:-1], axis=1)  # left has the larger x
    assert np.all(distance_m < 4 * features.sigma_m)
    assert distance_m.max() < limit_m  # m; five times the predicted 4 um, or 20 um where walls are 26 columns short

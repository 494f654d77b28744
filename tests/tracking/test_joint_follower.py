"""One joint followed from profile to profile."""

import numpy as np
import pytest

from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import JointFeatures, Profile
from weldcell.tracking import joint_follower
from weldcell.tracking.joint import not_found
from weldcell.tracking.joint_follower import JointFollower

PLANE = LaserPlane(normal_camera=np.array([0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)]), offset_m=0.2)


def _at(x_mm):
    """A profile of one point, at this x of the laser frame."""
    points = PLANE.T_camera_laser.apply([[1e-3 * x_mm, 0, 0]])
    return Profile(points_camera=points, sigma_m=np.full(1, 1e-5), valid=np.ones(1, bool))


def _x_mm(points_camera):
    return float(1e3 * PLANE.T_camera_laser.inv().apply(points_camera)[0, 0])


@pytest.fixture
def followed(monkeypatch):
    """Shows a follower where joints are in each profile (mm), and returns where it found one (None: not)."""

    def find(profile, kind, plane, *, previous):
        if previous is not None and abs(_x_mm(previous.points_camera) - _x_mm(profile.points_camera)) > 15:
            return not_found(("root",), "nothing there")
        return JointFeatures(names=("root",), points_camera=profile.points_camera, sigma_m=profile.sigma_m, valid=True)

    def follow(places_mm, **settings):
        monkeypatch.setattr(joint_follower, "find_joint", find)
        follower = JointFollower("fillet", PLANE, **settings)
        joints = [follower.find(_at(x_mm)) for x_mm in places_mm]
        return [round(_x_mm(joint.points_camera)) if joint.valid else None for joint in joints]

    return follow


def test_what_was_found_once_and_not_again_does_not_hold_the_search_up(followed):
    assert followed([50, 2, 2, 2]) == [50, None, 2, 2]


def test_what_was_found_twice_is_looked_for_in_its_place_for_a_while(followed):
    assert followed([2, 2, 40, 40, 3]) == [2, 2, None, None, 3]
    assert followed([2, 2, *7 * [40]]) == [2, 2, *6 * [None], 40]


def test_a_joint_far_from_where_the_sensor_was_aimed_is_none_until_its_place_is_known(followed):
    assert followed([30, 12, 26, 40], search_m=0.02) == [None, 12, 26, 40]

"""The distance that an arc feels: exact over a plate, the walls' slope in a groove, unblocked by torch and sensor."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.weld.contact_distance import CONTACT_TIP_M, FOOTPRINT_M, WORK_GROUPS, contact_distance

PLATE = '<geom type="plane" size="0 0 1"/>'
V_60 = '<geom type="plane" size="0 0 1" euler="60 0 0"/><geom type="plane" size="0 0 1" euler="-60 0 0"/>'
TORCH = '<geom type="capsule" size=".0006 .004" pos="0 0 .005" group="2"/><geom size=".003" pos="0 0 .01" group="3"/>'
DOWN = np.column_stack([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])


def torches(left_m, height_m=0.0, rotation=DOWN):
    """Poses with travel along x, so that left is +y of the base."""
    left_m = np.asarray(left_m, float)
    places = np.column_stack([np.zeros_like(left_m), left_m, np.full_like(left_m, height_m)])
    return RigidTransform.from_components(places, Rotation.from_matrix(np.repeat(rotation[None], len(left_m), axis=0)))


def felt(scene, world, poses):
    model, data = scene(world)
    return contact_distance(RayCaster(model, groups=WORK_GROUPS), data, poses)


@pytest.mark.parametrize("height_m", [0.0, 0.003, -0.004])
def test_over_a_plate_it_is_the_distance_itself(scene, height_m):
    distance_m = felt(scene, PLATE, torches([0.0, 0.01], height_m))
    np.testing.assert_allclose(distance_m, CONTACT_TIP_M + height_m, rtol=1e-9)  # rays are exact to a nanometre


def test_one_pose_gives_one_number_and_a_stack_the_same_numbers(scene):
    left_m = np.array([-0.002, 0.0, 0.0013])
    stacked = felt(scene, V_60, torches(left_m))
    assert felt(scene, V_60, torches(left_m)[2]).shape == ()
    singly = [float(felt(scene, V_60, torches(left_m)[k])) for k in range(3)]
    np.testing.assert_allclose(stacked, singly, rtol=1e-12)


def test_neither_wire_nor_torch_nor_sensor_stand_in_the_way(scene):
    assert felt(scene, PLATE + TORCH, torches([0.0]))[0] == pytest.approx(CONTACT_TIP_M, rel=1e-9)


def test_in_a_v_it_falls_towards_both_walls_alike(scene):
    """By cot(30 deg) = 1.73 along the wire; the foot, of slope t, meets the wall up to 1 / (1 + t cot) earlier."""
    left_m = np.linspace(-0.004, 0.004, 81)
    distance_m = felt(scene, V_60, torches(left_m))
    np.testing.assert_allclose(distance_m, distance_m[::-1], rtol=1e-9)
    slope = np.gradient(distance_m, left_m)
    cot = 1 / np.tan(np.pi / 6)
    least = cot / (1 + FOOTPRINT_M / CONTACT_TIP_M * cot)
    on_left_wall = left_m > 0.002
    assert np.all(-slope[on_left_wall] > 0.98 * least) and np.all(-slope[on_left_wall] < cot)
    assert np.argmax(distance_m) == 40


def test_it_agrees_with_the_soft_minimum_over_many_rays(scene):
    """Against 4000 rays spread evenly over the foot, each met in closed form: 13 rays stand for them to 0.1 mm."""
    left_m = np.array([-0.003, -0.001, 0.0, 0.0005, 0.002])
    k = np.arange(4000) + 0.5
    radius, turn = FOOTPRINT_M / CONTACT_TIP_M * np.sqrt(k / 4000), k * np.pi * (3 - np.sqrt(5))
    aside = radius * np.cos(turn)
    cot = 1 / np.tan(np.pi / 6)
    # down from the tip by d, aside by d t: meets z = cot |y| where h - d = cot |y + d t|
    per_side = [(CONTACT_TIP_M - s * cot * left_m[:, None]) / (1 + s * cot * aside) for s in (1.0, -1.0)]
    depth_m = np.minimum(*per_side)
    dense = -1e-3 * np.log(np.mean(np.exp(-depth_m / 1e-3), axis=1))
    found = felt(scene, V_60, torches(left_m))
    offset = np.mean(found - dense)
    np.testing.assert_allclose(found - offset, dense, atol=1e-4)  # m
    assert abs(offset) < 5e-4  # m: the outer ring of 13 rays reaches further than an even spread


def test_over_a_narrow_gap_the_arc_stays_on_the_edges(scene):
    gap = '<geom type="box" size=".05 .02 .01" pos="0 {y} -.01"/>'
    world = gap.format(y=0.0204) + gap.format(y=-0.0204)
    distance_m = felt(scene, world, torches([0.0, 0.01]))
    assert distance_m[1] == pytest.approx(CONTACT_TIP_M, rel=1e-9)
    assert 0 < distance_m[0] - distance_m[1] < 1e-3  # less foot, but no fall into the depth


def test_without_work_it_is_infinite(scene):
    assert np.isinf(felt(scene, PLATE, torches([0.0], rotation=-DOWN @ np.diag([1.0, -1, 1])))[0])

"""What is lit and what is seen, against hand-made geometry."""

import numpy as np
import pytest

from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster

FLOOR = '<geom type="plane" size="0 0 1" pos="0 0 -.05"/>'


def section_of(scene_and_pose, camera, fan):
    (model, data), T_base_camera = scene_and_pose
    section = light_section(RayCaster(model), data, T_base_camera, camera, fan)
    return section, T_base_camera.apply(section.points_camera)


def test_lit_points_lie_in_the_light_plane_and_on_the_surface(scene, overhead, camera, fan):
    section, points_base = section_of((scene('<geom type="sphere" size=".02"/>'), overhead()), camera, fan)
    assert section.lit.sum() > 500
    np.testing.assert_allclose(fan.plane.distance_m(section.points_camera[section.lit]), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points_base[section.lit], axis=1), 0.02, atol=1e-9)  # m
    assert np.isnan(section.points_camera[~section.lit]).all()


def test_incidence_and_normals_on_a_sphere_are_radial(scene, overhead, camera, fan):
    section, points_base = section_of((scene('<geom type="sphere" size=".02"/>'), overhead()), camera, fan)
    T_base_camera = overhead()
    source_base = T_base_camera.apply(fan.source_camera)
    lit = section.lit
    to_source = source_base - points_base[lit]
    cosine = np.einsum("ni,ni->n", points_base[lit] / 0.02, to_source) / np.linalg.norm(to_source, axis=1)
    np.testing.assert_allclose(section.incidence_cos[lit], cosine, atol=1e-7)  # rounding over the radius


def test_nothing_behind_an_edge_is_lit(scene, overhead, camera, fan):
    """A small roof shades the floor: the shade's borders follow from similar triangles."""
    roof = '<geom type="box" size=".05 .01 .001" pos="0 0 -.001"/>'
    section, points_base = section_of((scene(FLOOR + roof), overhead()), camera, fan)
    on_floor = section.lit & (points_base[:, 2] < -0.04)
    height = 0.275 / np.sqrt(2)
    shade = 0.01 * (height + 0.05) / height  # its upper edges are at z = 0
    gap = np.abs(points_base[on_floor, 1]).min()
    assert shade - 1e-9 < gap < shade + 1e-4  # m, one spacing of the rays


def test_nothing_hidden_is_seen(scene, overhead, camera, fan):
    """A wall between camera and light hides the floor's stripe where, and only where, sight lines cross it."""
    wall = '<geom type="box" size=".001 .02 .02" pos=".02 0 -.03"/>'  # in front of the light, seen from the camera
    section, points_base = section_of((scene(FLOOR + wall), overhead()), camera, fan)
    centre_base = overhead().translation
    lit = np.flatnonzero(section.lit)
    at_wall = (0.019 - points_base[lit, 0]) / (centre_base[0] - points_base[lit, 0])
    crossing = points_base[lit] + at_wall[:, None] * (centre_base - points_base[lit])
    at_front = (0.021 - points_base[lit, 0]) / (centre_base[0] - points_base[lit, 0])
    front = points_base[lit] + at_front[:, None] * (centre_base - points_base[lit])
    hidden = ((np.abs(crossing[:, 1]) < 0.02) | (np.abs(front[:, 1]) < 0.02)) & (crossing[:, 2] < -0.01)
    inside = camera.in_picture(section.pixels[lit])
    np.testing.assert_array_equal(section.seen[lit], inside & ~hidden)
    assert hidden.sum() > 400


def test_grazing_sight_hides_nothing_by_itself(scene, overhead, camera, fan):
    """A plane tilted until the camera looks along it at 0.2 degrees: every lit point in the picture is seen."""
    tilt_deg = 45 - 0.2
    tilted = f'<geom type="box" size=".1 .1 .001" euler="0 {tilt_deg} 0"/>'
    section, _ = section_of((scene(tilted), overhead()), camera, fan)
    inside = section.lit & camera.in_picture(section.pixels)
    assert inside.sum() > 1000
    np.testing.assert_array_equal(section.seen, inside)


def test_a_surface_turned_away_from_the_camera_is_not_seen(scene, overhead, camera, fan):
    tilted = '<geom type="box" size=".1 .1 .001" euler="0 -60 0"/>'
    section, _ = section_of((scene(tilted), overhead()), camera, fan)
    assert section.lit.any() and not section.seen.any()


@pytest.mark.parametrize("shape", ['type="sphere" size=".6"', 'type="box" size=".6 .6 .6"'])
def test_a_sensor_inside_metal_lights_nothing(scene, overhead, camera, fan, shape):
    section, _ = section_of((scene(f"<geom {shape}/>"), overhead()), camera, fan)
    assert not section.lit.any() and not section.seen.any() and (section.geom_id == -1).all()


def test_a_camera_inside_metal_sees_nothing(scene, overhead, camera, fan):
    block = f'<geom type="box" size=".03 .03 .03" pos="{" ".join(str(x) for x in overhead().translation)}"/>'
    section, _ = section_of((scene(FLOOR + block), overhead()), camera, fan)
    assert section.lit.any() and not section.seen.any()


def test_the_light_at_each_point_is_that_of_the_fan(scene, overhead, camera, fan):
    """Its direction, the plane's normal, and the sheet as thick as the way from the laser made it."""
    section, _ = section_of((scene(FLOOR), overhead()), camera, fan)
    lit = section.lit
    np.testing.assert_array_equal(section.directions_camera, fan.directions_camera)
    np.testing.assert_array_equal(section.sheet_normals_camera - fan.plane.normal_camera, 0)
    way_m = np.linalg.norm(section.points_camera[lit] - fan.source_camera, axis=1)
    half_width_m = 80e-6 * np.sqrt(1 + ((way_m - 0.275 * np.sqrt(0.5)) / 25.46377e-3) ** 2)  # P2's sheet, by hand
    np.testing.assert_allclose(section.sheet_sigma_m[lit], half_width_m / 2, rtol=1e-6)

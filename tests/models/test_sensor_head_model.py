"""The sensor head: its optical layout for each preset, and that it blocks neither view nor light nor torch."""

import mujoco
import numpy as np
import pytest
from manifold3d import Manifold

from weldcell.cell.configuration import SENSOR_PRESETS
from weldcell.cell.world.scene import head_design
from weldcell.models.sensor_head import SENSOR_MASS_KG, HeadDesign, build_sensor_head, head_pieces
from weldcell.models.torch import T_FLANGE_TORCH, torch_pieces
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera

SAME = 1e-9  # m, and as a cosine: rounding of some 1e-16 over a few products and square roots
WINDOW_M = 0.0225  # just outside the windows, from camera centre and laser source


@pytest.fixture(scope="module", params=list(SENSOR_PRESETS))
def sensor(request):
    return SENSOR_PRESETS[request.param]


@pytest.fixture(scope="module")
def design(sensor):
    return head_design(sensor)


@pytest.fixture(scope="module")
def head(design):
    return [piece.solid for piece in head_pieces(design, design.T_flange_camera)]


@pytest.fixture(scope="module")
def torch():
    return [piece.solid for piece in torch_pieces()]


def test_camera_of_p2_stands_where_its_drawing_says():
    T_torch_camera = HeadDesign().T_torch_camera
    root = np.sqrt(2)
    np.testing.assert_allclose(T_torch_camera.translation, [0.060 + 0.275 / root, 0, 0.025 - 0.275 / root], atol=1e-12)
    expected = np.array([[0, 1 / root, -1 / root], [-1, 0, 0], [0, 1 / root, 1 / root]])
    np.testing.assert_allclose(T_torch_camera.rotation.as_matrix(), expected, atol=1e-12)


def test_defaults_are_those_of_p2():
    assert head_design(SENSOR_PRESETS["p2"]) == HeadDesign()


def test_the_light_plane_is_vertical_and_stands_ahead_of_the_tip(sensor, design):
    plane = nominal_plane(sensor)
    normal_torch = design.T_torch_camera.rotation.apply(plane.normal_camera)
    np.testing.assert_allclose(normal_torch, [-1, 0, 0], atol=SAME)  # away from the camera, which stands beyond it
    in_plane_torch = design.T_torch_camera.apply(plane.offset_m * plane.normal_camera)
    assert in_plane_torch[0] == pytest.approx(1e-3 * sensor.look_ahead_mm, abs=SAME)


def test_camera_axis_meets_the_light_below_the_tip(sensor, design):
    crossing_torch = design.T_torch_camera.apply([0, 0, 1e-3 * sensor.working_distance_mm])
    np.testing.assert_allclose(
        crossing_torch, 1e-3 * np.array([sensor.look_ahead_mm, 0, sensor.below_tip_mm]), atol=SAME
    )
    np.testing.assert_allclose(T_FLANGE_TORCH.apply(crossing_torch), design.crossing_flange, atol=SAME)


def test_a_deeper_point_and_one_to_the_right_move_as_the_conventions_say(sensor, design):
    """Deeper is +v (rows) or +u (columns); the torch's +y, right of the travel, is -u (rows) or +v (columns)."""
    points_torch = 1e-3 * (np.array([sensor.look_ahead_mm, 0, sensor.below_tip_mm]) + [[0, 0, 0], [0, 0, 1], [0, 1, 0]])
    pixels = nominal_camera(sensor).project(design.T_torch_camera.inv().apply(points_torch))
    deeper, right = pixels[1:] - pixels[0]
    along, across = (0, 1) if sensor.stripe_along == "rows" else (1, 0)
    assert deeper[across] > 1 and abs(deeper[along]) < 0.05 * deeper[across]  # px for 1 mm; lens distortion
    assert abs(right[along]) > 1 and abs(right[across]) < 0.05 * abs(right[along])
    assert np.sign(right[along]) == (-1 if sensor.stripe_along == "rows" else 1)


def test_laser_source_lies_straight_above_the_crossing_where_the_simulated_fan_starts(sensor, design):
    np.testing.assert_allclose(design.source_camera, nominal_source_camera(sensor), atol=SAME)
    source_torch = design.T_torch_camera.apply(design.source_camera)
    assert source_torch[:2] == pytest.approx([1e-3 * sensor.look_ahead_mm, 0], abs=SAME)
    assert source_torch[2] < design.below_tip_m


def test_laser_of_p1_stands_on_the_cameras_x_axis_at_the_base_length():
    """P1, table I: b = 91.42 mm. Rounded to 1 um in the preset."""
    np.testing.assert_allclose(head_design(SENSOR_PRESETS["p1"]).source_camera, [-0.09142, 0, 0], atol=2e-6)


def test_sites_are_camera_and_laser_source(design):
    model = build_sensor_head(design).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    source_flange = design.T_flange_camera.apply(design.source_camera)
    np.testing.assert_allclose(data.site("camera").xpos, design.T_flange_camera.translation, atol=1e-12)
    np.testing.assert_allclose(data.site("laser_source").xpos, source_flange, atol=1e-12)
    assert set(model.geom_group) == {3}
    assert set(model.geom_contype) == {1}
    assert set(model.geom_conaffinity) == {2}
    assert model.body("sensor_head").mass[0] == pytest.approx(SENSOR_MASS_KG)


def view_cone(sensor, design):
    """What the camera sees (lens distortion left out) from just outside its window to the light plane."""
    half = np.array([sensor.width_px, sensor.height_px]) * 0.5e-3 * sensor.pixel_um / sensor.focal_mm
    corners = np.array([[u * half[0], v * half[1], 1] for u in (-1, 1) for v in (-1, 1)])
    far = nominal_plane(sensor).intersect(corners)
    return Manifold.hull_points(design.T_flange_camera.apply(np.concatenate([corners * WINDOW_M * 1.1, far])))


def light_fan(sensor, design, thickness_m=0.002):
    """The light sheet, from just outside the laser's window to 60 mm past the crossing."""
    source, crossing = design.source_camera, np.array([0, 0, design.stand_off_m])
    normal = nominal_plane(sensor).normal_camera
    along = (crossing - source) / design.laser_range_m
    side, slope = np.cross(normal, along), np.tan(np.deg2rad(sensor.laser_fan_deg / 2))
    points = [
        source + length * (along + s * slope * side) + n * thickness_m / 2 * normal
        for length in (WINDOW_M, design.laser_range_m + 0.060)
        for s in (-1, 1)
        for n in (-1, 1)
    ]
    return Manifold.hull_points(design.T_flange_camera.apply(np.array(points)))


@pytest.mark.parametrize("light", [view_cone, light_fan])
def test_nothing_stands_in_the_light(light, sensor, design, head, torch):
    beam = light(sensor, design)
    assert beam.volume() > 1e-6
    for solid in head + torch:
        assert (beam ^ solid).volume() < 1e-15  # m3


def test_housing_encloses_camera_and_laser_with_margin(design, head):
    housing = head[0] + head[1] + head[2]
    for centre_camera in (np.zeros(3), design.source_camera):
        ball = Manifold.sphere(0.015, 32).translate(tuple(design.T_flange_camera.apply(centre_camera)))
        assert (ball - housing).volume() < 1e-12  # m3: 15 mm of housing all round


def test_head_is_one_piece_and_its_bracket_carries_it(head):
    """Housing and bracket overlap or touch: nothing floats."""
    whole = head[0]
    for solid in head[1:]:
        whole = whole + solid
    assert whole.volume() < sum(solid.volume() for solid in head)
    bracket = head[-3] + head[-2]
    assert (head[0] + head[1] + head[2]).min_gap(bracket, 0.01) == 0
    assert head[-3].min_gap(head[-2], 0.01) == 0


def test_head_keeps_clear_of_the_torch(head, torch):
    gap_m = min(a.min_gap(b, 0.1) for a in head for b in torch)
    assert gap_m > 0.001


def test_housing_keeps_clear_of_nozzle_and_neck(head, torch):
    """Room for a hand's misplacement and for spatter: the housing is nowhere nearer than 15 mm."""
    assert min(a.min_gap(b, 0.1) for a in head[:3] for b in torch) > 0.015


def test_all_solids_are_closed(head):
    assert all(solid.volume() > 0 for solid in head)

"""Labels against closed forms of small scenes, against OpenCV's projection, and against the light that is drawn."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import SENSOR_PRESETS, SensorConfig
from weldcell.cell.frames import rigid_from, translation
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.labels import (
    Visibility,
    ghost_truth,
    hidden_section,
    stripe_mask,
    stripe_truth,
)
from weldcell.sensor_sim.laser import laser_fan
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.seam_labels import feature_truth, line_crossing
from weldcell.sensor_sim.stripe import stripe_optics, stripe_pieces

FLOOR = '<geom name="floor" type="box" size=".5 .5 .01" pos="0 0 -.01"/>'


class Sensor:
    """A nominal sensor whose light falls straight down through the base's origin, where the camera looks along -x."""

    def __init__(self, config: SensorConfig, model, data, *, yaw_rad: float = 0.0):
        angle_rad = np.deg2rad(config.triangulation_deg)
        forward = np.array([-np.sin(angle_rad), 0, -np.cos(angle_rad)])
        deeper, across = np.array([np.cos(angle_rad), 0, -np.sin(angle_rad)]), np.array([0.0, 1, 0])
        axes = [across, deeper, forward] if config.stripe_along == "rows" else [deeper, -across, forward]
        rotation = Rotation.from_matrix(np.column_stack(axes))
        self.T_base_camera = rigid_from(Rotation.from_rotvec([0, 0, yaw_rad]), np.zeros(3)) * rigid_from(
            rotation, -1e-3 * config.working_distance_mm * forward
        )
        self.camera, self.plane = nominal_camera(config), nominal_plane(config)
        self.fan = laser_fan(config, self.plane, nominal_source_camera(config))
        self.optics = stripe_optics(config, self.camera, self.fan)
        self.caster, self.data = RayCaster(model), data
        self.section = light_section(self.caster, data, self.T_base_camera, self.camera, self.fan)
        self.pieces = self._pieces(self.section)
        hidden = self._pieces(hidden_section(self.section, self.camera))
        self.truth = stripe_truth(self.section, self.pieces, hidden, self.camera, self.plane)
        self.points_base = self.T_base_camera.apply(self.truth.points_camera)

    def _pieces(self, section):
        return stripe_pieces(section, np.ones(len(section.lit)), self.camera, self.optics)

    def light(self):
        """Grey levels of the whole picture, laser light only."""
        picture = np.zeros((self.camera.height_px, self.camera.width_px))
        laser = draw_stripe(self.pieces, self.camera.width_px, self.camera.height_px)
        picture[laser.window] = laser.grey
        return picture

    def features(self, lines_base):
        lines = {name: self.T_base_camera.inv().apply(np.asarray(line, float)) for name, line in lines_base.items()}
        return feature_truth(lines, self.camera, self.fan, self.caster, self.data, self.T_base_camera)


@pytest.fixture(scope="module")
def groove(scene):
    """A straight V-groove along x, 20 mm deep, 60 degrees, edges in z = 0; and its exact lines in the base."""
    plate = v_groove_plate(0.2, 0.3, 0.03, np.radians(60), 0.0, 0.01, 0.0)
    half_top = 0.02 * np.tan(np.radians(30))
    lines = {"left": [[-1, half_top, 0], [1, half_top, 0]], "root": [[-1, 0, -0.02], [1, 0, -0.02]]}
    lines["right"] = [[-1, -half_top, 0], [1, -half_top, 0]]

    def build(world: str = ""):
        import mujoco

        spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{world}</worldbody></mujoco>")
        plate.add_to(spec, translation([0, 0, -0.03]))
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        return model, data

    return build, lines


@pytest.mark.parametrize("preset", ["p2", "p1", "profiler"])
def test_the_true_centre_is_the_centre_of_the_light_in_the_picture(groove, preset):
    build, _ = groove
    sensor = Sensor(SENSOR_PRESETS[preset], *build())
    truth, light = sensor.truth, sensor.light()
    along, across = (0, 1) if sensor.pieces.along == "rows" else (1, 0)
    light = light if along == 0 else light.T  # its columns are the cuts now
    cuts = truth.pixels[:, along].astype(int)
    alone = truth.seen & (np.bincount(cuts, minlength=light.shape[1])[cuts] == 1) & (light.sum(axis=0)[cuts] > 1)
    rows = np.arange(len(light))[:, None]
    window = np.abs(rows - truth.pixels[None, :, across]) <= 3 * np.nan_to_num(truth.sigma_px)
    held = np.where(window, light[:, cuts], 0)
    centre = (rows * held).sum(axis=0) / np.maximum(held.sum(axis=0), 1e-9)
    off_px = np.abs(centre - truth.pixels[:, across])[alone]
    assert alone.sum() > 0.9 * light.shape[1]
    assert np.quantile(off_px, 0.97) < 0.02  # px; the window cuts the tails unevenly, corners have two pieces' light
    assert off_px.max() < 1.0


@pytest.mark.parametrize("preset", ["p2", "p1", "profiler"])
def test_points_lie_on_the_light_plane_on_their_pixels_ray_and_on_the_plate(groove, preset):
    build, _ = groove
    sensor = Sensor(SENSOR_PRESETS[preset], *build())
    lit = sensor.truth.visibility > 0
    points_camera, (x, y, z) = sensor.truth.points_camera[lit], sensor.points_base[lit].T
    assert np.abs(sensor.plane.distance_m(points_camera)).max() < 1e-12  # m, rounding
    seen_px = sensor.camera.project(points_camera)
    assert np.abs(seen_px - sensor.truth.pixels[lit]).max() < 1e-8  # px, the lens's inverse
    wall_z = np.maximum(-0.02 + np.abs(y) / np.tan(np.radians(30)), -0.02)
    off_m = np.abs(z - np.minimum(wall_z, 0))
    assert np.quantile(off_m, 0.97) < 1e-6  # m: the stripe is right to 0.02 px, a pixel is 80 um
    assert np.abs(x).max() < 1e-12


def test_normals_are_those_of_the_faces(groove):
    build, _ = groove
    sensor = Sensor(SensorConfig(), *build())
    lit = sensor.truth.visibility > 0
    _, y, z = sensor.points_base[lit].T
    normals_base = sensor.T_base_camera.rotation.apply(sensor.truth.normals_camera[lit])
    top, left_wall = np.abs(z) < 5e-6, (z < -1e-3) & (y > 0)  # left of the groove's middle
    np.testing.assert_allclose(
        normals_base[top & (np.abs(y) > 0.012)], [[0, 0, 1]] * np.sum(top & (np.abs(y) > 0.012)), atol=1e-6
    )
    wall = np.array([0, -np.cos(np.radians(30)), np.sin(np.radians(30))])
    np.testing.assert_allclose(normals_base[left_wall], [wall] * left_wall.sum(), atol=1e-6)


def test_what_a_block_hides_is_lit_but_hidden_and_dark_in_the_picture(scene):
    """The block's top edge is above all camera rays to the floor's line; its near side bounds what it hides."""
    block = '<geom name="block" type="box" size=".01 .02 .04" pos=".03 0 .04"/>'
    sensor = Sensor(SensorConfig(), *scene(FLOOR + block))
    camera_x = sensor.T_base_camera.translation[0]
    hidden_to_m = 0.02 / (1 - 0.04 / camera_x)  # of the floor's line, by similar triangles
    y = sensor.points_base[:, 1]
    inside = np.abs(y) < hidden_to_m
    edge = np.abs(np.abs(y) - hidden_to_m) < 50e-6  # m; half the spacing of two rays
    assert np.all(sensor.truth.visibility[inside & ~edge] == Visibility.HIDDEN)
    assert np.all(sensor.truth.visibility[~inside & ~edge] == Visibility.SEEN)
    assert inside.sum() > 300
    hidden_columns = sensor.truth.pixels[inside & ~edge, 0].astype(int)
    margin = 6  # px: the stripe's end fades over the blur
    assert np.all(sensor.light()[:, hidden_columns[margin:-margin]] == 0)
    np.testing.assert_allclose(sensor.points_base[inside & ~edge, 2], 0, atol=1e-9)  # m: it is the floor that is lit


def test_columns_that_the_fan_does_not_reach_are_dark_and_have_their_row(scene):
    config = replace(SensorConfig(), laser_fan_deg=10.0)
    sensor = Sensor(config, *scene(FLOOR))
    half_m = np.linalg.norm(nominal_source_camera(config) - [0, 0, 0.275]) * np.tan(np.radians(5))
    dark = sensor.truth.visibility == Visibility.NOT_LIT
    assert np.nanmax(np.abs(sensor.points_base[:, 1])) == pytest.approx(half_m, abs=50e-6)  # m; half a ray's spacing
    assert np.all(np.isnan(sensor.truth.points_camera[dark])) and np.all(sensor.truth.geom_id[dark] == -1)
    np.testing.assert_array_equal(np.unique(sensor.truth.pixels[:, 0]), np.arange(config.width_px))
    dark_columns, lit_columns = (np.unique(sensor.truth.pixels[rows, 0]) for rows in (dark, ~dark))
    well_off = np.abs(dark_columns[:, None] - lit_columns).min(axis=1) > 6  # px: the stripe's end fades over the blur
    assert np.all(sensor.light()[:, dark_columns[well_off].astype(int)] == 0)


@pytest.mark.parametrize("yaw_deg", [0.0, 36.0, 45.0])
def test_a_wall_is_hidden_where_it_turns_away_from_the_camera(groove, yaw_deg):
    """Turned by 36 degrees, the camera stands close to the left wall's own plane; light falls on it all the same."""
    build, _ = groove
    sensor = Sensor(SensorConfig(), *build(), yaw_rad=np.radians(yaw_deg))
    on_wall = (sensor.points_base[:, 1] > 1e-4) & (sensor.points_base[:, 2] < -1e-4)  # below the top
    to_camera = sensor.T_base_camera.translation - sensor.points_base[on_wall]
    towards = to_camera @ [0, -np.cos(np.radians(30)), np.sin(np.radians(30))]
    clear = np.abs(towards) > 1e-4
    expected = np.where(towards > 0, Visibility.SEEN, Visibility.HIDDEN)
    assert clear.sum() > 50
    np.testing.assert_array_equal(sensor.truth.visibility[on_wall][clear], expected[clear])


@pytest.mark.parametrize("preset", ["p2", "p1", "profiler"])
def test_features_are_where_the_light_plane_cuts_the_edges(groove, preset):
    """The light plane is x = 0 in the base, so that the features are known without any intersection."""
    build, lines = groove
    sensor = Sensor(SENSOR_PRESETS[preset], *build())
    features = sensor.features(lines)
    half_top = 0.02 * np.tan(np.radians(30))
    points_base = sensor.T_base_camera.apply(features.points_camera)
    np.testing.assert_allclose(points_base, [[0, half_top, 0], [0, 0, -0.02], [0, -half_top, 0]], atol=1e-12)
    rvec = sensor.T_base_camera.rotation.inv().as_rotvec()
    tvec = sensor.T_base_camera.inv().translation
    expected, _ = cv2.projectPoints(
        np.ascontiguousarray(points_base), rvec, tvec, sensor.camera.matrix, sensor.camera.distortion
    )
    np.testing.assert_allclose(features.pixels, expected[:, 0], atol=1e-6)  # px
    assert features.names == ("left", "root", "right")
    assert features.visibility.tolist() == [2, 2, 2]


def test_features_lie_where_the_stripes_faces_meet(groove):
    build, lines = groove
    sensor = Sensor(SensorConfig(), *build())
    pixels, y = sensor.truth.pixels[sensor.truth.seen], sensor.points_base[sensor.truth.seen, 1]
    faces = [pixels[(y > low) & (y < high)] for low, high in ((0.013, 0.02), (0.001, 0.011), (-0.011, -0.001))]
    (a, b), (c, d), (e, f) = (np.polyfit(face[:, 0] - 720, face[:, 1], 1) for face in faces)
    crossings = np.array([[(d - b) / (a - c), 0], [(f - d) / (c - e), 0]]) + [720, 0]
    crossings[:, 1] = np.polyval([a, b], crossings[0, 0] - 720), np.polyval([c, d], crossings[1, 0] - 720)
    off_px = np.linalg.norm(crossings - sensor.features(lines).pixels[:2], axis=1)
    assert off_px.max() < 0.5  # px; the lens bends the lines that were fitted straight


def test_a_feature_behind_a_block_is_hidden_and_one_in_its_shadow_is_not_lit(groove):
    build, lines = groove
    half_top = 0.02 * np.tan(np.radians(30))
    before_left = f'<geom name="block" type="box" size=".005 .005 .02" pos=".03 {half_top} .03"/>'
    above_right = f'<geom name="roof" type="box" size=".002 .004 .001" pos="0 {-half_top} .05"/>'
    features = Sensor(SensorConfig(), *build(before_left + above_right)).features(lines)
    assert features.visibility.tolist() == [Visibility.HIDDEN, Visibility.SEEN, Visibility.NOT_LIT]
    assert np.all(np.isfinite(features.pixels))  # where they would be


def test_a_feature_out_of_the_picture_or_off_the_plane_is_not_lit(groove):
    build, lines = groove
    far = {"far": np.array([[-1, 0.12, 0], [1, 0.12, 0]]), "ahead": np.array([[0.1, 0, 0], [1, 0, 0]])}
    features = Sensor(SensorConfig(), *build()).features(lines | far)
    assert features.visibility[3:].tolist() == [0, 0]
    assert np.all(np.isfinite(features.points_camera[3])) and np.all(np.isnan(features.points_camera[4]))


def test_of_several_crossings_the_nearest_counts():
    plane = nominal_plane(SensorConfig())
    zigzag = np.array([[0.03, 0, 0.2], [0.03, 0, 0.4], [0.001, 0, 0.4], [0.001, 0, 0.2]])
    crossing = line_crossing(zigzag, plane, np.array([0, 0, 0.275]))
    np.testing.assert_allclose(crossing, [0.001, 0, 0.275], atol=1e-12)  # the plane meets the axis at 0.275 m


@pytest.mark.parametrize("preset", ["p2", "p1"])
def test_the_mask_covers_what_is_brighter_than_the_peak_over_e_squared(groove, preset):
    build, _ = groove
    sensor = Sensor(SENSOR_PRESETS[preset], *build())
    mask, light, pieces = stripe_mask(sensor.pieces, sensor.camera), sensor.light(), sensor.pieces
    if pieces.along == "columns":
        mask, light = mask.T, light.T
    peak = np.zeros(light.shape[1])
    np.maximum.at(peak, pieces.cut_px, pieces.amplitude_grey)
    bright = light > np.exp(-2) * peak
    same = np.all(mask == bright, axis=0)
    assert same.mean() > 0.97  # the rest are corners, where two pieces' light adds up
    assert mask.sum() == pytest.approx(bright.sum(), rel=0.01)


def test_what_is_too_faint_for_a_grey_level_is_not_in_the_mask(groove):
    build, _ = groove
    sensor = Sensor(SensorConfig(), *build())
    faint = replace(sensor.pieces, amplitude_grey=np.full_like(sensor.pieces.amplitude_grey, 0.6))
    assert not stripe_mask(faint, sensor.camera).any()
    assert stripe_mask(faint, sensor.camera, faintest_grey=0.5).any()


def test_ghost_points_from_tangent_planes_agree_with_the_light_plane(groove):
    """The first bounce has both: its points must come out the same without the light plane."""
    build, _ = groove
    sensor = Sensor(SensorConfig(), *build())
    ghosts, seen = ghost_truth([(sensor.section, sensor.pieces)], sensor.camera), sensor.truth.seen
    order = np.lexsort((ghosts.pixels[:, 1], ghosts.pixels[:, 0]))
    off_m = np.linalg.norm(ghosts.points_camera[order] - sensor.truth.points_camera[seen], axis=1)
    assert np.quantile(off_m, 0.97) < 2e-6  # m: 0.02 px of 80 um, and flat walls stretch it a little

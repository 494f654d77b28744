"""Ghost stripes against mirror geometry by hand, against light thrown ray by ray, and where there must be none."""

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.frames import rigid_from, translation
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.ghosts import GhostTracer
from weldcell.sensor_sim.laser import laser_fan
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.materials import MATERIALS
from weldcell.sensor_sim.mirrors import Mirrors
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import fresnel, light_reference
from weldcell.sensor_sim.stripe import stripe_optics, stripe_pieces

EVERY = 3  # a ghost has every third ray of the laser
ROOT_Z, HALF_RAD = 0.004, np.deg2rad(22.5)
WALLS = {
    side: (np.array([0.0, side * np.cos(HALF_RAD), np.sin(HALF_RAD)]), ROOT_Z * np.sin(HALF_RAD)) for side in (-1, 1)
}
"""The walls of a straight groove of 45 deg by hand: outward normal n and d of n.p = d; +1 is the one at -y."""


class Bench:
    """The nominal sensor over a scene."""

    def __init__(self, model, T_base_camera):
        self.config = SensorConfig()
        self.camera, self.T_base_camera = nominal_camera(self.config), T_base_camera
        self.fan = laser_fan(self.config, nominal_plane(self.config), nominal_source_camera(self.config))
        self.data = mujoco.MjData(model)
        mujoco.mj_forward(model, self.data)
        caster = RayCaster(model)
        self.section = light_section(caster, self.data, T_base_camera, self.camera, self.fan)
        tracer = GhostTracer(Mirrors(model, caster), self.camera, self.fan, light_reference(self.fan))
        self.ghosts = tracer.ghosts(self.data, T_base_camera, self.section)

    def base(self, points_camera):
        return self.T_base_camera.apply(points_camera)

    def pixels(self, points_base):
        """OpenCV's own projection."""
        T_camera_base = self.T_base_camera.inv()
        turn, shift = T_camera_base.rotation.as_rotvec(), T_camera_base.translation
        camera = self.camera
        return cv2.projectPoints(points_base.reshape(-1, 1, 3), turn, shift, camera.matrix, camera.distortion)[0][:, 0]


def leaning(yaw_deg=0.0, pitch_deg=0.0, roll_deg=0.0, x_m=0.0):
    """The sensor over the groove's middle: the crossing 15 mm below the plate's top, leant about it."""
    forward, across = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2), np.array([0.0, 1.0, 0.0])
    upright = np.column_stack([across, np.cross(forward, across), forward])
    R = Rotation.from_euler("zyx", [yaw_deg, pitch_deg, roll_deg], degrees=True).as_matrix() @ upright
    return rigid_from(Rotation.from_matrix(R), np.array([x_m, 0.0, 0.045]) - 0.275 * R[:, 2])


def groove(material, amplitude_m=0.0):
    spec = mujoco.MjSpec()
    plate = v_groove_plate(0.3, 0.16, 0.06, 2 * HALF_RAD, 0.0, ROOT_Z, amplitude_m).with_surface(material)
    plate.add_to(spec, translation([0, 0, 0]))
    return spec.compile()


def mirrored(points, wall):
    normal, d = wall
    return points - 2 * (points @ normal - d)[..., None] * normal


def onto(start, through, wall):
    """Where lines from `start` through points meet a wall's plane."""
    normal, d = wall
    step = through - start
    return start + ((d - start @ normal) / (step @ normal))[..., None] * step


def wall_of(points_base):
    """Which wall points lie on: its sign in WALLS."""
    return np.where(points_base[:, 1] < 0, 1, -1)


LEANINGS = [{}, {"yaw_deg": 12}, {"pitch_deg": 8}, {"yaw_deg": -20, "pitch_deg": -6}, {"yaw_deg": 7, "roll_deg": 4}]


@pytest.mark.parametrize("lean", LEANINGS, ids=str)
def test_the_ghost_lies_where_mirror_geometry_puts_it(lean):
    """Source mirrored in the one wall, its ray through the lit point cut with the other wall, projected by OpenCV.

    0.02 px for each ray: vertices in single precision turn the walls by 1e-7.
    """
    bench = Bench(groove("polished"), leaning(**lean))
    ghost = bench.ghosts[0].section
    index = np.flatnonzero(ghost.visible)
    assert len(index) > 50
    lit_base = bench.base(bench.section.points_camera[EVERY * index])
    side, source_base = wall_of(lit_base), bench.base(bench.fan.source_camera)
    expected = np.empty_like(lit_base)
    for sign in (-1, 1):
        here = side == sign
        expected[here] = onto(mirrored(source_base, WALLS[sign]), lit_base[here], WALLS[-sign])
    error_px = np.linalg.norm(bench.pixels(expected) - ghost.pixels[index], axis=1)
    assert error_px.max() < 0.02


@pytest.mark.parametrize("lean", LEANINGS[1:], ids=str)
def test_the_drawn_ghost_is_the_mirrored_planes_line(lean):
    """The light plane mirrored in a wall cuts the other in a straight line: drawn centres lie on it within 0.02 px.

    Each drawn centre is led back to the wall that it lies on; its distance there from the mirrored plane is turned into
    pixels by the picture's scale (79 um). At the root a piece bridges the corner between two rays 1.5 px apart: 0.5 px.
    """
    bench = Bench(groove("polished"), leaning(**lean))
    optics = stripe_optics(bench.config, bench.camera, bench.fan)
    ghost = bench.ghosts[0]
    pieces = stripe_pieces(ghost.section, ghost.brightness, bench.camera, optics)
    inner = pieces.coverage > 0.99
    rays = bench.camera.unproject(np.column_stack([pieces.u_px, pieces.v_px])[inner])
    centre_base = bench.T_base_camera.translation
    ghost_side = wall_of(bench.base(ghost.section.points_camera)[np.rint(pieces.ray[inner]).astype(int)])
    R = bench.T_base_camera.rotation.as_matrix()
    normal_base = R @ bench.fan.plane.normal_camera
    source_base = bench.base(bench.fan.source_camera)
    for sign in (-1, 1):
        seen = centre_base + rays[ghost_side == -sign] @ R.T
        points = onto(centre_base, seen, WALLS[-sign])
        plane_normal = normal_base - 2 * (normal_base @ WALLS[sign][0]) * WALLS[sign][0]
        off_m = (points - mirrored(source_base, WALLS[sign])) @ plane_normal
        assert len(points) > 50
        assert np.quantile(np.abs(off_m), 0.98) < 0.02 * 79e-6 and np.abs(off_m).max() < 0.5 * 79e-6


def test_light_square_to_a_straight_groove_throws_its_ghost_on_the_stripe():
    """The mirrored plane is the plane itself: each ghost point lies in it (1e-8 m), so on the stripe."""
    bench = Bench(groove("polished"), leaning())
    ghost = bench.ghosts[0].section
    off_m = bench.fan.plane.distance_m(ghost.points_camera[ghost.visible])
    assert np.abs(off_m).max() < 1e-8 and ghost.visible.sum() > 100


@pytest.mark.parametrize("lean", LEANINGS, ids=str)
def test_the_mirror_image_lies_behind_the_wall(lean):
    """Lit points mirrored in the other wall and projected by OpenCV, where the sight line meets that wall: 0.02 px."""
    bench = Bench(groove("polished"), leaning(**lean))
    image = bench.ghosts[1].section
    index = np.flatnonzero(image.visible)
    assert len(index) > 50
    lit_base = bench.base(bench.section.points_camera[EVERY * index])
    behind = np.empty_like(lit_base)
    for sign in (-1, 1):
        here = wall_of(lit_base) == sign
        behind[here] = mirrored(lit_base[here], WALLS[-sign])
    error_px = np.linalg.norm(bench.pixels(behind) - image.pixels[index], axis=1)
    assert error_px.max() < 0.02


def test_an_image_in_a_curved_wall_obeys_the_law_of_reflection():
    """S-shaped groove: sight line and the ray from the place in the mirror to the lit point make equal angles with the
    exact wall's normal, within 4 mrad (3 of the search, 0.5 of the mesh), and the ways add up.
    """
    bench = Bench(groove("polished", 0.02), leaning(yaw_deg=10, x_m=0.02))
    image = bench.ghosts[1].section
    index = np.flatnonzero(image.visible)
    assert len(index) > 50
    lit, behind = bench.section.points_camera[EVERY * index], image.points_camera[index]
    sight = behind / np.linalg.norm(behind, axis=1, keepdims=True)
    hits = RayCaster(groove("polished", 0.02)).cast(
        bench.data, bench.T_base_camera.translation, sight @ bench.T_base_camera.rotation.as_matrix().T
    )
    place = hits.distance_m[:, None] * sight
    onward = lit - place
    way_m = np.linalg.norm(onward, axis=1)
    np.testing.assert_allclose(np.linalg.norm(behind, axis=1), hits.distance_m + way_m, atol=2e-6)  # rays leave at 1 um
    facets = hits.normals @ bench.T_base_camera.rotation.as_matrix()
    bisector = onward / way_m[:, None] - sight
    bisector /= np.linalg.norm(bisector, axis=1, keepdims=True)
    assert np.linalg.norm(bisector - facets, axis=1).max() < 2e-3 + 4e-3  # the facet's own error comes on top


@pytest.mark.parametrize("material", ["matt-white", "ground-steel", "mill-scale"])
def test_surfaces_that_are_no_mirrors_make_no_ghost(material):
    assert Bench(groove(material), leaning(yaw_deg=12)).ghosts == ()


def test_the_mirror_sends_on_its_share_and_no_more():
    """Ghost and stripe on opposite walls, both matt but for the mirror: the power for the angle is share times Fresnel.

    From the ghost's brightness back to power: over its radiance factor, cosine, way and thickness; the same steps as a
    light meter's, with the wall's lobe towards the camera below 1e-9 there. 0.2 %: at the ends of a wall a ray has a
    neighbour on one side only; elsewhere it is 1e-5.
    """
    bench = Bench(groove("polished"), leaning(yaw_deg=12))
    ghost, polished = bench.ghosts[0], MATERIALS["polished"]
    index = np.flatnonzero(ghost.section.visible)
    reference, section = light_reference(bench.fan), ghost.section
    spread = section.range_m / reference.range_m * section.sheet_sigma_m / reference.sheet_sigma_m
    power = (ghost.brightness * spread / section.incidence_cos / polished.diffuse_albedo)[index]
    first_cos = bench.section.incidence_cos[EVERY * index]
    share = polished.mirror_share * fresnel(np.full(len(index), polished.mirror_reflectance), first_cos)
    np.testing.assert_allclose(power, share, rtol=2e-3)
    assert np.median(np.abs(power / share - 1)) < 1e-5
    assert power.max() < polished.mirror_share + polished.diffuse_albedo <= 1


def thrown(bench, wall, ray, sheet_sigma_m, rng, count=20_000):
    """Distances from the mirrored plane of light of one ray that a rough wall throws on the other, facet by facet."""
    normal, _ = WALLS[wall]
    R = bench.T_base_camera.rotation.as_matrix()
    light = R @ bench.fan.directions_camera[ray]
    plane_normal = R @ bench.fan.plane.normal_camera
    lit_base = bench.base(bench.section.points_camera[ray])
    beside_m = sheet_sigma_m * rng.normal(size=count)
    start = onto(lit_base - 0.1 * light + beside_m[:, None] * plane_normal,
                 lit_base + beside_m[:, None] * plane_normal, WALLS[wall])  # fmt: skip
    across = np.linalg.svd(normal[None])[2][1:]
    slopes = MATERIALS["polished"].slope_roughness / np.sqrt(2) * rng.normal(size=(count, 2))
    facets = normal - slopes @ across
    facets /= np.linalg.norm(facets, axis=1, keepdims=True)
    onward = light - 2 * (facets @ light)[:, None] * facets
    met = onto(start, start + onward, WALLS[-wall])
    mirrored_normal = plane_normal - 2 * (plane_normal @ normal) * normal
    return (met - mirrored(bench.base(bench.fan.source_camera), WALLS[wall])) @ mirrored_normal


@pytest.mark.parametrize("share", [0.05, 0.2, 0.8])
def test_roughness_spreads_the_ghost_as_facets_would(share):
    """20 000 facets with Gaussian slopes: standard deviation across the mirrored sheet within 2 % (four sigma).

    The sheet itself is as thick as the beam is after the whole way.
    """
    bench = Bench(groove("polished"), leaning(yaw_deg=12, pitch_deg=5))
    ghost = bench.ghosts[0].section
    index = np.flatnonzero(ghost.visible)
    index = index[int(share * len(index))]
    wall = int(wall_of(bench.base(bench.section.points_camera[EVERY * index][None]))[0])
    beam_m = bench.fan.sheet.sigma_m(ghost.range_m[index])
    off_m = thrown(bench, wall, EVERY * index, beam_m, np.random.default_rng(4))
    assert ghost.sheet_sigma_m[index] == pytest.approx(off_m.std(), rel=0.02)
    assert ghost.sheet_sigma_m[index] > 1.05 * beam_m
    assert abs(off_m.mean()) < 4 * off_m.std() / np.sqrt(len(off_m)) + 1e-7


def test_a_polished_ball_spreads_the_light_along_and_across():
    """A ball of 20 mm on a matt floor, against rays reflected one by one in closed form.

    The floor's light after the ball: the sheet's thickness (from rays 10 um beside the plane) and the width for the
    angle (from the neighbours). 3 %: the model's neighbouring rays are 0.5 mrad apart, where the ball curves already.
    """
    radius_m, centre = 0.02, np.array([0.004, 0.006, 0.025])
    spec = mujoco.MjSpec()
    spec.add_material(name="ball/polished")
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], rgba=[1, 1, 1, 1])
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius_m, 0, 0], pos=centre, material="ball/polished"
    )
    bench = Bench(spec.compile(), leaning())
    ghost = bench.ghosts[0]
    section, reference = ghost.section, light_reference(bench.fan)
    index = np.flatnonzero(section.visible & (bench.section.incidence_cos[::EVERY] > 0.25))  # not at the ball's limb
    assert len(index) > 10
    source = bench.base(bench.fan.source_camera)
    R = bench.T_base_camera.rotation.as_matrix()
    plane_normal = R @ bench.fan.plane.normal_camera

    def floor(start, light):
        """Where rays land after the ball, and how they come."""
        offset = start - centre
        along = np.sum(offset * light, axis=1)
        way = -along - np.sqrt(along**2 - np.sum(offset**2, axis=1) + radius_m**2)
        met = start + way[:, None] * light
        normal = (met - centre) / radius_m
        onward = light - 2 * np.sum(light * normal, axis=1, keepdims=True) * normal
        return met - (met[:, 2:] / onward[:, 2:]) * onward, onward, normal, met

    directions = bench.fan.directions_camera @ R.T
    light = directions[EVERY * index]
    landed, onward, normal, met = floor(np.broadcast_to(source, light.shape), light)
    np.testing.assert_allclose(
        bench.base(section.points_camera[index]), landed, atol=5e-6
    )  # rays leave 1 um above the ball

    def beside(landed_other):
        """The neighbour's distance from the ray, within the plane square to it."""
        step = landed_other - landed
        return step - np.sum(step * onward, axis=1, keepdims=True) * onward

    turned = light + 1e-5 * np.cross(plane_normal, light)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    along = beside(floor(np.broadcast_to(source, light.shape), turned)[0]) / 1e-5
    across = beside(floor(source + 1e-5 * plane_normal + 0 * light, light)[0]) / 1e-5
    width_m = np.linalg.norm(along, axis=1)
    sheet = np.cross(onward, along) / width_m[:, None]
    stretch = np.abs(np.sum(across * sheet, axis=1))
    range_m = np.linalg.norm(met - source, axis=1) + np.linalg.norm(landed - met, axis=1)
    sigma_m = bench.fan.sheet.sigma_m(range_m) * stretch
    assert (section.sheet_sigma_m[index] / sigma_m).min() > 0.97  # roughness only adds
    polished = MATERIALS["polished"]
    mirror = fresnel(np.full(len(index), polished.mirror_reflectance), -np.sum(light * normal, axis=1))
    expected = polished.mirror_share * mirror * section.incidence_cos[index]
    expected *= reference.range_m / width_m * reference.sheet_sigma_m / section.sheet_sigma_m[index]
    np.testing.assert_allclose(ghost.brightness[index], expected, rtol=0.03)
    assert (width_m / range_m).min() > 3  # a flat mirror's would be 1


def test_what_stands_before_the_lit_place_hides_the_ghost():
    """A small plate between the camera and the groove takes away the part of the ghosts that lies behind it."""
    bare = Bench(groove("polished"), leaning(yaw_deg=12))
    spec = mujoco.MjSpec()
    v_groove_plate(0.3, 0.16, 0.06, 2 * HALF_RAD, 0.0, ROOT_Z, 0.0).with_surface("polished").add_to(
        spec, translation([0, 0, 0])
    )
    ghost = bare.ghosts[0].section
    middle = bare.base(np.median(ghost.points_camera[ghost.visible], axis=0))
    screen = middle + 0.3 * (bare.T_base_camera.translation - middle)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.004, 0, 0], pos=screen)
    hidden = Bench(spec.compile(), leaning(yaw_deg=12)).ghosts[0].section
    lost = ghost.visible & ~hidden.visible
    assert 10 < lost.sum() < ghost.visible.sum()
    to_screen = bare.T_base_camera.inv().apply(screen)
    sight = ghost.points_camera[lost] / np.linalg.norm(ghost.points_camera[lost], axis=1, keepdims=True)
    miss_m = np.linalg.norm(np.cross(sight, to_screen), axis=1)
    assert np.median(miss_m) < 0.004


def test_every_ghost_keeps_the_lasers_order_and_leaves_the_rest_empty():
    bench = Bench(groove("polished"), leaning(yaw_deg=12))
    for ghost in bench.ghosts:
        count = len(bench.fan.directions_camera[::EVERY])
        assert all(len(values) == count for values in vars(ghost.section).values())
        empty = ~ghost.section.lit
        assert np.isnan(ghost.brightness[empty]).all() and (ghost.section.geom_id[empty] == -1).all()
        assert not ghost.section.seen[~ghost.section.visible].any()

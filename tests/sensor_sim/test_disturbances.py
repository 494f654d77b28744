"""Scripted disturbances: between their times, of their strength, the same in any order; else nothing at all."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import Disturbance
from weldcell.cell.frames import difference, rigid_from
from weldcell.sensor_sim.disturbances import Disturbances
from weldcell.sensor_sim.drawing import draw_stripe
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import irradiance, light_reference
from weldcell.sensor_sim.stripe import stripe_optics, stripe_pieces
from weldcell.sensor_sim.weld.weld_light import WeldLight

PLATE = '<geom type="box" size=".2 .2 .01" pos="0 0 -.01" rgba=".5 .5 .5 1"/>'
T_BASE_TORCH = rigid_from(Rotation.from_matrix(np.diag([1.0, -1.0, -1.0])), np.array([-0.06, 0.0, 0.0]))
TIMES_S = (0.31, 0.7, 1.234, 1.9)


def entry(kind, strength=1.0, start_s=0.0, end_s=10.0) -> Disturbance:
    return Disturbance(kind=kind, strength=strength, start_s=start_s, end_s=end_s)


@pytest.fixture(scope="module")
def workshop(scene, config, camera, fan, overhead):
    """Makes disturbances over a plate, and frames of them."""
    model, data = scene(PLATE)
    optics = stripe_optics(config, camera, fan)
    weld = WeldLight(config, camera, fan, optics, model, RayCaster(model))

    class Workshop:
        ambient = np.full((1080, 1440), 9.0, np.float32)

        def disturbances(self, *script, seed=1) -> Disturbances:
            return Disturbances(script, seed, 1e-3 * config.exposure_ms, lambda: weld)

        def frame(self, disturbances, time_s):
            return disturbances.frame(time_s, data, overhead(), T_BASE_TORCH)

        def picture(self, disturbances, time_s):
            return self.frame(disturbances, time_s).disturb_ambient(self.ambient)

        def pieces(self):
            section = light_section(RayCaster(model), data, overhead(), camera, fan)
            brightness = irradiance(section, fan.power_ratio, light_reference(fan))
            return stripe_pieces(section, brightness, camera, optics)

    return Workshop()


@pytest.fixture(scope="module")
def pieces(workshop):
    return workshop.pieces()


KINDS = ("arc", "spatter", "fume", "stripe-lost", "sensor-knocked", "stuck-exposure")


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_happens_before_the_start_and_from_the_end_on(workshop, pieces, overhead, kind):
    disturbances = workshop.disturbances(entry(kind, 1.0, 1.0, 2.0))
    for time_s in (0.0, 0.9999, 2.0, 5.0):
        frame = workshop.frame(disturbances, time_s)
        assert frame.disturb_ambient(workshop.ambient) is workshop.ambient
        assert frame.dim_laser(pieces) is pieces
        assert (frame.exposure_ratio, difference(frame.T_base_camera, overhead())) == (1.0, (0.0, 0.0))


@pytest.mark.parametrize("kind", ["arc", "spatter", "fume"])
def test_pictures_are_the_same_in_any_order_and_from_any_worker(workshop, kind):
    disturbances = workshop.disturbances(entry(kind))
    forth = {t: workshop.picture(disturbances, t).tobytes() for t in TIMES_S}
    back = {t: workshop.picture(disturbances, t).tobytes() for t in reversed(TIMES_S)}
    other = {t: workshop.picture(workshop.disturbances(entry(kind)), t).tobytes() for t in TIMES_S[2:]}
    assert forth == back and other.items() <= forth.items()
    assert workshop.picture(workshop.disturbances(entry(kind), seed=2), 0.7).tobytes() != forth[0.7]


def test_a_typical_arc_leaves_10_to_60_levels_about_the_stripe(workshop, pieces):
    disturbances = workshop.disturbances(entry("arc"))
    row = int(np.median(pieces.v_px))
    about = [workshop.picture(disturbances, t)[row].mean() - 9 for t in np.arange(60) * 0.0173]
    assert np.percentile(about, 10) > 3 and np.percentile(about, 90) < 70  # between the pulses and in them
    assert 10 < np.mean(about) < 60


def test_the_arcs_light_grows_towards_it_and_with_its_strength(workshop):
    once, twice = (workshop.picture(workshop.disturbances(entry("arc", s)), 0.7) - 9 for s in (1.0, 2.0))
    np.testing.assert_allclose(twice, 2 * once, rtol=1e-3, atol=1e-3)  # light adds; float32
    assert np.all(np.diff(once[200::100, 720]) < 0)  # the tip is at row 70


def test_fume_of_twice_the_strength_squares_what_is_left(workshop, pieces):
    once, twice = (
        workshop.frame(workshop.disturbances(entry("fume", s)), 0.7).dim_laser(pieces).amplitude_grey
        / pieces.amplitude_grey
        for s in (1.0, 2.0)
    )
    np.testing.assert_allclose(twice, once**2, rtol=0.01)  # linear between cells
    assert 0.3 < once.min() < once.max() < 0.95


def test_fume_dims_the_picture_but_an_arc_in_it_veils(workshop):
    dim = workshop.picture(workshop.disturbances(entry("fume", 2.0)), 0.7)
    assert 0.3 * 9 < dim.mean() < 0.95 * 9
    arc = workshop.picture(workshop.disturbances(entry("arc", 1.0)), 0.7)
    veiled = workshop.picture(workshop.disturbances(entry("arc", 1.0), entry("fume", 1.0)), 0.7)
    left = workshop.picture(workshop.disturbances(entry("fume", 1.0)), 0.7) / 9
    veil = veiled[400:] - left[400:] * arc[400:]
    assert veil.min() > -0.1 and veil.mean() > 0.2  # levels; glare is not dimmed, so there is a little more


def test_spatter_dies_with_its_end_and_is_not_there_before_its_start(workshop):
    late, early = (workshop.disturbances(entry("spatter", 3.0, start_s, 9.0)) for start_s in (1.0, 0.0))
    at_start, running = (workshop.picture(d, 1.0003) for d in (late, early))
    assert (at_start - 9).sum() < 0.2 * (running - 9).sum()


def test_a_lost_stripe_is_dark_and_half_lost_half_as_bright(workshop, pieces):
    lost, half = (workshop.frame(workshop.disturbances(entry("stripe-lost", s)), 1.0) for s in (1.0, 0.5))
    assert not draw_stripe(lost.dim_laser(pieces), 1440, 1080).grey.any()
    np.testing.assert_allclose(half.dim_laser(pieces).amplitude_grey, pieces.amplitude_grey / 2)


@pytest.mark.parametrize("strength", [0.5, 1.0, 3.0])
def test_a_knock_moves_the_head_by_its_strength_until_its_end(workshop, overhead, strength):
    disturbances = workshop.disturbances(entry("sensor-knocked", strength, 1.0, 4.0))
    frames = [workshop.frame(disturbances, t) for t in (1.0, 3.999)]
    angle_rad, distance_m = difference(frames[0].T_base_camera, overhead())
    assert (np.degrees(angle_rad), distance_m) == pytest.approx((0.5 * strength, 1e-3 * strength), rel=1e-6)
    assert difference(frames[0].T_base_camera, frames[1].T_base_camera) == (0.0, 0.0)


def test_a_knock_is_fixed_to_the_head(workshop, overhead):
    disturbances = workshop.disturbances(entry("sensor-knocked"))
    shifts: list[RigidTransform] = [
        T.inv() * disturbances.frame(1.0, None, T, T_BASE_TORCH).T_base_camera
        for T in (overhead(), overhead((0.1, 0.2, 0.0), 0.7))
    ]
    assert difference(*shifts) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(("strength", "ratio"), [(1.0, 8.0), (0.125, 1.0), (0.02, 0.16), (0.0, 1e-6)])
def test_a_stuck_exposure_is_eight_times_its_strength(workshop, strength, ratio):
    frame = workshop.frame(workshop.disturbances(entry("stuck-exposure", strength)), 1.0)
    assert frame.exposure_ratio == pytest.approx(ratio)


def test_disturbances_of_strength_zero_change_nothing(workshop):
    for kind in ("arc", "spatter", "fume"):
        frame = workshop.frame(workshop.disturbances(entry(kind, 0.0)), 1.0)
        assert frame.disturb_ambient(workshop.ambient) is workshop.ambient

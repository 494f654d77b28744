"""The arc's light follows the laws of point sources; its flicker has the spectrum that it claims."""

import numpy as np
import pytest
from scipy.integrate import quad

from weldcell.cell.frames import translation
from weldcell.sensor_sim.materials import geom_materials
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.weld.arc import (
    INDIRECT_RATIO,
    SCATTERED_RATIO,
    ArcFlicker,
    ArcLight,
    arc_core,
    arc_light,
    arc_seen,
    free_ways_m,
    glare_per_sr,
    glare_radiance,
    irradiance,
    lit_radiance,
    unit,
)
from weldcell.sensor_sim.weld.coarse_view import CoarseView

PLANE = '<geom type="plane" size="0 0 1" rgba="1 1 1 1"/>'
WALL = '<geom type="box" size=".001 .01 .05" pos=".01 0 .05"/>'


def arc_at(position, wire=(0.0, 0.0, -1.0), intensity=1.0) -> ArcLight:
    return ArcLight(position_base=np.array(position), wire_base=np.array(wire), intensity=intensity)


def looked(model, data, view, T_base_camera, arc):
    """What the camera sees, and how far the ways from the arc to it are free."""
    caster = RayCaster(model)
    seen = view.look(caster, data, T_base_camera)
    return seen, free_ways_m(arc, unit(seen.points_base - arc.position_base), caster, data, np.ones(model.ngeom, bool))


@pytest.fixture(scope="module")
def view(camera):
    return CoarseView(camera)


@pytest.mark.parametrize("height_m", [0.003, 0.02, 0.1])
def test_a_plane_gets_light_by_inverse_square_and_cosine(scene, overhead, view, height_m):
    model, data = scene(PLANE)
    seen, free_m = looked(model, data, view, overhead(), arc_at([-0.06, 0.01, height_m]))
    received = irradiance(arc_at([-0.06, 0.01, height_m], intensity=2.0), seen, free_m)
    r_m = np.linalg.norm(seen.points_base - [-0.06, 0.01, height_m], axis=1)
    np.testing.assert_allclose(received, 2.0 * height_m / r_m**3, rtol=1e-6)  # rays are exact to a nanometre


def test_a_wall_shades_what_lies_behind_it_and_nothing_else(scene, overhead, view):
    model, data = scene(PLANE + WALL)
    arc = arc_at([-0.06, 0.0, 0.02])
    seen, free_m = looked(model, data, view, overhead(), arc)
    received = irradiance(arc, seen, free_m)
    x, y, _ = seen.points_base.T
    shadow_edge = np.abs(y) / (x + 0.06) * 0.07  # where the light to a place passes the wall; the wall's half is 10 mm
    on_plane = seen.normals_base[:, 2] > 0.9
    behind, beside = on_plane & (x > 0.013) & (shadow_edge < 0.009), on_plane & ((x < 0.0) | (shadow_edge > 0.011))
    assert behind.sum() > 20 and beside.sum() > 20
    assert not received[behind].any() and np.all(received[beside] > 0)


def test_a_perfect_diffuser_sends_on_what_it_gets_over_pi(scene, overhead, view):
    model, data = scene(PLANE)
    arc = arc_at([-0.06, 0.0, 0.02], intensity=3.0)
    seen, free_m = looked(model, data, view, overhead(), arc)
    around = INDIRECT_RATIO * 3.0 / np.sum((seen.points_base - arc.position_base) ** 2, axis=1)
    expected = (irradiance(arc, seen, free_m) + around) / np.pi
    np.testing.assert_allclose(lit_radiance(arc, seen, geom_materials(model), free_m), expected, rtol=1e-9)


def test_glare_sums_to_the_scattered_share():
    total, _ = quad(lambda t: 2 * np.pi * glare_per_sr(t) * np.cos(t) * np.sin(t), 0, np.pi / 2, points=[0.01, 0.1])
    assert total == pytest.approx(SCATTERED_RATIO, rel=0.1)  # Harvey's sin(t) taken as t: 8 % of the logarithm


def test_glare_falls_from_the_arc_and_with_the_square_of_its_distance(overhead, view):
    T_base_camera = overhead()
    centre, forward = T_base_camera.translation, T_base_camera.rotation.as_matrix()[:, 2]
    near, far = (glare_radiance(arc_at(centre + reach * forward), view, T_base_camera) for reach in (0.2, 0.4))
    np.testing.assert_allclose(near, 4 * far, rtol=1e-9)
    off_px = np.linalg.norm(view.pixels - [719.5, 539.5], axis=1)
    assert np.all(np.diff(near[np.argsort(off_px)]) < 1e-3 * near.max())


@pytest.mark.parametrize("wire", [(0.0, 0.0, -1.0), (0.6, 0.0, -0.8)])
def test_the_arcs_picture_holds_its_whole_intensity(overhead, camera, wire):
    T_base_camera = overhead()
    core = arc_core(arc_at([0.0, 0.0, 0.0], wire, intensity=1.5), camera, T_base_camera)
    px_per_m = camera.focal_px[0] / 0.275
    # intensity is radiance times area: exact for Gaussians sampled finer than their sigma, 1e-4 beyond 5.5 sigma
    assert core.values.sum() / px_per_m**2 == pytest.approx(1.5, rel=1e-3)
    rows, columns = np.unravel_index(np.argmax(core.values), core.values.shape)
    assert abs(rows + core.rows.start - 539.5) <= 1 and abs(columns + core.columns.start - 719.5) <= 1


def test_an_arc_out_of_view_has_no_picture(overhead, camera):
    assert arc_core(arc_at([-0.5, 0.0, 0.0]), camera, overhead()) is None


def test_the_arc_is_hidden_by_what_stands_before_it(scene, overhead):
    model, data = scene(PLANE + WALL)
    centre = overhead().translation
    for x, seen in ((-0.01, False), (0.05, True)):
        arc = arc_at([x, 0.0, 0.003])
        way, everything = unit((centre - arc.position_base)[None]), np.ones(model.ngeom, bool)
        free_m = free_ways_m(arc, way, RayCaster(model), data, everything)
        assert arc_seen(arc, centre, free_m[0]) == seen


def test_the_arc_burns_above_the_tip_on_the_wire():
    np.testing.assert_allclose(arc_light(translation([0.1, 0.2, 0.3]), 1.0).position_base, [0.1, 0.2, 0.297])


@pytest.fixture(scope="module", params=[1, 2, 3])
def flicker(request):
    """40 s of the arc's light, 1600 values a second."""
    return ArcFlicker(request.param).at(np.arange(0, 40, 1 / 1600))


def test_flicker_has_a_mean_of_one(flicker):
    assert flicker.mean() == pytest.approx(1, abs=0.05)  # shorts take 2 %, their flashes and the ramps give 2 %


def test_flicker_is_strongest_at_the_pulses(flicker):
    power = np.abs(np.fft.rfft(flicker - flicker.mean())) ** 2
    frequency_hz = np.fft.rfftfreq(len(flicker), 1 / 1600)
    assert frequency_hz[np.argmax(power)] == pytest.approx(120, abs=8)  # jitter moves and widens the line


def test_slow_flicker_is_one_over_f(flicker):
    power = np.abs(np.fft.rfft(flicker - flicker.mean())) ** 2
    frequency_hz = np.fft.rfftfreq(len(flicker), 1 / 1600)
    low, high = (power[(frequency_hz >= f) & (frequency_hz < 4 * f)].sum() for f in (0.8, 12.8))
    assert 0.4 < low / high < 1.6  # equal power in equal ratios; shorts (white) add to the higher band


def test_short_circuits_put_the_arc_out_for_their_share_of_time():
    times_s = np.arange(0, 40, 5e-4)
    out = np.mean([np.mean(ArcFlicker(seed).at(times_s) < 0.04) for seed in range(3)])
    # 6/s of 2.75 ms on average; the pulses' tops shine through the 5 % that is left of them: 70 % are bases
    assert out == pytest.approx(6 * 2.75e-3 * 0.7, rel=0.2)  # 720 shorts: 4 % of counting noise, ramps, 1/f noise


def test_flicker_depends_on_the_time_alone():
    together = ArcFlicker(5).at(np.array([0.1, 3.3, 7.7]))
    alone = np.array([ArcFlicker(5).at(np.array([time_s]))[0] for time_s in (7.7, 0.1, 3.3)])
    np.testing.assert_array_equal(alone, together[[2, 0, 1]])


def test_long_exposures_flicker_less():
    starts_s = np.arange(100) * 0.173
    short, long = (np.std([ArcFlicker(1).mean(s, s + length) for s in starts_s]) for length in (1e-3, 50e-3))
    assert short > 0.7 and long < 0.35  # pulses average out, the slow noise of 20 % stays

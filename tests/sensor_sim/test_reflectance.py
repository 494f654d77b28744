"""The reflectance model against its laws (Lambert's limit, reciprocity, energy) and against facets thrown by chance."""

import numpy as np
import pytest

from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.materials import MATERIALS, geom_materials, surfaces
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import brightness, fresnel, irradiance, light_reference, radiance_factor

UP = np.array([0.0, 0.0, 1.0])
METALS = [name for name, material in MATERIALS.items() if material.mirror_share > 0]


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def hemisphere(rng, count):
    """Random unit vectors above the surface, even over the hemisphere."""
    directions = unit(rng.normal(size=(count, 3)))
    return directions * np.sign(directions[:, 2:])


def factor(material, to_light, to_eye):
    count = max(np.atleast_2d(to_light).shape[0], np.atleast_2d(to_eye).shape[0])
    light, eye, normals = (np.broadcast_to(v, (count, 3)) for v in (to_light, to_eye, UP))
    return radiance_factor(surfaces([material] * count), light, eye, normals)


def inclined(angle_rad):
    return np.array([np.sin(angle_rad), 0.0, np.cos(angle_rad)])


def reflected_share(material, incidence_rad):
    """Directional-hemispherical reflectance: the mean over an even grid in half vectors about the normal.

    Half vectors h rather than directions, so that the narrowest lobe is resolved: d(omega_o) = 4 (i.h) d(omega_h), and
    h is spread as cos(h)^2 dtan^2 in rings of equal share under Beckmann's own distribution.
    """
    light, alpha = inclined(incidence_rad), material.slope_roughness
    share, turn_rad = np.meshgrid((np.arange(400) + 0.5) / 400, (np.arange(100) + 0.5) / 100 * np.pi)
    tan2 = -(alpha**2) * np.log(share.ravel())
    cos = 1 / np.sqrt(1 + tan2)
    sin = np.sqrt(1 - cos**2)
    half = np.column_stack([sin * np.cos(turn_rad.ravel()), sin * np.sin(turn_rad.ravel()), cos])
    half_light = half @ light
    eye = 2 * half_light[:, None] * half - light
    above = (eye[:, 2] > 0) & (half_light > 0)
    solid_angle = np.pi * alpha**2 * cos**3 * np.exp(tan2 / alpha**2) * 4 * np.abs(half_light)  # for an equal share
    lobe = (factor(material, light, eye) - material.diffuse_albedo) / np.pi
    return material.diffuse_albedo + float(np.mean(np.where(above, lobe * eye[:, 2] * solid_angle, 0.0)))


def test_matt_white_is_as_bright_from_everywhere():
    rng = np.random.default_rng(1)
    np.testing.assert_array_equal(factor(MATERIALS["matt-white"], hemisphere(rng, 100), hemisphere(rng, 100)), 1.0)


def test_matt_white_is_lamberts_stripe(scene, overhead, camera, fan):
    """On a tilted plate: cosine of incidence, thinned out with the range, thicker and fainter away from the waist."""
    model, data = scene('<geom type="box" size=".2 .2 .001" euler="12 -9 0" material="p/matt-white"/>',
                        '<material name="p/matt-white"/>')  # fmt: skip
    section = light_section(RayCaster(model), data, overhead(), camera, fan)
    reference = light_reference(fan)
    bright = brightness(section, fan.power_ratio, geom_materials(model).at(section.geom_id), reference)
    lit = section.lit
    assert reference.range_m == pytest.approx(0.275 / np.sqrt(2), abs=1e-12)
    thickness = section.sheet_sigma_m[lit] / fan.sheet.sigma_m(np.array([reference.range_m]))
    expected = section.incidence_cos[lit] * reference.range_m / section.range_m[lit] / thickness
    np.testing.assert_allclose(bright[lit], expected, rtol=1e-12)
    np.testing.assert_allclose(irradiance(section, fan.power_ratio, reference)[lit], expected, rtol=1e-12)
    assert np.isnan(bright[~lit]).all() and lit.sum() > 1000


def test_the_reference_itself_has_brightness_one(scene, overhead, camera, fan):
    """A matt white plate square to the light, its middle at the crossing; 1e-6: no ray is exactly the middle one."""
    model, data = scene('<geom type="box" size=".2 .2 .001" pos="0 0 -.001"/>')
    section = light_section(RayCaster(model), data, overhead(), camera, fan)
    white = surfaces([MATERIALS["matt-white"]] * len(section.lit))
    bright = brightness(section, fan.power_ratio, white, light_reference(fan))
    assert bright[len(bright) // 2] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("name", MATERIALS)
def test_light_and_eye_can_change_places(name):
    """Helmholtz's reciprocity; 1e-9 of the value: the narrowest lobe amplifies rounding by 1/alpha^2."""
    rng = np.random.default_rng(2)
    light = hemisphere(rng, 5000)
    eye = unit(light * [-1, -1, 1] + 0.3 * rng.normal(size=light.shape) * MATERIALS[name].slope_roughness)
    eye[:, 2] = np.abs(eye[:, 2])
    there, back = factor(MATERIALS[name], light, eye), factor(MATERIALS[name], eye, light)
    np.testing.assert_allclose(there, back, rtol=1e-9)


@pytest.mark.parametrize("name", MATERIALS)
def test_no_surface_sends_back_more_than_it_gets(name):
    """At every incidence, and at most its albedo plus the mirror's share; 0.002 is the grid's error."""
    material = MATERIALS[name]
    for angle_deg in (0, 20, 40, 60, 75, 85, 89):
        share = reflected_share(material, np.deg2rad(angle_deg))
        assert material.diffuse_albedo <= share <= material.diffuse_albedo + material.mirror_share + 0.002 <= 1.002


@pytest.mark.parametrize("name", ["ground-steel", "mill-scale"])
def test_the_shares_agree_with_a_plain_integral_over_the_hemisphere(name):
    """An independent grid in cosine and azimuth of the eye, for lobes that such a grid resolves (0.5 %)."""
    material, light = MATERIALS[name], inclined(np.deg2rad(50))
    cos, turn_rad = np.meshgrid((np.arange(600) + 0.5) / 600, (np.arange(600) + 0.5) / 300 * np.pi)
    sin = np.sqrt(1 - cos**2)
    eye = np.stack([sin * np.cos(turn_rad), sin * np.sin(turn_rad), cos], axis=-1).reshape(-1, 3)
    total = 2 * np.mean(factor(material, light, eye) * eye[:, 2])  # (1/pi) times 2 pi times the mean
    assert total == pytest.approx(reflected_share(material, np.deg2rad(50)), rel=5e-3)


@pytest.mark.parametrize("angle_deg", [0, 30, 60])
def test_a_narrow_lobe_reflects_what_a_mirror_does(angle_deg):
    """Polished steel: share times Fresnel's reflectance at that incidence, 0.2 % for a lobe of 0.3 deg."""
    polished = MATERIALS["polished"]
    mirror = fresnel(np.array([polished.mirror_reflectance]), np.array([np.cos(np.deg2rad(angle_deg))]))[0]
    lobe = reflected_share(polished, np.deg2rad(angle_deg)) - polished.diffuse_albedo
    assert lobe == pytest.approx(polished.mirror_share * mirror, rel=2e-3)


def test_a_bare_mirror_at_grazing_light_reflects_all():
    assert fresnel(np.array([0.57]), np.array([0.0]))[0] == 1.0


@pytest.mark.parametrize("name", METALS)
def test_the_lobe_is_that_of_facets_with_gaussian_slopes(name):
    """Light from straight above: facets of random slope send it where the model says, ring by ring.

    40 000 facets leave 1.6 % of noise in a ring of a tenth of them; at these slopes shadowing and Fresnel's rise stay
    below 4 %, which bounds the rest.
    """
    material, rng = MATERIALS[name], np.random.default_rng(3)
    slopes = material.slope_roughness / np.sqrt(2) * rng.normal(size=(40_000, 2))
    facets = unit(np.column_stack([-slopes, np.ones(len(slopes))]))
    polar_rad = np.arccos((2 * facets[:, 2:] * facets - UP)[:, 2])
    rings_rad = np.quantile(polar_rad, np.linspace(0, 0.6, 7))
    for low, high in zip(rings_rad[:-1], rings_rad[1:], strict=True):
        angles = low + (np.arange(200) + 0.5) / 200 * (high - low)
        eye = np.column_stack([np.sin(angles), np.zeros(200), np.cos(angles)])
        lobe = (factor(material, UP, eye) - material.diffuse_albedo) / np.pi
        power = np.mean(lobe * np.cos(angles) * 2 * np.pi * np.sin(angles)) * (high - low)
        assert power / (material.mirror_share * material.mirror_reflectance) == pytest.approx(0.1, rel=0.06)


@pytest.mark.parametrize("name", [name for name in METALS if name != "mill-scale"])
def test_metals_are_brightest_near_the_mirror_direction(name):
    """The peak lies at the mirror direction, or beyond it for rough surfaces (mill scale shines at grazing angles)."""
    light, eyes_rad = inclined(np.deg2rad(-30)), np.deg2rad(np.arange(-85.0, 85.5, 0.5))
    eyes = np.column_stack([np.sin(eyes_rad), np.zeros(len(eyes_rad)), np.cos(eyes_rad)])
    peak_deg = np.rad2deg(eyes_rad[np.argmax(factor(MATERIALS[name], light, eyes))])
    assert 30 - 1e-9 <= peak_deg <= 30 + 60 * MATERIALS[name].slope_roughness


def test_an_eye_below_the_surface_gets_no_mirrored_light():
    polished = MATERIALS["polished"]
    assert factor(polished, UP, np.array([0.0, 0.6, -0.8]))[0] == polished.diffuse_albedo
    assert factor(polished, np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]))[0] == polished.diffuse_albedo

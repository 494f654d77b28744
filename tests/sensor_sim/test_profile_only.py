"""Profiles without pictures against what the extractor finds in pictures of the same pose, frame after frame."""

from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
import pytest

from sensor_sim.rigs import rig
from weldcell.cell.configuration import SENSOR_PRESETS
from weldcell.cell.frames import translation
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.line_sensor import LineSensor
from weldcell.tracking.stripe import find_stripe

FRAMES = 60
CASES = [("p2", "plane"), ("p2", "groove"), ("p1", "plane"), ("p1", "groove")]


@dataclass(frozen=True, kw_only=True)
class Mode:
    """What a mode found in each frame (row) and cut (column); NaN where nothing."""

    centre_px: np.ndarray
    sigma_px: np.ndarray

    @property
    def found(self):
        """Share of the frames in which each cut has a centre."""
        return np.isfinite(self.centre_px).mean(axis=0)

    @property
    def error_px(self):
        """From each cut's own mean."""
        return self.centre_px - np.nanmean(self.centre_px, axis=0)


@cache
def modes(preset, scene, material="matt-white") -> tuple[Mode, Mode]:
    """Picture mode and profile-only mode: as many frames of one pose."""
    own = rig(SENSOR_PRESETS[preset])
    spec = mujoco.MjSpec()
    if scene == "plane":
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.2, 0.2, 0.005], pos=[0, 0, -0.005], rgba=[1, 1, 1, 1]
        )
    else:
        plate = v_groove_plate(0.2, 0.16, 0.03, np.deg2rad(60), 0.0, 0.004, 0.0)
        plate.with_surface(material).add_to(spec, translation([0, 0, -0.03]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    along, T = own.config.stripe_along, own.T_base_camera()
    with LineSensor(own.config, own.camera, own.fan.plane, own.fan.source_camera, model, seed=3) as sensor:
        light = sensor.light(data, T)
        pictures = [
            find_stripe(sensor.picture(light, np.random.default_rng([0, k])), along=along) for k in range(FRAMES)
        ]
        profiles = [sensor.profile(data, T, np.random.default_rng([1, k])) for k in range(FRAMES)]
    size = own.camera.width_px if along == "rows" else own.camera.height_px
    return as_mode(pictures, along, size), as_mode(profiles, along, size)


def as_mode(stripes, along, size) -> Mode:
    centre_px, sigma_px = np.full((2, FRAMES, size), np.nan)
    for k, stripe in enumerate(stripes):
        cuts, centres = (stripe.u_px, stripe.v_px) if along == "rows" else (stripe.v_px, stripe.u_px)
        centre_px[k, cuts.astype(int)], sigma_px[k, cuts.astype(int)] = centres, stripe.sigma_px
    return Mode(centre_px=centre_px, sigma_px=sigma_px)


def windows(mode: Mode, picture: Mode, count=8):
    """Cuts that both nearly always find, in stretches along the stripe."""
    return np.array_split(np.flatnonzero((mode.found > 0.9) & (picture.found > 0.9)), count)


@pytest.mark.parametrize(("preset", "scene"), CASES)
def test_profiles_have_the_columns_that_pictures_have(preset, scene):
    picture, profile = modes(preset, scene)
    assert profile.found.sum() == pytest.approx(picture.found.sum(), rel=0.01)
    assert np.count_nonzero(np.abs(profile.found - picture.found) > 0.5) <= 0.01 * len(picture.found)


@pytest.mark.parametrize(("preset", "scene"), CASES)
def test_profiles_have_no_other_mean_than_pictures(preset, scene):
    """0.01 px: 60 frames of 700 grains that scatter by 0.25 px leave 0.002."""
    picture, profile = modes(preset, scene)
    off_px = np.concatenate([
        (np.nanmean(picture.centre_px, axis=0) - np.nanmean(profile.centre_px, axis=0))[cuts]
        for cuts in windows(profile, picture)
    ])  # fmt: skip
    assert abs(off_px.mean()) < 0.01
    assert abs(np.median(off_px)) < 0.01


@pytest.mark.parametrize(("preset", "scene"), CASES)
def test_profiles_scatter_as_pictures_do_and_as_they_say(preset, scene):
    """10 % of pictures' in each stretch; of their own prediction 4 %, as 60 frames of some 70 grains vary by 1.1 %."""
    picture, profile = modes(preset, scene)
    for cuts in windows(profile, picture):
        of_picture, of_profile = (np.sqrt(np.nanmean(mode.error_px[:, cuts] ** 2)) for mode in (picture, profile))
        assert of_profile == pytest.approx(of_picture, rel=0.1)
        predicted = np.sqrt(np.nanmean(profile.sigma_px[:, cuts] ** 2) * (1 - 1 / FRAMES))
        assert of_profile == pytest.approx(predicted, rel=0.04)


@pytest.mark.parametrize(("preset", "scene"), CASES)
def test_neighbouring_centres_are_correlated_as_in_pictures(preset, scene):
    for lag in (1, 2, 5):
        of_picture, of_profile = (correlation(mode.error_px, lag) for mode in modes(preset, scene))
        assert of_profile == pytest.approx(of_picture, abs=0.1)


def test_on_steep_walls_neighbours_see_other_grains():
    """A groove's walls slant, so neighbours agree less than on the plate beside it, in both modes."""
    picture, profile = modes("p1", "groove")
    middle = np.nanmean(profile.centre_px, axis=0)
    slant = np.abs(np.gradient(middle)) > 0.5  # px per px
    assert 200 < slant.sum() < 800
    for mode in (picture, profile):
        steep, flat = (correlation(mode.error_px, 1, np.flatnonzero(part)) for part in (slant, ~slant))
        assert 0 < steep < flat - 0.05


def test_what_is_hard_to_see_is_lost_as_often_as_in_pictures():
    """Ground steel, whose plate sends little light towards the camera and whose speckle is strong: 8 % of columns."""
    picture, profile = modes("p2", "groove", "ground-steel")
    assert picture.found.sum() < 0.95 * len(picture.found)
    assert profile.found.sum() == pytest.approx(picture.found.sum(), rel=0.1)


def correlation(error_px, lag, cuts=None):
    """Of centres this many cuts apart; `cuts` are those of the first."""
    cuts = np.arange(error_px.shape[1] - lag) if cuts is None else cuts[cuts < error_px.shape[1] - lag]
    product = error_px[:, cuts] * error_px[:, cuts + lag]
    return np.nanmean(product) / np.nanmean(error_px[:, cuts] ** 2)


def test_the_same_numbers_give_the_same_profile_and_others_another():
    own = rig(SENSOR_PRESETS["p2"])
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom type="plane" size="1 1 1" rgba="1 1 1 1"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with LineSensor(own.config, own.camera, own.fan.plane, own.fan.source_camera, model) as sensor:
        first, again, other = (sensor.profile(data, own.T_base_camera(), np.random.default_rng(k)) for k in (1, 1, 2))
    np.testing.assert_array_equal(first.v_px, again.v_px)
    assert not np.array_equal(first.v_px, other.v_px)

"""Every material is known, keeps the books of its light, and is found again in compiled models."""

from dataclasses import replace
from typing import get_args

import mujoco
import numpy as np
import pytest

from weldcell.cell.configuration import MaterialName
from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import translation
from weldcell.models.boss import boss
from weldcell.models.finishes import FINISHES
from weldcell.models.sphere import sphere_stand
from weldcell.sensor_sim.materials import MATERIALS, geom_materials, paint, surfaces


def test_every_name_has_a_material_and_a_look():
    assert set(MATERIALS) == set(FINISHES) == set(get_args(MaterialName))


def test_a_material_that_makes_light_is_refused():
    with pytest.raises(BadGeometry, match="of 1 at most"):
        replace(MATERIALS["polished"], diffuse_albedo=0.2)
    with pytest.raises(BadGeometry, match="diffuse_albedo of 0 to 1"):
        paint(1.2)
    with pytest.raises(BadGeometry, match="slope_roughness"):
        replace(MATERIALS["polished"], slope_roughness=0.0)


def test_roughness_follows_from_height_and_correlation_length():
    """alpha = 2 s / T with T of 5 to 15 um, the reasoned range, for each metal."""
    for name, metal in MATERIALS.items():
        if metal.mirror_share > 0:
            assert 4.99e-6 < 2 * metal.height_sigma_m / metal.slope_roughness < 15.01e-6, name


def test_parts_are_made_of_what_they_were_given():
    """A workpiece, an attached stand (its names get a prefix), a painted geom without and with a MuJoCo material."""
    spec = mujoco.MjSpec()
    boss(0.05, 0.9, 0.04).with_surface("stainless").add_to(spec, translation([0, 0, 0]))
    spec.attach(sphere_stand(0.02), prefix="stand/", frame=spec.worldbody.add_frame())
    spec.worldbody.add_geom(name="grey", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], rgba=[0.2, 0.3, 0.4, 1])
    spec.add_material(name="orange", rgba=[0.9, 0.5, 0.1, 1])
    spec.worldbody.add_geom(name="box", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1] * 3, material="orange")
    model = spec.compile()
    found = geom_materials(model)

    def at(name):
        return found.at(np.array([model.geom(name).id]))

    for name, material in (
        ("boss", MATERIALS["stainless"]),
        ("stand/standard_sphere", MATERIALS["matt-white"]),
        ("grey", paint(0.3)),  # the mean of its colour
        ("box", paint(0.5)),
    ):
        for field, values in vars(at(name)).items():
            assert values[0] == pytest.approx(getattr(material, field), abs=1e-7), (name, field)  # float32 colours


def test_a_textured_paint_counts_with_its_mean():
    spec = mujoco.MjSpec()
    spec.add_texture(
        name="t", type=mujoco.mjtTexture.mjTEXTURE_2D, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=[0.5, 0.5, 0.5], width=8, height=8,
    )  # fmt: skip
    spec.add_material(name="m").textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "t"
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], material="m")
    albedo = geom_materials(spec.compile()).diffuse_albedo[0]
    assert albedo == pytest.approx(0.5, abs=0.5 / 255)  # a texture has 8 bits


def test_some_of_many_surfaces_are_taken_by_index_and_by_mask():
    many = surfaces([paint(0.1), MATERIALS["polished"], paint(0.3)])
    np.testing.assert_array_equal(many.at(np.array([2, 0])).diffuse_albedo, [0.3, 0.1])
    assert many.at(many.mirror_share > 0).slope_roughness.tolist() == [MATERIALS["polished"].slope_roughness]

"""The arc's light pixel by pixel: as if every pixel had its own ray, and with the surface's own texture."""

import mujoco
import numpy as np
import pytest

from weldcell.cell.frames import translation
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.materials import geom_materials
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.texture import SceneTextures
from weldcell.sensor_sim.weld.arc import ArcLight, free_ways_m, lit_radiance, unit
from weldcell.sensor_sim.weld.coarse_view import seen_along
from weldcell.sensor_sim.weld.fine_view import fine_view
from weldcell.sensor_sim.weld.lit_surfaces import LitSurfaces

DOWN = np.array([0.0, 0.0, -1.0])
ARC = ArcLight(position_base=np.array([-0.06, 0.002, 0.032]), wire_base=DOWN, intensity=0.8)


@pytest.fixture(scope="module")
def groove(camera, overhead):
    """A scratched plate with a curved V-groove, the camera above it, its lit surfaces, and single pixels by rays."""
    spec = mujoco.MjSpec()
    plate = v_groove_plate(0.3, 0.16, 0.03, np.pi / 4, 0.0, 0.004, 0.02).with_surface("ground-steel", "scratched", 3)
    plate.add_to(spec, translation(np.zeros(3)))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], pos=[-0.02, -0.03, 0.045])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    caster, T_base_camera = RayCaster(model), overhead((0.0, 0.0, 0.02))
    opaque = np.ones(model.ngeom, bool)
    surfaces = LitSurfaces(camera, model, caster, opaque)

    def by_rays(pixels):
        rays = camera.unproject(pixels)
        rays = (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ T_base_camera.rotation.as_matrix().T
        seen = seen_along(rays, caster, data, T_base_camera)
        to_points = seen.points_base - ARC.position_base
        facing = np.einsum("ni,ni->n", seen.normals_base, to_points) < 0
        free_m = np.where(facing, free_ways_m(ARC, unit(to_points), caster, data, opaque), 0.0)
        texture = SceneTextures(model).factor(data, seen.points_base, seen.normals_base, seen.geom_id)
        return lit_radiance(ARC, seen, geom_materials(model), free_m) * texture

    return surfaces.radiance(ARC, data, T_base_camera), by_rays


def test_every_pixel_has_the_light_of_its_own_ray(groove):
    """Of 20 000 pixels, all but some in a thousand (shadows smaller than a cell) agree: textures are looked up up to a
    thirty-second of their pixels away (cv2.remap), fields are straight over 8 px.
    """
    picture, by_rays = groove
    pixels = np.random.default_rng(2).integers([0, 0], [1440, 1080], (20_000, 2))
    expected = by_rays(pixels.astype(float))
    error = np.abs(picture[pixels[:, 1], pixels[:, 0]] / expected - 1)
    assert np.percentile(error, 50) < 2e-3 and np.percentile(error, 99) < 0.02
    assert (error > 0.05).mean() < 3e-3


def test_rays_drawn_out_between_knots_are_the_lenss(camera):
    view = fine_view(camera)
    rows, columns = np.random.default_rng(0).integers([0, 0], [1080, 1440], (1000, 2)).T
    rays = view.rays(rows, columns)
    pixels = camera.project(rays)
    np.testing.assert_allclose(pixels, np.column_stack([columns, rows]), atol=2e-3)  # px


def test_linear_fields_come_back_between_the_knots(camera):
    view = fine_view(camera)
    knots = camera.project(view.rays_camera)
    rows, columns = np.indices((1080, 1440))
    np.testing.assert_allclose(view.whole(knots @ [0.02, -0.01]), 0.02 * columns - 0.01 * rows, atol=1e-4)


def test_where_there_is_nothing_there_is_no_light(camera, overhead):
    behind = '<geom type="sphere" size=".1" pos="0 0 5"/>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{behind}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    caster = RayCaster(model)
    assert (LitSurfaces(camera, model, caster, np.ones(1, bool)).radiance(ARC, data, overhead()) == 0).all()

"""Smooth normals of meshes against the surfaces that they stand for."""

import mujoco
import numpy as np
import pytest
import trimesh

from weldcell.cell.frames import translation
from weldcell.models.boss import boss
from weldcell.models.v_groove import SPath, v_groove_plate
from weldcell.models.workpiece import Workpiece
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.smooth_normals import SmoothNormals

pytest.importorskip("embreex", reason="MuJoCo's rays tell no triangles")


def rays_on(part, origins, directions):
    """Smooth normals and hits of rays on a part that stands in the base frame."""
    spec = mujoco.MjSpec()
    part.add_to(spec, translation([0, 0, 0]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hits = RayCaster(model).cast(data, origins, directions)
    return SmoothNormals(model).at(data, hits), hits


def test_the_walls_of_an_s_shaped_groove_are_smooth():
    """Against offset curves' exact normals: 0.25 mrad, where facets are wrong by up to 2 mrad."""
    rng = np.random.default_rng(1)
    path = SPath(length_m=0.3, amplitude_m=0.02)
    x, to_left_m = rng.uniform(-0.1, 0.1, 3000), rng.uniform(0.0005, 0.018, 3000) * rng.choice([-1, 1], 3000)
    along = np.array([path.offset(np.array([x]), m)[0] for x, m in zip(x, to_left_m, strict=True)])
    plate = v_groove_plate(0.3, 0.16, 0.06, np.pi / 4, 0.0, 0.004, 0.02)
    down = np.tile([0, 0, -1.0], (3000, 1))
    smooth, hits = rays_on(plate, np.column_stack([along, np.full(3000, 0.1)]), down)
    slope = path.slope(x)
    left = np.column_stack([-slope, np.ones(3000)]) / np.hypot(1, slope)[:, None]
    exact = np.column_stack([-np.sign(to_left_m)[:, None] * left * np.cos(np.pi / 8), np.full(3000, np.sin(np.pi / 8))])
    assert np.linalg.norm(hits.normals - exact, axis=1).max() > 1.5e-3
    assert np.linalg.norm(smooth - exact, axis=1).max() < 0.25e-3


def test_a_ball_of_facets_has_the_normals_of_a_ball():
    """Max's weights are exact at the corners; between them the error goes with the square of a facet's angle.

    An icosphere of 20 480 facets turns by 15 mrad from one to the next: facets err by 10 mrad, smooth normals by 0.3.
    """
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    part = Workpiece(name="ball", vertices_part=np.asarray(ball.vertices), faces=np.asarray(ball.faces))
    directions = np.random.default_rng(2).normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    smooth, hits = rays_on(part, np.array(0.2 * directions), -directions)
    assert np.linalg.norm(hits.normals - directions, axis=1).max() > 5e-3
    assert np.linalg.norm(smooth - directions, axis=1).max() < 0.3e-3


def test_edges_stay_sharp_and_faces_flat():
    """The boss: each smooth normal is its facet's, to the rounding of vertices in single precision."""
    rng = np.random.default_rng(3)
    origins = np.column_stack([rng.uniform(-0.05, 0.05, (2000, 2)), np.full(2000, 0.2)])
    smooth, hits = rays_on(boss(0.05, 0.93, 0.04), origins, np.tile([0, 0, -1.0], (2000, 1)))
    np.testing.assert_allclose(smooth, hits.normals, atol=1e-6)


def test_solids_keep_their_own_normals(scene):
    model, data = scene('<geom type="sphere" size=".1"/>')
    hits = RayCaster(model).cast(data, np.array([0.03, 0, 1.0]), np.array([[0, 0, -1.0]]))
    np.testing.assert_array_equal(SmoothNormals(model).at(data, hits), hits.normals)

"""Rays against closed forms and MuJoCo's own single ray; the traps that silently miss or end the process."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry, NotReady
from weldcell.sensor_sim.rays import RayCaster

TETRAHEDRON = '<mesh name="tetra" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .3"/>'
VISUAL = 'contype="0" conaffinity="0"'
DOWN = np.array([[0.0, 0.0, -1.0]])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def grid_mesh(cells: int) -> str:
    """A flat box top of many triangles, with vertices at multiples of 1/64 m (exact in binary)."""
    ticks = np.arange(cells + 1) - cells // 2
    top = [f"{x / 64} {y / 64} 0" for x in ticks for y in ticks]
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (index[i : cells + i, j : cells + j].ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1)))
    bottom = [f"{x * cells / 2 / 64} {y * cells / 2 / 64} -.1" for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    n = len(top)
    faces = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d]), [[n, n + 2, n + 1], [n, n + 3, n + 2]]])
    rim = np.concatenate([index[:, 0], index[-1, 1:], index[-2::-1, -1], index[0, -2:0:-1]])
    corner = n + np.repeat([0, 1, 2, 3], cells)
    sides = np.vstack(
        [
            np.column_stack([rim, corner, np.roll(rim, -1)]),
            np.column_stack([np.roll(rim, -1), corner, np.roll(corner, -1)])[corner != np.roll(corner, -1)],
        ]
    )
    text = " ".join(str(k) for k in np.vstack([faces, sides]).ravel())
    return f'<mesh name="grid" vertex="{"  ".join(top + bottom)}" face="{text}" inertia="shell"/>'


def single_rays(model, data, origin, directions):
    """MuJoCo's own loop over all geoms, ray by ray."""
    distance, geom = np.empty(len(directions)), np.empty(len(directions), int)
    geom_id = np.zeros(1, np.int32)
    for i, direction in enumerate(directions):
        distance[i] = mujoco.mj_ray(model, data, origin, direction, None, 1, -1, geom_id)
        geom[i] = geom_id[0]
    return distance, geom


def test_sphere_plane_and_box_are_hit_where_the_closed_form_says(scene):
    model, data = scene(
        '<geom type="plane" size="0 0 1"/><geom type="sphere" size=".1" pos="0 0 .5"/>'
        '<geom type="box" size=".1 .1 .1" pos="1 0 .1"/>'
    )
    rng = np.random.default_rng(1)
    origin = np.array([0.02, -0.03, 1.0])
    directions = unit(rng.normal(size=(2000, 3)) * [0.5, 0.5, 0.1] - [0, 0, 1])
    hits = RayCaster(model).cast(data, origin, directions)
    offset = origin - [0, 0, 0.5]
    along = directions @ offset
    root = along**2 - offset @ offset + 0.1**2
    with np.errstate(invalid="ignore"):
        sphere = np.where(root > 0, -along - np.sqrt(root), np.inf)
    plane = -origin[2] / directions[:, 2]
    on_sphere, on_plane = hits.geom_id == 1, hits.geom_id == 0
    np.testing.assert_array_equal(on_sphere, np.isfinite(sphere))
    # 1e-9 m: rounding and the jitter against leaks, enlarged at the sphere's limb
    np.testing.assert_allclose(hits.distance_m[on_sphere], sphere[on_sphere], atol=1e-9)
    np.testing.assert_allclose(hits.distance_m[on_plane], plane[on_plane], atol=1e-9)
    np.testing.assert_allclose(hits.points[hits.geom_id == 2][:, 2].max(), 0.2, atol=1e-9)  # the box's top
    np.testing.assert_allclose(hits.normals[on_sphere], (hits.points[on_sphere] - [0, 0, 0.5]) / 0.1, atol=1e-8)


def test_a_miss_is_a_mask_and_nan(scene):
    model, data = scene('<geom type="sphere" size=".1"/>')
    hits = RayCaster(model).cast(data, np.array([0, 0, 1.0]), np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert hits.hit.tolist() == [True, False]
    assert np.isnan(hits.distance_m[1]) and np.isnan(hits.points[1]).all() and hits.geom_id[1] == -1


@pytest.mark.parametrize("properties", [VISUAL, ""])
def test_visual_only_geoms_are_hit_like_any_other(scene, properties):
    """In a body of their own, beside a colliding geom, and in the world."""
    model, data = scene(
        f'<geom type="plane" size="0 0 1" pos="0 0 -1"/><geom type="box" size=".1 .1 .1" pos="-1 -1 -.5" {properties}/>'
        f'<body pos=".2 0 0" euler="20 30 40"><geom type="box" size=".05 .05 .05"/>'
        f'<geom type="sphere" size=".1" pos=".5 0 0" {properties}/>'
        f'<geom type="mesh" mesh="tetra" pos="-.5 .3 0" {properties}/></body>'
        f'<body pos="0 -.6 0"><geom type="mesh" mesh="tetra" {properties}/></body>',
        TETRAHEDRON,
    )
    rng = np.random.default_rng(2)
    for _ in range(20):
        origin = rng.uniform(-1.5, 1.5, 3)
        directions = unit(-origin + rng.normal(size=(300, 3)))
        hits = RayCaster(model).cast(data, origin, directions)
        distance, geom = single_rays(model, data, origin, directions)
        assert (geom == hits.geom_id).mean() > 0.999  # the jitter may tip a ray that grazes an edge
        both = (geom == hits.geom_id) & (geom >= 0)
        np.testing.assert_allclose(hits.distance_m[both], distance[both], atol=1e-8)  # m, jitter at grazing incidence


def test_rays_through_mesh_vertices_do_not_leak(scene):
    model, data = scene('<geom type="mesh" mesh="grid"/>', grid_mesh(20))
    caster = RayCaster(model)
    top = model.mesh_vert.reshape(-1, 3) @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    inner = top[(np.abs(top[:, 2] - top[:, 2].max()) < 1e-6) & (np.abs(top[:, :2]).max(axis=1) < 0.15)]
    assert len(inner) == 361
    above = [caster.cast(data, vertex + np.array([0, 0, 0.25]), DOWN) for vertex in inner]
    assert all(h.hit[0] and abs(h.distance_m[0] - 0.25) < 1e-6 for h in above)  # m, float32 vertices
    origin = np.array([0, 0, 0.25])
    fan = caster.cast(data, origin, unit(inner - origin))
    assert fan.hit.all() and np.abs(fan.points[:, 2]).max() < 1e-6


def test_the_sensors_own_head_is_not_hit(scene):
    model, data = scene(
        '<geom type="sphere" size=".1" group="3" pos="0 0 .5"/><geom type="sphere" size=".1" group="2"/>'
    )
    hits = RayCaster(model).cast(data, np.array([0, 0, 1.0]), DOWN)
    assert hits.distance_m[0] == pytest.approx(0.9, abs=1e-9)
    assert not RayCaster(model, groups=(0, 1)).cast(data, np.array([0, 0, 1.0]), DOWN).hit[0]


def test_metal_met_from_inside_has_its_normal_along_the_ray(scene):
    model, data = scene('<geom type="mesh" mesh="tetra"/>', TETRAHEDRON)
    inside = data.geom_xpos[0]
    assert RayCaster(model).cast(data, inside, DOWN).normals[0] @ DOWN[0] > 0


@pytest.mark.parametrize("direction", [[0, 0, 0], [0, 0, 2.0], [0, 0, np.nan], [0, np.inf, 0], [0, 0, 1e-20]], ids=str)
def test_hostile_directions_are_refused_before_mujoco_sees_them(direction):
    """In a process of its own: MuJoCo ends the process on a zero direction."""
    script = (
        "import mujoco, numpy as np\n"
        "from weldcell.cell.errors import BadGeometry\n"
        "from weldcell.sensor_sim.rays import RayCaster\n"
        "m = mujoco.MjModel.from_xml_string('<mujoco><worldbody><geom size=\".1\"/></worldbody></mujoco>')\n"
        "d = mujoco.MjData(m); mujoco.mj_kinematics(m, d)\n"
        "nan = np.nan; inf = np.inf\n"
        f"try: RayCaster(m).cast(d, np.array([0, 0, 1.0]), np.array([{direction!r}], dtype=float))\n"
        "except BadGeometry as error: print('refused', error)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0 and done.stdout.startswith("refused rays: expected"), done.stderr


def test_shapes_and_origins_that_are_no_rays_are_refused(scene):
    model, data = scene('<geom size=".1"/>')
    for origin, directions in (
        (np.array([0, 0, np.nan]), DOWN),
        (np.zeros(2), DOWN),
        (np.zeros(3), np.array([0, 0, 1.0])),
    ):
        with pytest.raises(BadGeometry, match="rays: expected"):
            RayCaster(model).cast(data, origin, directions)


def test_a_scene_without_kinematics_is_not_ready(scene):
    model, data = scene('<geom size=".1"/><body pos="0 0 1"><geom size=".1"/></body>')
    caster = RayCaster(model)
    with pytest.raises(NotReady, match="mj_kinematics"):
        caster.cast(mujoco.MjData(model), np.array([0, 0, 2.0]), DOWN)
    mujoco.mj_resetData(model, data)
    with pytest.raises(NotReady, match="mj_kinematics"):
        caster.cast(data, np.array([0, 0, 2.0]), DOWN)
    other = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(NotReady, match="another model"):
        caster.cast(mujoco.MjData(other), np.array([0, 0, 2.0]), DOWN)


def test_no_rays_and_no_geoms_are_no_hits(scene):
    model, data = scene('<geom size=".1"/>')
    assert len(RayCaster(model).cast(data, np.zeros(3), np.empty((0, 3))).hit) == 0
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    assert not RayCaster(empty).cast(mujoco.MjData(empty), np.zeros(3), DOWN).hit.any()


def test_opposite_rays_that_cancel_out_are_all_traced(scene):
    model, data = scene('<geom size=".1" pos="0 0 1"/><geom size=".1" pos="0 0 -1"/>')
    hits = RayCaster(model).cast(data, np.zeros(3), np.array([[0, 0, 1.0], [0, 0, -1.0]]))
    np.testing.assert_allclose(hits.distance_m, 0.9, atol=1e-9)

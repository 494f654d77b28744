"""Embree's rays against MuJoCo's, on the cell's own parts and on every kind of geom; traps that Embree could have."""

import mujoco
import numpy as np
import pytest
import trimesh

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import translation
from weldcell.models.boss import boss
from weldcell.models.mesh_body import PART_MASK, STEEL, add_mesh_geom
from weldcell.models.room import build_room
from weldcell.models.sphere import sphere_stand
from weldcell.models.v_groove import v_groove_plate
from weldcell.sensor_sim.rays import RayCaster

pytest.importorskip("embreex", reason="no wheel for this machine")

DISTANCE_TOLERANCE_M = 1e-8  # both are right to 1e-11 m head-on; MuJoCo's jitter grows at grazing incidence
NORMAL_TOLERANCE = 1e-6  # a hit moved by the jitter, enlarged at a sphere's limb


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.fixture(scope="module")
def parts():
    """The room's table with a V-groove plate, a boss and the sphere on it."""
    spec = build_room()
    v_groove_plate(
        length_m=0.3, width_m=0.16, thickness_m=0.06, groove_angle_rad=np.pi / 4, root_gap_m=0.0, root_face_m=0.003,
        amplitude_m=0.025,
    ).add_to(spec, translation([0.0, 0.0, 2.0]))  # fmt: skip
    boss(slant_edge_m=0.05, slope_rad=np.deg2rad(53.13), top_m=0.05).add_to(spec, translation([0.4, 0.0, 2.0]))
    stand = sphere_stand(0.02, centre_height_m=0.26, crank_m=0.0)
    spec.attach(stand, prefix="stand/", frame=spec.worldbody.add_frame(pos=[-0.4, 0, 2.0]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def agree(model, data, origin, directions) -> int:
    """Count of hits, all of them the same for both backends."""
    fast = RayCaster(model, backend="embree").cast(data, origin, directions)
    reference = RayCaster(model, backend="mujoco").cast(data, origin, directions)
    same = fast.geom_id == reference.geom_id
    assert (~same).sum() <= 2  # rays that pass an outline within the 20 nm of single precision
    both = same & fast.hit
    np.testing.assert_allclose(fast.distance_m[both], reference.distance_m[both], atol=DISTANCE_TOLERANCE_M)
    turned = np.linalg.norm(fast.normals[both] - reference.normals[both], axis=1)
    assert (turned > NORMAL_TOLERANCE).mean() < 1e-3  # those within 20 nm of an edge may have the neighbour's normal
    return int(both.sum())


@pytest.mark.parametrize(
    ("target", "spread_m"),
    [((0, 0, 2.05), 0.12), ((0.4, 0, 2.02), 0.05), ((-0.4, 0, 2.25), 0.03), ((0.8, 0, 0.3), 0.6)],
    ids=["v-groove", "boss", "sphere stand", "table"],
)
def test_both_backends_meet_the_same_surface(parts, target, spread_m):
    """25 000 random rays on each, from five origins."""
    model, data = parts
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(5):
        origin = np.asarray(target) + 0.3 * unit(rng.normal(size=3) + [0, 0, 2]) + [0, 0, spread_m]
        aims = np.asarray(target) + spread_m * rng.uniform(-1, 1, (5000, 3))
        hits += agree(model, data, origin, unit(aims - origin))
    assert hits > 5000


def test_every_kind_of_solid_is_met_as_by_mujoco(scene):
    """From outside and inside; a height field, which Embree leaves to MuJoCo, among them."""
    rng = np.random.default_rng(2)
    kinds = {
        "sphere": ".1", "box": ".1 .06 .15", "cylinder": ".08 .12", "capsule": ".06 .1", "ellipsoid": ".05 .1 .15",
    }  # fmt: skip
    for kind, size in kinds.items():
        model, data = scene(f'<body pos=".1 .2 .3" euler="20 50 -70"><geom type="{kind}" size="{size}"/></body>')
        for distance_m in (0.0, 0.03, 0.5, 5.0):
            origin = np.array([0.1, 0.2, 0.3]) + distance_m * unit(rng.normal(size=3))
            aims = np.array([0.1, 0.2, 0.3]) + rng.uniform(-0.2, 0.2, (2000, 3))
            assert agree(model, data, origin, unit(aims - origin)) > 300
    field = '<hfield name="f" nrow="3" ncol="3" size=".3 .3 .1 .1" elevation="0 1 0 1 .5 0 0 0 1"/>'
    world = '<geom type="hfield" hfield="f"/><geom type="plane" size=".3 .2 1" pos=".5 0 0"/><geom size=".05"/>'
    model, data = scene(world, field)
    aims = rng.uniform(-0.5, 0.9, (4000, 3)) * [1, 1, 0]
    assert agree(model, data, np.array([0.1, 0.1, 0.6]), unit(aims - [0.1, 0.1, 0.6])) > 1000


def test_axis_parallel_rays_meet_boxes_cylinders_and_capsules_exactly(scene):
    """Divisions by a zero component of the direction."""
    model, data = scene(
        '<geom type="box" size=".1 .1 .1"/><geom type="cylinder" size=".1 .2" pos="1 0 0"/>'
        '<geom type="capsule" size=".1 .2" pos="2 0 0"/>'
    )
    caster = RayCaster(model, backend="embree")
    down, across = np.array([[0, 0, -1.0]]), np.array([[0, 1.0, 0]])
    for x, top_m in ((0, 0.1), (1, 0.2), (2, 0.3)):
        hits = caster.cast(data, np.array([x, 0, 1.0]), down)
        assert hits.distance_m[0] == pytest.approx(1 - top_m, abs=1e-15)
        assert hits.normals[0].tolist() == [0, 0, 1]
        assert not caster.cast(data, np.array([x + 0.101, 0, 1.0]), down).hit[0]
        side = caster.cast(data, np.array([x, -1.0, 0.05]), across)
        assert side.distance_m[0] == pytest.approx(0.9, abs=1e-15)
        np.testing.assert_allclose(side.normals[0], [0, -1, 0], atol=1e-15)


def test_rays_through_vertices_of_a_fine_ball_do_not_leak():
    """Of 150 000 rays from within, through vertices of six triangles each, some 200 would without being led aside."""
    ball = trimesh.creation.icosphere(4, 0.05)
    spec = mujoco.MjSpec()
    add_mesh_geom(spec, spec.worldbody, "ball", ball.vertices, ball.faces, STEEL, group=0, mask=PART_MASK)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    aims = model.mesh_vert @ data.geom_xmat[0].reshape(3, 3).T + data.geom_xpos[0]
    caster, rng = RayCaster(model, backend="embree"), np.random.default_rng(0)
    missed = 0
    for _ in range(60):
        inside = rng.uniform(-0.01, 0.01, 3)
        missed += np.sum(~caster.cast(data, inside, unit(aims - inside)).hit)
    assert missed <= 1  # what is left of them: the ray's way aside may lead along an edge


def test_rays_through_vertices_and_edges_of_a_part_do_not_leak(parts):
    """From the inside of the closed plate every ray meets it, also straight through its vertices and edges."""
    model, data = parts
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "v_groove_plate")
    mesh = model.geom_dataid[geom]
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(float)
    faces = model.mesh_face[model.mesh_faceadr[mesh] : model.mesh_faceadr[mesh] + model.mesh_facenum[mesh]]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    middles = 0.5 * (vertices[faces] + vertices[np.roll(faces, 1, axis=1)]).reshape(-1, 3)
    inside = np.array([0.012, -0.055, 2.011])
    aims = np.concatenate([vertices, middles]) @ rotation.T + data.geom_xpos[geom]
    hits = RayCaster(model, groups=(0,), backend="embree").cast(data, inside, unit(aims - inside))
    assert (hits.geom_id == geom).all()
    beyond_m = hits.distance_m - np.linalg.norm(aims - inside, axis=1)
    passed = beyond_m > 1e-6
    assert passed.mean() < 1e-3  # all but a few that just pass the groove's root or a bend of its wall, outlines there
    plate = trimesh.Trimesh(vertices @ rotation.T + data.geom_xpos[geom], faces)
    far = passed & (beyond_m > 1e-3)  # these graze the wall and go on within the metal; others end just behind the root
    assert plate.contains((aims[far] + hits.points[far]) / 2).all()


def test_a_far_origin_costs_no_accuracy(scene):
    """A mesh 1 km away: in single precision alone its distance would be known to 60 um."""
    model, data = scene(
        '<geom type="mesh" mesh="m" pos="0 0 -1000"/>',
        '<mesh name="m" vertex="-.1 -.1 0  .1 -.1 0  .1 .1 0  -.1 .1 0  0 0 -.1"/>',
    )
    top = float((data.geom_xpos[0] + data.geom_xmat[0].reshape(3, 3) @ model.mesh_vert.T.max(axis=1))[2])
    aims = np.array([[0.03, 0.02, -1000.0], [-0.05, 0.01, -1000.0]])
    hits = RayCaster(model, backend="embree").cast(data, np.zeros(3), unit(aims))
    reference = RayCaster(model, backend="mujoco").cast(data, np.zeros(3), unit(aims))
    assert top < -999
    np.testing.assert_allclose(hits.distance_m, reference.distance_m, atol=1e-9)  # m, rounding at 1 km is 1e-13


def test_hits_are_the_same_bytes_every_time_and_for_rays_in_any_company(parts):
    model, data = parts
    rng = np.random.default_rng(3)
    origin = np.array([0.05, 0.02, 2.4])
    directions = unit(rng.uniform(-0.15, 0.15, (3000, 3)) + [0, 0, 2.05] - origin)
    first = RayCaster(model, backend="embree").cast(data, origin, directions)
    again = RayCaster(model, backend="embree").cast(data, origin, directions)
    assert first.distance_m.tobytes() == again.distance_m.tobytes()
    assert first.normals.tobytes() == again.normals.tobytes()
    some = RayCaster(model, backend="embree").cast(data, origin, directions[::7])
    np.testing.assert_allclose(some.distance_m, first.distance_m[::7], rtol=0, atol=1e-14)


def test_a_moved_geom_is_met_where_it_is(parts):
    model, _ = parts
    moved = mujoco.MjData(model)
    mujoco.mj_kinematics(model, moved)
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "v_groove_plate")
    caster = RayCaster(model, backend="embree")
    origin, down = np.array([0.05, 0.06, 2.5]), np.array([[0, 0, -1.0]])
    before = caster.cast(moved, origin, down).distance_m[0]
    moved.geom_xpos[geom] += [0.0, 0.0, 0.1]
    assert caster.cast(moved, origin, down).distance_m[0] == pytest.approx(before - 0.1, abs=1e-12)


def test_invisible_geoms_stop_no_ray_in_either_backend(scene):
    model, data = scene(
        '<geom size=".1" rgba="1 1 1 0"/><geom size=".1" material="glass" pos="0 0 -.5"/>'
        '<geom size=".1" pos="0 0 -1"/>',
        '<material name="glass" rgba="1 1 1 0"/>',
    )
    for backend in ("embree", "mujoco"):
        hits = RayCaster(model, backend=backend).cast(data, np.array([0, 0, 1.0]), np.array([[0, 0, -1.0]]))
        assert hits.geom_id.tolist() == [2]


def test_absurdly_far_origins_miss_quietly(parts):
    model, data = parts
    for far_m in (1e9, 1e30, 1e100):
        hits = RayCaster(model, backend="embree").cast(data, np.array([far_m, 0, 2.0]), np.array([[0, 0, 1.0]]))
        assert not hits.hit.any()


def test_an_unknown_backend_is_refused(parts):
    with pytest.raises(BadGeometry, match="Available: embree, mujoco"):
        RayCaster(parts[0], backend="gpu")

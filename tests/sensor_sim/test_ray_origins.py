"""Rays that each start at a place of their own: both backends, against one ray at a time from a single origin."""

import numpy as np
import pytest

from weldcell.cell.errors import BadGeometry
from weldcell.sensor_sim.rays import RayCaster

SCENE = (
    '<geom type="plane" size="0 0 1" pos="0 0 -.5"/>'
    '<body pos=".1 .2 0" euler="20 30 40"><geom type="box" size=".1 .06 .15"/></body>'
    '<body pos="-.2 .1 0" euler="50 -30 0"><geom type="cylinder" size=".08 .12"/></body>'
    '<body pos="0 -.3 .1" euler="0 70 10"><geom type="capsule" size=".06 .1"/></body>'
    '<geom type="sphere" size=".1" pos=".4 0 0"/><geom type="ellipsoid" size=".05 .1 .15" pos="-.4 -.1 0"/>'
    '<body pos="0 .5 0" euler="10 20 30"><geom type="mesh" mesh="tetra"/></body>'
)
TETRAHEDRON = '<mesh name="tetra" vertex="0 0 0  .3 0 0  0 .3 0  0 0 .3"/>'


def random_rays(count, seed):
    rng = np.random.default_rng(seed)
    origins, aims = rng.uniform(-0.8, 0.8, (count, 3)), rng.uniform(-0.4, 0.4, (count, 3))
    return origins, (aims - origins) / np.linalg.norm(aims - origins, axis=1, keepdims=True)


@pytest.mark.parametrize("backend", ["mujoco", "embree"])
@pytest.mark.parametrize("seed", [1, 2])
def test_each_ray_meets_what_it_would_meet_alone(scene, backend, seed):
    """From inside solids too; 1e-9 m: the jitter against MuJoCo's leaks differs from ray to ray."""
    if backend == "embree":
        pytest.importorskip("embreex", reason="no wheel for this machine")
    model, data = scene(SCENE, TETRAHEDRON)
    caster, (origins, directions) = RayCaster(model, backend=backend), random_rays(300, seed)
    together = caster.cast(data, origins, directions)
    alone = [caster.cast(data, o, d[None]) for o, d in zip(origins, directions, strict=True)]
    np.testing.assert_array_equal(together.geom_id, [hit.geom_id[0] for hit in alone])
    np.testing.assert_allclose(together.distance_m, [hit.distance_m[0] for hit in alone], atol=1e-9)
    np.testing.assert_allclose(together.normals, [hit.normals[0] for hit in alone], atol=1e-7)
    np.testing.assert_allclose(together.points, [hit.points[0] for hit in alone], atol=1e-9)
    assert together.hit.sum() > 150


def test_both_backends_meet_the_same_surfaces(scene):
    """To 1e-8 m, as for rays from one origin; at most two rays pass an outline differently."""
    pytest.importorskip("embreex", reason="no wheel for this machine")
    model, data = scene(SCENE, TETRAHEDRON)
    origins, directions = random_rays(4000, 3)
    fast, reference = (RayCaster(model, backend=b).cast(data, origins, directions) for b in ("embree", "mujoco"))
    same = fast.geom_id == reference.geom_id
    assert (~same).sum() <= 2
    np.testing.assert_allclose(fast.distance_m[same], reference.distance_m[same], atol=1e-8)


def test_a_triangle_is_named_on_meshes_only(scene):
    pytest.importorskip("embreex", reason="no wheel for this machine")
    model, data = scene(SCENE, TETRAHEDRON)
    hits = RayCaster(model, backend="embree").cast(data, *random_rays(4000, 4))
    mesh = hits.geom_id == 6
    assert (hits.face_id[~mesh] == -1).all() and set(hits.face_id[mesh]) == {0, 1, 2, 3}
    faces = model.mesh_vert[model.mesh_face][hits.face_id[mesh]].astype(float)
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]) @ data.geom_xmat[6].reshape(3, 3).T
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    np.testing.assert_allclose(np.abs(np.sum(normals * hits.normals[mesh], axis=1)), 1, atol=1e-6)  # float32 corners


def test_geoms_left_out_are_not_met(scene):
    model, data = scene(SCENE, TETRAHEDRON)
    origins, directions = random_rays(500, 5)
    among = np.arange(model.ngeom) != 0
    everything = RayCaster(model).cast(data, origins, directions)
    some = RayCaster(model).cast(data, origins, directions, among)
    assert (everything.geom_id == 0).any() and not (some.geom_id == 0).any()
    np.testing.assert_array_equal(some.geom_id[everything.geom_id > 0], everything.geom_id[everything.geom_id > 0])


def test_origins_that_fit_no_rays_are_refused(scene):
    model, data = scene(SCENE, TETRAHEDRON)
    origins, directions = random_rays(5, 6)
    with pytest.raises(BadGeometry, match="rays: expected an origin"):
        RayCaster(model).cast(data, origins[:4], directions)
    origins[3, 1] = np.nan
    with pytest.raises(BadGeometry, match="finite origin"):
        RayCaster(model).cast(data, origins, directions)

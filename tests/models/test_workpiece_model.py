"""A workpiece is checked when it is built, and stands in MuJoCo where it was put."""

import mujoco
import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from
from weldcell.models.boss import boss
from weldcell.models.workpiece import Workpiece

CUBE = trimesh.creation.box((0.1, 0.1, 0.1))


def piece(vertices=CUBE.vertices, faces=CUBE.faces):
    return Workpiece(name="cube", vertices_part=np.asarray(vertices), faces=np.asarray(faces))


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (CUBE.vertices, CUBE.faces[:-1], "open"),
        (CUBE.vertices, CUBE.faces[:, ::-1], "inside out"),
        (CUBE.vertices * np.nan, CUBE.faces, "finite"),
        (CUBE.vertices, CUBE.faces + 1, "indices"),
        (CUBE.vertices, np.zeros((0, 3), int), "indices"),
    ],
)
def test_meshes_that_are_not_solids_are_refused(vertices, faces, words):
    with pytest.raises(BadGeometry, match=words):
        piece(vertices, faces)


def test_rays_hit_the_part_where_it_was_put():
    """A ray straight down on the boss's top, turned and moved: the hit is at the top plane's height."""
    part = boss(0.050, np.arctan2(4, 3), 0.040)
    T_base_part = rigid_from(Rotation.from_euler("z", 30, degrees=True), np.array([0.93, -0.19, 0.30]))
    spec = mujoco.MjSpec()
    part.add_to(spec, T_base_part)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    start = T_base_part.apply(np.array([0.0131, -0.0072, 1.0]))
    distance = mujoco.mj_ray(model, data, start, np.array([0, 0, -1.0]), None, 1, -1, np.zeros(1, np.int32))
    assert start[2] - distance - 0.30 == pytest.approx(part.planes_part["top"][3], abs=1e-7)  # m: float32 vertices
    geom = model.geom("boss")
    assert (geom.group[0], geom.contype[0], geom.conaffinity[0]) == (0, 2, 1)

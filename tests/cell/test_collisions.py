"""Collisions: real meshes at workpieces, margins that the broad phase knows, tools that meet their own arm."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from, translation
from weldcell.cell.world.cell import CLEARANCE_M
from weldcell.cell.world.mesh_clearance import MeshClearance
from weldcell.cell.world.scene import HOME_RAD
from weldcell.models.boss import boss
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.mesh_body import PART_MASK, STEEL, add_mesh_geom
from weldcell.models.seam_path import StraightPath
from weldcell.models.swept_joint import joint_part
from weldcell.models.torch import build_torch

FLOAT32_M = 2e-7  # MuJoCo keeps vertices in single precision: 1e-8 of a part of 0.15 m, times a few
SOLVER_M = 5e-6  # MuJoCo's distance of convex shapes stops at 1e-6 m
ABOUT_X = Rotation.from_rotvec([np.pi, 0, 0])  # the torch points down
FRONT_M, OUTER_M = 0.015, 0.0095  # the nozzle's front above the wire's tip, and the radius of its outer edge
OUTER_EDGE_GAPS = [  # (joint, sizes, tip above the root, lean of the torch to the right, gap); 48 facets: one at y
    # Front edge against a 60 deg wall that starts at the root's height: z sin 30 - r cos 30.
    ("v", {"thickness_m": 0.06, "root_face_m": 0.002}, 0.005, 0.0, 0.020 * 0.5 - OUTER_M * np.sqrt(0.75)),
    # Flat front above the plate: 15 mm above the root, 2 + 10 mm of plate.
    ("v", {"thickness_m": 0.012, "root_face_m": 0.002}, 0.0, 0.0, FRONT_M - 0.010),
    # Midway between floor and web of a fillet: z sin 45 - r cos 45.
    ("fillet", {"thickness_m": 0.01, "rise_m": 0.06}, 0.0, np.pi / 4, (FRONT_M - OUTER_M) * np.sqrt(0.5)),
]


def nozzle_at(part, T_part_torch):
    """A model of the torch over a part, up-to-date data, and the ids of nozzle and part."""
    spec = mujoco.MjSpec()
    part.add_to(spec, translation([0.0, 0, 0]))
    frame = spec.worldbody.add_frame(
        pos=T_part_torch.translation, quat=T_part_torch.rotation.as_quat(scalar_first=True)
    )
    spec.attach(build_torch(translation([0.0, 0, 0])), prefix="torch/", frame=frame)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data, model.geom("torch/torch_nozzle").id, model.geom(part.name).id


@pytest.mark.parametrize(("kind", "sizes", "above_m", "lean_rad", "gap_m"), OUTER_EDGE_GAPS)
def test_nozzle_in_a_joint_is_as_far_from_it_as_the_section_says(kind, sizes, above_m, lean_rad, gap_m):
    part = joint_part(joint_section(kind, JointSize(**sizes)), StraightPath(length_m=0.15), 0.12)
    root = part.seam_part.at("root", np.array([0.075]))[0]
    turn = Rotation.from_rotvec([lean_rad, 0, 0]) * ABOUT_X
    place = rigid_from(turn, root - above_m * turn.apply([0, 0, 1]))
    model, data, nozzle, joint = nozzle_at(part, place)
    near = MeshClearance(model)
    assert near.within(data, nozzle, joint, gap_m + FLOAT32_M)
    assert not near.within(data, nozzle, joint, gap_m - FLOAT32_M)
    inside_its_hull = sizes["thickness_m"] != 0.012
    assert (mujoco.mj_geomDistance(model, data, nozzle, joint, 0.1, None) < 0) == inside_its_hull


def boss_and_its_pieces(block):
    """The boss as one mesh, and as the two convex solids it consists of, in one model with a piece on a mocap body."""
    spec = mujoco.MjSpec()
    block.add_to(spec, translation([0.0, 0, 0]))
    rings = block.vertices_part.reshape(-1, 4, 3)
    for name, solid in (("slab", rings[:2]), ("frustum", rings[2:])):
        hull_faces = np.array([(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), (0, 1, 5), (0, 5, 4), (1, 2, 6), (1, 6, 5),
                               (2, 3, 7), (2, 7, 6), (3, 0, 4), (3, 4, 7)])  # fmt: skip
        add_mesh_geom(spec, spec.worldbody, name, solid.reshape(-1, 3), hull_faces, STEEL, group=0, mask=PART_MASK)
    carrier = spec.worldbody.add_body(name="carrier", mocap=True)
    spec.attach(build_torch(translation([0.0, 0, 0])), prefix="torch/", frame=carrier.add_frame())
    return spec.compile()


@pytest.mark.parametrize("opened", [False, True])
def test_distances_are_those_of_mujoco_between_convex_pieces(opened):
    """Pieces of the torch that are convex, in drawn places; also where the boss's underside is missing."""
    block = boss(slant_edge_m=0.05, slope_rad=np.radians(60), top_m=0.03)
    model = boss_and_its_pieces(block)
    if opened:
        model.mesh_face[0:2] = (
            0  # its first two triangles are the underside: nothing that is asked for comes from there
        )
    data, near, rng, asked = mujoco.MjData(model), MeshClearance(model), np.random.default_rng(3), 0
    whole, slab, frustum = (model.geom(name).id for name in ("boss", "slab", "frustum"))
    for _ in range(80):
        data.mocap_pos[0] = rng.uniform([-0.08, -0.08, 0.0], [0.08, 0.08, 0.05])
        turn = Rotation.from_rotvec(rng.normal(size=3) * 0.4) * ABOUT_X
        data.mocap_quat[0] = turn.as_quat(scalar_first=True)
        mujoco.mj_kinematics(model, data)
        for name in ("torch_contact_tip", "torch_insulator"):
            piece = model.geom(f"torch/{name}").id
            gap_m = min(mujoco.mj_geomDistance(model, data, piece, other, 0.05, None) for other in (slab, frustum))
            if SOLVER_M < gap_m < 0.03:
                asked += 1
                assert near.within(data, piece, whole, gap_m + SOLVER_M)
                assert not near.within(data, piece, whole, gap_m - SOLVER_M)
            elif gap_m < -1e-3 and not opened:
                assert near.within(data, piece, whole, 0.0)
    assert asked > 20


@pytest.fixture
def cell(known_cell):
    """The known cell with its parts far from the tools."""
    for part in ("plate", "boss", "sphere"):
        known_cell.place(part, translation([-2.0, -2.0, 0.5]))
    known_cell.take(HOME_RAD)
    return known_cell


def test_torch_may_work_in_a_groove_where_it_may_not_travel(cell, parts):
    """As the section says: 3 mm at the root of a shallow groove, or beside a plate's edge just as well."""
    top_m = parts.plate.vertices_part[:, 2].max()
    edge_y = parts.plate.vertices_part[:, 1].max()
    for gap_m, at_work, in_travel in ((0.0029, True, True), (0.0031, False, True), (0.0079, False, True)):
        below_front = [0, -edge_y, FRONT_M - gap_m - top_m]  # the plate's upper edge is below the nozzle's middle
        cell.place("plate", translation(cell.tip_base + below_front))
        assert cell.collides(HOME_RAD, 0.003) == at_work
        assert cell.collides(HOME_RAD) == in_travel
    cell.place("plate", translation(cell.tip_base + [0, -edge_y, FRONT_M - 0.0085 - top_m]))
    assert not cell.collides(HOME_RAD)


def test_clearance_at_work_is_at_most_the_usual_one(cell):
    with pytest.raises(BadGeometry, match="clearance"):
        cell.collides(HOME_RAD, 2 * CLEARANCE_M)


@pytest.mark.parametrize(("gap_m", "expected"), [(0.005, True), (0.0078, True), (0.0082, False)])
def test_clearance_holds_below_what_sticks_out_of_a_body(cell, parts, gap_m, expected):
    """The sphere under the laser's window: the boxes of head and stand are apart, by less than the clearance."""
    model, data = cell.model, cell.data
    window = model.geom("sensor/sensor_laser_window").id
    first, count = (at[model.geom_dataid[window]] for at in (model.mesh_vertadr, model.mesh_vertnum))
    vertices = model.mesh_vert[first : first + count] @ data.geom_xmat[window].reshape(3, 3).T + data.geom_xpos[window]
    under = [*vertices.mean(axis=0)[:2], vertices[:, 2].min() - gap_m - parts.sphere_radius_m]
    cell.place("sphere", translation(under))
    assert cell.collides(HOME_RAD) == expected


@pytest.mark.parametrize(
    ("posture_deg", "meeting"),
    [
        ((0, -71, 136, 0, 93, 0), True),  # the arm folded so far that the camera meets the carousel
        ((0, -71, 106, 0, 93, 0), False),
        ((0, -101, 145, 0, 103, 180), True),  # the nozzle does
        ((0, -101, 115, 0, 103, 180), False),
        ((12, -76, 76, -34, 96, -80), False),
    ],
)
def test_tools_do_not_run_into_their_own_arm(cell, posture_deg, meeting):
    assert cell.collides(np.radians(posture_deg)) == meeting

"""The arm against closed forms: kinematics, masses, meshes, limits."""

import mujoco
import numpy as np
import py_opw_kinematics
import pytest
from scipy.spatial.transform import Rotation

from weldcell.models.arm import ARM_MASS_KG, KR5_ARC, build_arm, link_masses_kg, link_pieces
from weldcell.models.mesh_body import add_pieces, volume_properties
from weldcell.models.shapes import to_trimesh

KINEMATICS_M = 1e-9  # issue's demand; double precision gives 1e-15
LINKS = [f"link_{i}" for i in range(1, 7)]


@pytest.fixture(scope="module")
def model():
    return build_arm().compile()


@pytest.fixture(scope="module")
def pieces():
    return link_pieces()


def flange_poses(model, q_rad):
    data = mujoco.MjData(model)
    site = model.site("flange").id
    positions, rotations = [], []
    for q in q_rad:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        positions.append(data.site_xpos[site].copy())
        rotations.append(data.site_xmat[site].reshape(3, 3).copy())
    return np.array(positions), np.array(rotations)


def closed_form(q_rad):
    """Brandstoetter et al. 2014, Eq. 1 to 7, with the KR 5 arc's figures written out here by hand."""
    a1, a2, b, c1, c2, c3, c4 = 0.180, -0.120, 0.0, 0.400, 0.600, 0.620, 0.115
    t1, t2, t3, t4, t5, t6 = (q_rad * [-1, 1, 1, -1, 1, -1] + np.deg2rad([0, 90, 0, 0, 0, 0])).T
    psi3, k = np.arctan2(a2, c3), np.hypot(a2, c3)
    cx1 = c2 * np.sin(t2) + k * np.sin(t2 + t3 + psi3) + a1
    cz1 = c2 * np.cos(t2) + k * np.cos(t2 + t3 + psi3)
    wrist = np.stack([cx1 * np.cos(t1) - b * np.sin(t1), cx1 * np.sin(t1) + b * np.cos(t1), cz1 + c1], axis=-1)
    s1, s4, s5, s6, s23 = np.sin(t1), np.sin(t4), np.sin(t5), np.sin(t6), np.sin(t2 + t3)
    c1_, c4_, c5, c6, c23 = np.cos(t1), np.cos(t4), np.cos(t5), np.cos(t6), np.cos(t2 + t3)
    zero = np.zeros_like(t1)
    R_0c = np.array([[c1_ * c23, -s1, c1_ * s23], [s1 * c23, c1_, s1 * s23], [-s23, zero, c23]])
    R_ce = np.array(
        [
            [c4_ * c5 * c6 - s4 * s6, -c4_ * c5 * s6 - s4 * c6, c4_ * s5],
            [s4 * c5 * c6 + c4_ * s6, -s4 * c5 * s6 + c4_ * c6, s4 * s5],
            [-s5 * c6, s5 * s6, c5],
        ]
    )
    rotation = np.moveaxis(R_0c, -1, 0) @ np.moveaxis(R_ce, -1, 0)
    return wrist + c4 * rotation[..., 2], rotation


def random_joints(count):
    return np.random.default_rng(5).uniform(KR5_ARC.limits_rad[:, 0], KR5_ARC.limits_rad[:, 1], (count, 6))


def assert_same_poses(model, q_rad, positions, rotations):
    actual_positions, actual_rotations = flange_poses(model, q_rad)
    assert np.abs(actual_positions - positions).max() < KINEMATICS_M
    # |R - R'| in Frobenius norm is sqrt(2) times the angle for small angles; both are below the same 1e-9 rad
    assert np.linalg.norm(actual_rotations - rotations, axis=(1, 2)).max() < 1e-9


def test_forward_kinematics_equal_the_closed_form_at_ten_thousand_joint_vectors(model):
    q_rad = random_joints(10_000)
    assert_same_poses(model, q_rad, *closed_form(q_rad))


def test_forward_kinematics_equal_an_independent_library(model):
    kinematics = py_opw_kinematics.KinematicModel(
        a1=0.18, a2=-0.12, b=0, c1=0.4, c2=0.6, c3=0.62, c4=0.115,
        offsets=(0, -np.pi / 2, 0, 0, 0, 0), flip_axes=(True, False, False, True, False, True),
    )  # fmt: skip
    robot = py_opw_kinematics.Robot(kinematics, degrees=False)
    q_rad = random_joints(500)
    poses = [robot.forward(tuple(q)).as_matrix() for q in q_rad]
    assert_same_poses(model, q_rad, np.array(poses)[:, :3, 3], np.array(poses)[:, :3, :3])


@pytest.mark.parametrize(
    ("q_deg", "position_m", "z_base", "x_base"),
    [
        # by hand: 0.18 + 0.6 + 0.62 + 0.115 forwards; 0.4 + 0.12 up
        ((0, 0, 0, 0, 0, 0), (1.515, 0, 0.520), (1, 0, 0), (0, 0, -1)),
        # 0.18 + 0.62 + 0.115 forwards; 0.4 + 0.6 + 0.12 up
        ((0, -90, 90, 0, 0, 0), (0.915, 0, 1.120), (1, 0, 0), (0, 0, -1)),
        # positive axis 1 turns clockwise seen from above; flange points down with axis 5 at +90
        ((90, -90, 90, 0, 90, 0), (0, -0.800, 1.005), (0, 0, -1), (0, 1, 0)),
    ],
)
def test_known_controller_poses(model, q_deg, position_m, z_base, x_base):
    positions, rotations = flange_poses(model, np.deg2rad([q_deg]))
    np.testing.assert_allclose(positions[0], position_m, atol=1e-12)
    np.testing.assert_allclose(rotations[0][:, 2], z_base, atol=1e-12)
    np.testing.assert_allclose(rotations[0][:, 0], x_base, atol=1e-12)


def test_limits_and_speeds_are_those_of_the_data_sheet(model):
    limits_deg = [(-155, 155), (-180, 65), (-15, 158), (-350, 350), (-130, 130), (-350, 350)]
    np.testing.assert_allclose(np.rad2deg(model.jnt_range), limits_deg, atol=1e-9)
    assert model.jnt_limited.all()
    np.testing.assert_allclose(np.rad2deg(KR5_ARC.speeds_rad_s), [154, 154, 228, 343, 384, 721], atol=1e-9)


def test_joints_sit_at_their_bodies_origins(model):
    assert np.all(model.jnt_pos == 0)


def test_mass_is_the_data_sheets_and_densities_are_plausible(model, pieces):
    assert model.body_mass.sum() == pytest.approx(ARM_MASS_KG, abs=1e-9)
    for name, mass_kg in link_masses_kg(pieces).items():
        assert 1500 < mass_kg / volume_properties(pieces[name])[0] < 5000  # between hollow aluminium and steel, kg/m3


def test_inertias_are_those_of_real_bodies(model):
    for name in LINKS:
        smallest, middle, largest = np.sort(model.body(name).inertia)
        assert smallest > 0
        assert smallest + middle > largest  # triangle inequality of moments of inertia


def test_inertia_equals_what_mujoco_integrates_itself(model, pieces):
    """MuJoCo's exact mesh inertia of the same solids, with the link's effective density."""
    for name in LINKS:
        spec = mujoco.MjSpec()
        body = spec.worldbody.add_body(name=name)
        add_pieces(spec, body, pieces[name], group=0)
        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_EXACT
        density = link_masses_kg(pieces)[name] / volume_properties(pieces[name])[0]
        for geom in spec.geoms:
            geom.mass, geom.density = np.nan, density
        expected = spec.compile().body(name)
        actual = model.body(name)
        np.testing.assert_allclose(actual.mass, expected.mass, rtol=1e-5)  # float32 vertices
        np.testing.assert_allclose(actual.ipos, expected.ipos, atol=1e-6)  # m
        np.testing.assert_allclose(actual.inertia, expected.inertia, rtol=1e-4)


def test_meshes_are_watertight_and_light(pieces):
    for name, solids in pieces.items():
        meshes = [to_trimesh(piece.solid) for piece in solids]
        assert all(mesh.is_watertight and mesh.volume > 0 for mesh in meshes), name
        assert sum(len(mesh.faces) for mesh in meshes) < 10_000, name


def test_body_frame_meshes_can_be_read_back_from_the_compiled_model(model, pieces):
    """MuJoCo recentres meshes: geom_pos and geom_quat undo it."""
    for body, solids in pieces.items():
        for piece in solids:
            geom = model.geom(piece.name)
            mesh = model.mesh(geom.dataid[0])
            vertices = model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]]
            rotation = Rotation.from_quat(geom.quat, scalar_first=True)
            expected = to_trimesh(piece.solid).vertices
            error = np.abs(rotation.apply(vertices) + geom.pos - expected).max()
            assert error < 5e-7, body  # m: float32 at half a metre
            np.testing.assert_allclose(geom.rgba, piece.finish.rgba, atol=1e-6)


def test_links_do_not_collide_with_one_another_but_with_parts():
    spec = build_arm()
    spec.worldbody.add_geom(
        name="part", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], pos=[1.5, 0, 0.52], contype=2, conaffinity=1
    )
    model = spec.compile()
    data = mujoco.MjData(model)  # zero: stretched out to the part
    mujoco.mj_forward(model, data)
    part = model.geom("part").id
    assert data.ncon > 0
    assert all(part in contact.geom for contact in data.contact[: data.ncon])


def test_motors_hold_the_stretched_arm_and_some_more(model):
    data = mujoco.MjData(model)  # zero: stretched out level, the largest load of axes 2 and 3
    mujoco.mj_forward(model, data)
    limits_nm = model.actuator_ctrlrange[:, 1]
    assert np.all(np.abs(data.qfrc_bias) < limits_nm / 3)
    data.ctrl[:] = data.qfrc_bias
    mujoco.mj_step(model, data, nstep=1000)
    assert np.abs(data.qpos).max() < 1e-6  # rad: what rounding does to a balance that is stable by friction alone


def test_dry_friction_is_small_against_the_motors(model):
    shares = model.dof_frictionloss / model.actuator_ctrlrange[:, 1]
    assert np.all((shares > 0.02) & (shares < 0.05))


def test_small_models_use_dense_jacobians(model):
    assert model.opt.jacobian == mujoco.mjtJacobian.mjJAC_DENSE

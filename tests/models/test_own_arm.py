"""An arm taken from a foreign model moves, weighs and looks as that model does, under the cell's own names."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import rigid_from, translation
from weldcell.models.own_arm import arm_of_model, build_own_arm

FOREIGN = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="stand" pos="0.1 -0.2 0.3" euler="0 0 30">
      <geom type="box" size="0.1 0.1 0.1" rgba="1 0 0 1"/>
      <body pos="0 0 0.2" euler="10 0 0">
        <joint name="a" axis="0 0 1" pos="0.01 0 0"/>
        <geom type="capsule" size="0.05" fromto="0 0 0 0.2 0 0.1" contype="0" conaffinity="0" rgba="0 1 0 1"/>
        <geom type="box" size="0.1 0.05 0.05"/>
        <body pos="0.2 0 0.1">
          <joint name="b" axis="0 1 0"/>
          <joint name="c" axis="1 0.2 0" pos="0 0 0.3"/>
          <geom type="sphere" size="0.06" pos="0 0 0.15"/>
          <body pos="0.05 0 0.5">
            <body pos="0.1 0 0">
              <joint name="d" axis="1 0 0"/>
              <geom type="cylinder" size="0.04 0.2" zaxis="1 0 0"/>
              <body pos="0.4 0.02 0">
                <joint name="e" axis="0 1 0" ref="15"/>
                <geom type="ellipsoid" size="0.05 0.06 0.07"/>
                <body pos="0.1 0 0">
                  <joint name="f" axis="1 0 0"/>
                  <geom type="box" size="0.02 0.03 0.03"/>
                  <site name="tip" pos="0.05 0 0" euler="0 90 0"/>
                  <body pos="0.1 0 0"><joint name="finger" type="slide" axis="0 1 0"/><geom size="0.01"/></body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = "abcdef"
LIMITS_RAD = np.tile([-3.0, 3.0], (6, 1))


@pytest.fixture(scope="module")
def foreign():
    return mujoco.MjModel.from_xml_string(FOREIGN)


def taken(model, T_base_world=None, **other):
    site = model.site("tip").id
    told = {"limits_rad": LIMITS_RAD, "speeds_rad_s": np.ones(6), "home_rad": np.full(6, 0.2)} | other
    return arm_of_model(
        model,
        [model.joint(name).id for name in JOINTS],
        int(model.site_bodyid[site]),
        rigid_from(Rotation.from_quat(model.site_quat[site], scalar_first=True), model.site_pos[site].copy()),
        name="foreign",
        T_base_world=RigidTransform.identity() if T_base_world is None else T_base_world,
        **told,
    )


def flange(model, joints, site, readings):
    data = mujoco.MjData(model)
    data.qpos[[model.joint(name).qposadr[0] for name in joints]] = readings
    mujoco.mj_kinematics(model, data)
    k = model.site(site).id
    return rigid_from(Rotation.from_matrix(data.site_xmat[k].reshape(3, 3)), data.site_xpos[k].copy())


@pytest.mark.parametrize("seed", range(4))
def test_it_moves_as_the_foreign_model_does(foreign, seed):
    readings = np.random.default_rng(seed).uniform(-3, 3, 6)
    place = rigid_from(Rotation.from_euler("z", 0.3), np.array([-0.4, 0.1, 0.2]))
    own = build_own_arm(taken(foreign, place)).compile()
    there = flange(own, [f"joint_{k + 1}" for k in range(6)], "flange", readings)
    off = there.inv() * (place * flange(foreign, JOINTS, "tip", readings))
    assert np.abs(off.translation).max() < 1e-12 and off.rotation.magnitude() < 1e-12  # m, rad: rounding


@pytest.mark.parametrize("seed", range(3))
def test_it_weighs_as_the_foreign_model_does(foreign, seed):
    readings = np.random.default_rng(seed).uniform(-3, 3, 6)
    own = build_own_arm(taken(foreign)).compile()
    torques = []
    for model, joints in ((own, [f"joint_{k + 1}" for k in range(6)]), (foreign, JOINTS)):
        data = mujoco.MjData(model)
        data.qpos[[model.joint(name).qposadr[0] for name in joints]] = readings
        mujoco.mj_forward(model, data)
        dofs = [model.joint(name).dofadr[0] for name in joints]
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        mass -= np.diag(model.dof_armature)
        torques.append((data.qfrc_bias[dofs], mass[np.ix_(dofs, dofs)]))
    (own_nm, own_mass), (there_nm, there_mass) = torques
    assert own_nm == pytest.approx(there_nm, abs=0.1)  # Nm of some 100: links have 1 g and 1e-6 kg m2 at least
    assert own_mass == pytest.approx(there_mass, abs=1e-2)  # kg m2, of some 10


def test_what_is_seen_and_what_collides_are_told_apart(foreign):
    model = build_own_arm(taken(foreign)).compile()
    of_link = {
        name: [g for g in range(model.ngeom) if model.body(model.geom_bodyid[g]).name == name]
        for name in ("base", "link_1")
    }
    assert len(of_link["base"]) == 1  # the floor is not the arm's
    assert model.geom_contype[of_link["base"][0]] and model.geom_rgba[of_link["base"][0], 3] == 1
    seen, touching = of_link["link_1"]
    assert model.geom_contype[seen] == 0 and model.geom_rgba[seen, 3] == 1
    assert model.geom_contype[touching] == 1 and model.geom_rgba[touching, 3] == 0


def test_its_motors_hold_any_posture(foreign):
    model = build_own_arm(taken(foreign, home_rad=np.zeros(6))).compile()
    data = mujoco.MjData(model)
    for seed in range(5):
        data.qpos[:] = np.random.default_rng(seed).uniform(-3, 3, 6)
        mujoco.mj_forward(model, data)
        assert np.all(np.abs(data.qfrc_bias) < model.actuator_ctrlrange[:, 1] / 2)


def test_home_outside_the_limits_is_refused(foreign):
    with pytest.raises(BadGeometry, match="home: joint 3"):
        taken(foreign, home_rad=np.array([0, 0, 4.0, 0, 0, 0]))
    with pytest.raises(BadGeometry, match="limits"):
        taken(foreign, limits_rad=-LIMITS_RAD)
    with pytest.raises(BadGeometry, match="speeds"):
        taken(foreign, speeds_rad_s=np.zeros(6))


def test_reach_bounds_the_flange(foreign):
    arm = taken(foreign, translation([0, 0, 1.0]))
    own = build_own_arm(arm).compile()
    for seed in range(5):
        readings = np.random.default_rng(seed).uniform(-3, 3, 6)
        there = flange(own, [f"joint_{k + 1}" for k in range(6)], "flange", readings)
        assert np.linalg.norm(there.translation - arm.anchors_base[0]) <= arm.reach_m

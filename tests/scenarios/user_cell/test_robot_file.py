"""A user's robot is read from MJCF or URDF; hostile files are refused in one line, soon, with nothing else opened."""

import contextlib
import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from weldcell.cell.errors import BadInput
from weldcell.scenarios.user_cell.robot_file import read_robot

LONGEST_S = 5.0
EXAMPLES = Path(__file__).parents[3] / "docs" / "examples" / "own_part_and_robot"

AXES = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
PLACES = ["0 0 0.3", "0.1 0 0.2", "0 0 0.5", "0.1 0 0.1", "0.4 0 0", "0.1 0 0"]


def mjcf(inside="", head="", axes=AXES, deepest='<site name="tip" pos="0.05 0 0" zaxis="1 0 0"/>'):
    """An arm, with something more in its last body and before the tree."""
    body = f"{inside}{deepest}"
    for k in reversed(range(len(axes))):
        joint = f'<joint name="j{k + 1}" axis="{axes[k]}" range="-170 170"/><geom size="0.05"/>'
        body = f'<body name="b{k + 1}" pos="{PLACES[k]}">{joint}{body}</body>'
    return f'<mujoco><compiler autolimits="true"/>{head}<worldbody>{body}</worldbody></mujoco>'


def urdf(visual='<geometry><box size="0.1 0.1 0.1"/></geometry>', extra="", kind="revolute"):
    """The same arm as URDF, with other limits."""
    inertia = '<mass value="2"/><inertia ixx="1e-2" iyy="1e-2" izz="1e-2" ixy="0" ixz="0" iyz="0"/>'
    links = ['<link name="world_link"/>']
    for k in range(6):
        parent = f"l{k}" if k else "world_link"
        ends = f'<parent link="{parent}"/><child link="l{k + 1}"/>'
        rest = f'{ends}<limit lower="-2" upper="2.5" velocity="{k + 1}" effort="10"/>'
        links += [
            f'<link name="l{k + 1}"><inertial>{inertia}</inertial><visual>{visual}</visual></link>',
            f'<joint name="j{k + 1}" type="{kind}"><origin xyz="{PLACES[k]}"/><axis xyz="{AXES[k]}"/>{rest}</joint>',
        ]
    ends = '<parent link="l6"/><child link="tool0"/><origin xyz="0.05 0 0" rpy="0 1.5707963267948966 0"/>'
    links.append(f'<link name="tool0"/><joint name="fix" type="fixed">{ends}</joint>')
    return f'<robot name="r">{"".join(links)}{extra}</robot>'


TOLD = "file: arm.xml\nflange: tip\nhome_deg: [0, 10, 20, 0, 30, 0]\n".replace(
    "[0, 10, 20, 0, 30, 0]", "[0.0, 10.0, 20.0, 0.0, 30.0, 0.0]"
)


@pytest.fixture
def folder(tmp_path):
    home = tmp_path / "user"
    home.mkdir()
    return home


def written(folder, model, told=TOLD, name="arm.xml"):
    (folder / name).write_bytes(model if isinstance(model, bytes) else model.encode())
    (folder / "robot.yaml").write_text(told)
    return folder / "robot.yaml"


def refused(path, *words):
    begun = time.monotonic()
    with pytest.raises(BadInput) as caught:
        read_robot(path)
    assert time.monotonic() - begun < LONGEST_S
    line = str(caught.value)
    assert "\n" not in line and len(line) < 700 and "robot.yaml" in line
    for word in words:
        assert word in line, line


def test_the_example_arm_is_read(folder):
    robot = read_robot(EXAMPLES / "long_arm.yaml")
    assert robot.remarks == ()
    assert 1.9 < robot.arm.reach_m < 2.2  # m
    # upper arm up, forearm level, axis 5 70 mm below axis 4; standing 350 mm back
    assert robot.arm.T_base_flange_zero.translation == pytest.approx([0.78, 0, 1.49], abs=1e-12)
    assert robot.arm.T_base_flange_zero.rotation.apply([0, 0, 1]) == pytest.approx([1, 0, 0], abs=1e-12)
    assert np.degrees(robot.arm.limits_rad[1]) == pytest.approx([-85, 120])
    assert np.degrees(robot.arm.speeds_rad_s) == pytest.approx([110, 110, 120, 200, 200, 360])
    assert 80 < sum(link.mass_kg for link in robot.arm.links) < 130  # kg, what its solids weigh


def test_mjcf_and_urdf_of_one_arm_are_the_same_arm(folder):
    one = read_robot(written(folder, mjcf())).arm
    told = TOLD.replace("arm.xml", "arm.urdf").replace("tip", "tool0")
    other = read_robot(written(folder, urdf(), told, "arm.urdf")).arm
    assert other.axes_base == pytest.approx(one.axes_base, abs=1e-12)
    assert other.anchors_base == pytest.approx(one.anchors_base, abs=1e-12)
    off = one.T_base_flange_zero.inv() * other.T_base_flange_zero
    assert np.abs(off.translation).max() < 1e-12 and off.rotation.magnitude() < 1e-9  # MuJoCo rounds rpy
    assert other.limits_rad[3] == pytest.approx([-2, 2.5])
    assert other.speeds_rad_s == pytest.approx([1, 2, 3, 4, 5, 6])  # URDF says them


def test_mount_base_and_limits_come_from_the_yaml(folder):
    more = "mount_mm: [0.0, 0.0, 40.0]\nmount_deg: [0.0, 0.0, 90.0]\nbase_mm: [100.0, 0.0, 50.0]\nbase_yaw_deg: 90.0\n"
    more += "limits_deg: [[-10.0, 10.0], [-20.0, 20.0], [-30.0, 30.0], [-40.0, 40.0], [-50.0, 50.0], [-60.0, 60.0]]\n"
    plain = read_robot(written(folder, mjcf())).arm
    arm = read_robot(written(folder, mjcf(), TOLD + more)).arm
    out = plain.T_base_flange_zero.apply([0, 0, 0.04])
    assert arm.T_base_flange_zero.translation == pytest.approx([0.1 - out[1], out[0], out[2] + 0.05], abs=1e-12)
    turned = arm.T_base_flange_zero.rotation.apply([1, 0, 0])  # the mount's x is the flange's y, turned with the base
    y = plain.T_base_flange_zero.rotation.apply([0, 1, 0])
    assert turned == pytest.approx([-y[1], y[0], y[2]], abs=1e-12)
    assert np.degrees(arm.limits_rad[:, 1]) == pytest.approx([10, 20, 30, 40, 50, 60])


def test_meshes_are_read_beside_the_file_and_by_package(folder):
    (folder / "meshes").mkdir()
    trimesh.creation.box(extents=(0.1, 0.2, 0.3)).export(folder / "meshes" / "a.stl")
    head = '<compiler meshdir="meshes"/><asset><mesh name="m" file="a.stl" scale="2 2 2"/></asset>'
    arm = read_robot(written(folder, mjcf('<geom type="mesh" mesh="m"/>', head))).arm
    assert len(arm.links[6].shapes[1].faces) == 12
    assert sorted(np.ptp(arm.links[6].shapes[1].vertices_shape, axis=0)) == pytest.approx([0.2, 0.4, 0.6], abs=1e-6)
    told = TOLD.replace("arm.xml", "arm.urdf").replace("tip", "tool0")
    visual = '<geometry><mesh filename="package://robot_description/meshes/a.stl"/></geometry>'
    arm = read_robot(written(folder, urdf(visual), told, "arm.urdf")).arm
    assert [len(link.shapes) for link in arm.links] == [0, 1, 1, 1, 1, 1, 1]


def test_what_moves_nothing_is_left_out(folder):
    head = (
        '<option timestep="0.001"/><asset><texture type="skybox" builtin="gradient" width="9" height="9"/>'
        '<texture name="t" file="../../etc/passwd"/><material name="x" texture="t" rgba="1 0 0 1"/></asset>'
        '<actuator><position joint="j1" kp="5"/></actuator><keyframe><key qpos="0 0 0 0 0 0"/></keyframe>'
    )
    arm = read_robot(written(folder, mjcf('<geom size="0.02" material="x"/>', head))).arm
    assert arm.links[6].shapes[1].rgba == pytest.approx((1, 0, 0, 1))


def test_joints_beside_the_chain_are_frozen_and_said(folder):
    finger = (
        '<body pos="0.1 0 0"><joint name="finger" type="slide" axis="0 1 0" range="0 0.1"/><geom size="0.01"/></body>'
    )
    assert read_robot(written(folder, mjcf(finger))).remarks == ("joints beside the chain are frozen as drawn: finger",)
    free = mjcf().replace(' range="-170 170"', "", 1)
    assert "joint j1 has no limits" in read_robot(written(folder, free)).remarks[0]


MESH = '<asset><mesh name="m" file="{}"/></asset>'
OUTSIDE = [
    "../../etc/passwd",
    "/etc/passwd",
    "../a.stl",
    "link.stl",
    "linked/a.stl",
    "~/a.stl",
    "file:///etc/passwd",
    "a\\..\\..\\a.stl",
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_meshes_outside_the_folder_are_refused_unopened(folder, name):
    outside = folder.parent / "outside"
    outside.mkdir()
    for place in (folder.parent / "a.stl", outside / "a.stl"):
        trimesh.creation.box().export(place)
    (folder / "link.stl").symlink_to(folder.parent / "a.stl")
    (folder / "linked").symlink_to(outside)
    refused(written(folder, mjcf(head=MESH.format(name))), "<mesh> m: file" if name != "/etc/passwd" else "file")
    told = TOLD.replace("arm.xml", "arm.urdf").replace("tip", "tool0")
    visual = f'<geometry><mesh filename="{name}"/></geometry>'
    refused(written(folder, urdf(visual), told, "arm.urdf"), "l1", "filename")
    refused(written(folder, mjcf(), f"file: '{name}'\nflange: tip\nhome_deg: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n"), "file")
    for prefix in ("..", "/etc", "../outside", "linked"):
        head = f'<compiler meshdir="{prefix}"/>' + MESH.format("a.stl")
        refused(written(folder, mjcf(head=head)), "file")


def laughs(levels=12):
    entities = '<!ENTITY l0 "lol">' + "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(levels))
    return f"<!DOCTYPE mujoco [{entities}]><mujoco><custom><text name='a' data='&l{levels};'/></custom></mujoco>"


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (laughs(), ["document type"]),
        ('<!DOCTYPE mujoco [<!ENTITY x SYSTEM "file:///etc/passwd">]><mujoco model="&x;"/>', ["document type"]),
        ('<!DOCTYPE mujoco SYSTEM "http://127.0.0.1/x.dtd"><mujoco/>', ["document type"]),
        (laughs().encode("utf-16"), ["UTF-8"]),
        ("", ["empty"]),
        ("not xml", ["not XML"]),
        (mjcf()[:-40], ["not XML"]),
        ("<html/>", ["<html>", "expected mujoco"]),
        ("<mujoco/>", ["flange"]),
        ("<a>" * 4000, ["not XML"]),
        ("<mujoco>" + "<default>" * 3000 + "</default>" * 3000 + "</mujoco>", ["levels"]),
        ("<mujoco>" + "<a/>" * 20_000 + "</mujoco>", ["elements"]),
        (" " * 3_000_000, ["3000000 bytes"]),
        (mjcf(head='<include file="../../etc/passwd"/>'), ["<include>", "not included"]),
        (mjcf('<include file="arm.xml"/>'), ["<include>"]),
        (mjcf('<replicate count="4000000"><geom size="1"/></replicate>'), ["<replicate>"]),
        (mjcf('<composite type="grid" count="9999 9999 1"/>'), ["<composite>"]),
        (mjcf('<flexcomp name="f" type="grid" count="999 999 999"/>'), ["<flexcomp>"]),
        (mjcf(head='<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>'), ["<hfield>"]),
        (mjcf('<geom type="hfield" hfield="h"/>'), ["height"]),
        (mjcf(head='<asset><mesh name="m" builtin="sphere" params="9000"/></asset>'), ["builtin"]),
        (mjcf(head='<asset><model name="m" file="../../etc/passwd"/></asset>'), ["<model>"]),
        (mjcf(head='<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'), ["<extension>"]),
        (mjcf(head='<equality><connect body1="b2" body2="b4" anchor="0 0 0"/></equality>'), ["closed chains"]),
        (mjcf("<freejoint/>"), ["<freejoint>"]),
        (mjcf('<attach model="m" body="b" prefix="p"/>'), ["<attach>"]),
        *(
            (mjcf(f'<geom size="0.1" pos="{x} 0 0"/>'), ["<geom>", "pos", x])
            for x in ("inf", "-inf", "nan", "1e300", "1e999", "0x1p900", "INF")
        ),
        (mjcf('<geom size="1e9"/>'), ["size", "1e9"]),
        (mjcf('<geom size="0.1" quat="1e300 0 0 0"/>'), ["quat"]),
        (mjcf('<inertial pos="0 0 0" mass="nan" diaginertia="1 1 1"/>'), ["mass"]),
        (mjcf('<geom size="0.1" colour="red"/>'), ["MuJoCo cannot read it", "colour"]),
        (mjcf("<body><geom size='0.01'/></body>" * 300), ["306 bodies"]),
        (mjcf("<geom size='0.01'/>" * 3000), ["geoms"]),
        (mjcf(axes=AXES[:5]), ["5 hinges", "expected 6"]),
        (mjcf("<joint name='j7' axis='0 0 1' range='-1 1'/>"), ["7 hinges", "expected 6"]),
        (mjcf().replace("<joint ", "<joint type='slide' ", 1), ["j1", "no hinge"]),
        (mjcf().replace(' range="-170 170"', "", 1).replace("<joint ", "<joint type='ball' ", 1), ["no hinge"]),
        (mjcf(deepest=""), ["flange", "b6"]),
        (b"\x00" * 100, ["not XML"]),
        (b"PK\x03\x04" + b"x" * 100, ["zip"]),
    ],
)
def test_a_hostile_model_is_refused(folder, model, words):
    refused(written(folder, model), *words)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        (urdf(extra='<xacro:include xmlns:xacro="http://www.ros.org/wiki/xacro" filename="../../x"/>'), ["xacro"]),
        (urdf(extra='<include filename="/etc/passwd"/>'), ["<include>"]),
        (urdf().replace('velocity="3"', 'velocity="1e400"'), ["velocity"]),
        (urdf().replace("</joint>", '<mimic joint="j1"/></joint>', 1), ["<mimic>", "coupled"]),
        (urdf('<geometry><mesh filename="a.dae"/></geometry>'), ["Collada"]),
        (urdf(kind="prismatic"), ["no hinge"]),
        (urdf().replace("tool0", "elsewhere"), ["flange", "elsewhere"]),
        (urdf('<geometry><box size="0.1 inf 0.1"/></geometry>'), ["size"]),
    ],
)
def test_a_hostile_urdf_is_refused(folder, model, words):
    told = TOLD.replace("arm.xml", "arm.urdf").replace("tip", "tool0")
    refused(written(folder, model, told, "arm.urdf"), *words)


def test_a_broken_mesh_is_refused_by_name(folder):
    (folder / "a.stl").write_bytes(trimesh.creation.box().export(file_type="stl")[:200])
    refused(written(folder, mjcf(head=MESH.format("a.stl"))), "<mesh> m: file: a.stl", "truncated")
    (folder / "a.msh").write_bytes(bytes(100))
    refused(written(folder, mjcf(head=MESH.format("a.msh"))), "expected a mesh")


@pytest.mark.parametrize(
    ("told", "words"),
    [
        ("flange: tip\nhome_deg: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n", ["file: found nothing"]),
        ("file: arm.xml\nflange: tip\n", ["home_deg: found nothing"]),
        (TOLD + "jionts: []\n", ["jionts: no such field", "joints"]),
        (TOLD.replace("30.0", "300.0"), ["home_deg", "joint 5", "-170 to 170"]),
        (TOLD.replace("30.0, 0.0]", "30.0]"), ["home_deg"]),
        (TOLD + "joints: [j1, j2, j3, j4, j6, j5]\n", ["joints", "j1, j2, j3, j4, j5, j6"]),
        (TOLD + "speeds_deg_s: [1.0, 1.0, 1.0, 1.0, 1.0, 0.0]\n", ["speeds_deg_s"]),
        (
            TOLD + "limits_deg: [[10.0, -10.0], [-9.0, 9.0], [-9.0, 9.0], [-9.0, 9.0], [-9.0, 9.0], [-9.0, 9.0]]\n",
            ["limits_deg"],
        ),
        (TOLD.replace("tip", "top"), ["flange", "'top'", "tip"]),
        (TOLD.replace("arm.xml", "arm.mjb"), ["arm.mjb"]),
        (TOLD.replace("arm.xml", "robot.yaml"), ["not XML"]),
    ],
)
def test_a_wrong_robot_file_is_refused_by_field(folder, told, words):
    refused(written(folder, mjcf(), told), *words)


def test_nothing_outside_the_folder_is_opened_and_nothing_is_written(folder):
    """Python's audit events see every file that is opened by it; MuJoCo gets all it needs from memory."""
    (folder / "link.stl").symlink_to("/etc/passwd")
    hostile = [
        mjcf(head=MESH.format("../../etc/passwd")),
        mjcf(head=MESH.format("link.stl")),
        mjcf(head='<include file="/etc/passwd"/>'),
        '<!DOCTYPE mujoco [<!ENTITY x SYSTEM "file:///etc/passwd">]><mujoco model="&x;"/>',
        mjcf(head='<asset><texture name="t" file="/etc/passwd" type="2d"/></asset>'),
        mjcf('<geom size="-1"/>'),
    ]
    for k, model in enumerate(hostile):
        (folder / f"arm{k}.xml").write_text(model)
        (folder / f"robot{k}.yaml").write_text(TOLD.replace("arm.xml", f"arm{k}.xml"))
    before = sorted(os.listdir(folder))
    script = f"""
        import sys
        from pathlib import Path
        from weldcell.cell.errors import BadInput
        from weldcell.scenarios.user_cell.robot_file import read_robot
        from weldcell.scenarios.user_cell import mesh_file
        opened = []
        sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
        for k in range({len(hostile)}):
            try:
                read_robot(Path({str(folder)!r}) / f"robot{{k}}.yaml")
            except BadInput:
                pass
        print([name for name in opened if name.startswith("/etc")])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, cwd=folder, check=False
    )
    assert done.stdout.strip() == "[]", done.stderr
    assert sorted(os.listdir(folder)) == before  # no MUJOCO_LOG.TXT either


@pytest.mark.parametrize("seed", range(2))
def test_damaged_models_bring_no_more_than_a_refusal(folder, seed):
    rng = np.random.default_rng(seed)
    whole = mjcf('<geom type="box" size="0.1 0.1 0.1" pos="0 0 0.1" euler="0 10 0" rgba="1 0 0 1"/>').encode()
    for _ in range(40):
        content = bytearray(whole)
        for place in rng.integers(0, len(content), 2):
            content[place] = rng.choice(list(b'0123456789.-e<>/"= abcxyz'))
        path = written(folder, bytes(content))
        with contextlib.suppress(BadInput):
            arm = read_robot(path).arm
            assert np.all(np.isfinite(arm.anchors_base))

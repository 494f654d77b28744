"""The user's own robot: a small YAML file beside an MJCF or URDF of any six-axis arm."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np
from annotated_types import Ge, Gt, Le
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.cell.frames import rigid_from
from weldcell.models.own_arm import JOINTS, OwnArm, arm_of_model
from weldcell.scenarios.settings import check_section
from weldcell.scenarios.user_cell.arm_xml import PlainModel, plain_model
from weldcell.scenarios.user_cell.jail import named_file, shown
from weldcell.scenarios.yaml_file import read_yaml

_Angle = Annotated[float, Ge(-540.0), Le(540.0)]
_Speed = Annotated[float, Gt(0.0), Le(5000.0)]
_Length = Annotated[float, Ge(-10_000.0), Le(10_000.0)]
_Names = tuple[str, str, str, str, str, str]
_Angles = tuple[_Angle, _Angle, _Angle, _Angle, _Angle, _Angle]
_Speeds = tuple[_Speed, _Speed, _Speed, _Speed, _Speed, _Speed]
_Limit = tuple[_Angle, _Angle]
_Limits = tuple[_Limit, _Limit, _Limit, _Limit, _Limit, _Limit]
_Place = tuple[_Length, _Length, _Length]

_USUAL_SPEED_DEG_S = 180.0
_ENDLESS_DEG = 360.0  # of a joint without limits: cables set some


@dataclass(frozen=True, kw_only=True)
class RobotFile:
    """What the YAML file of a robot holds. Names of files are relative to its folder, and stay in it."""

    file: str
    """The arm as MJCF (.xml) or URDF (.urdf), in one file; meshes as .stl .obj .ply .glb."""
    flange: str
    """Name of the site, body or link whose frame is the flange's."""
    home_deg: _Angles
    """A posture with the tool above the table, clear of everything, in the arm's usual configuration."""
    joints: _Names | None = None
    """Names of the six joints from the base on; left out, those between base and flange."""
    limits_deg: _Limits | None = None
    """Lower and upper limit of each joint; left out, the model's (360 either way where it has none)."""
    speeds_deg_s: _Speeds | None = None
    """Largest speed of each joint; left out, the model's (180 where it has none)."""
    mount_mm: _Place = (0.0, 0.0, 0.0)
    """Where torch and sensor are mounted, in the frame named by `flange`."""
    mount_deg: tuple[_Angle, _Angle, _Angle] = (0.0, 0.0, 0.0)
    """How the mount is turned in that frame, about its moving x, y and z: its z must point out of the flange."""
    base_mm: _Place = (0.0, 0.0, 0.0)
    """Where the model's origin stands in the cell: on a pedestal, or further from the table."""
    base_yaw_deg: _Angle = 0.0
    """How the model is turned about the vertical."""


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnRobot:
    """A user's arm, ready for the cell."""

    arm: OwnArm
    remarks: tuple[str, ...]
    """What was odd about it and what was done, in words."""


def read_robot(path: Path) -> OwnRobot:
    """The robot of a YAML file; raises BadInput that names file and field."""
    told: RobotFile = check_section(RobotFile, read_yaml(path), shown(path), between=": ")
    model_path = named_file(path.parent, told.file, f"{shown(path)}: file")
    where = f"{shown(path)}: file: {shown(told.file)}"
    plain = plain_model(model_path, path.parent, where)
    model = _compiled(plain, where)
    body, T_body_frame = _flange(model, told.flange, f"{shown(path)}: flange")
    joints = _chain(model, body, told, path, where)
    limits_deg, limit_remarks = _limits_deg(model, joints, told)
    names = [model.joint(joint).name for joint in joints]
    mount = rigid_from(Rotation.from_euler("XYZ", told.mount_deg, degrees=True), 1e-3 * np.array(told.mount_mm))
    try:
        arm = arm_of_model(
            model,
            joints,
            body,
            T_body_frame * mount,
            name=Path(told.file).stem,
            limits_rad=np.radians(limits_deg),
            speeds_rad_s=_speeds_rad_s(plain, names, told),
            home_rad=np.radians(told.home_deg),
            T_base_world=rigid_from(
                Rotation.from_euler("z", told.base_yaw_deg, degrees=True), 1e-3 * np.array(told.base_mm)
            ),
        )
    except BadGeometry as refusal:
        field = next((name for name in ("home", "limits", "speeds") if str(refusal).startswith(name)), None)
        raise BadInput(
            f"{shown(path)}: {field}_deg{str(refusal)[len(field) :]}" if field else f"{where}: {refusal}"
        ) from refusal
    return OwnRobot(arm=arm, remarks=(*plain.remarks, *limit_remarks, *_frozen(model, joints)))


def _compiled(plain: PlainModel, where: str) -> mujoco.MjModel:
    try:
        return mujoco.MjModel.from_xml_string(plain.text, dict(plain.meshes))
    except (ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise BadInput(f"{where}: MuJoCo cannot read it: {reason}") from None


def _flange(model: mujoco.MjModel, name: str, where: str) -> tuple[int, RigidTransform]:
    """The body that carries the frame of that name, and the frame in it."""
    sites = [model.site(k).name for k in range(model.nsite)]
    bodies = [model.body(k).name for k in range(1, model.nbody)]
    if name in sites:
        k = sites.index(name)
        turn = Rotation.from_quat(model.site_quat[k], scalar_first=True)
        return int(model.site_bodyid[k]), rigid_from(turn, model.site_pos[k].copy())
    if name in bodies:
        return bodies.index(name) + 1, RigidTransform.identity()
    available = ", ".join(shown(x) for x in [*sites, *bodies] if x)[:300]
    raise BadInput(f"{where}: found {shown(name)!r}, expected a site or body of the model: {available}")


def _chain(model: mujoco.MjModel, body: int, told: RobotFile, path: Path, where: str) -> list[int]:
    """The six hinges between base and flange, checked against the names given."""
    chain: list[int] = []
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        chain = [*range(first, first + count), *chain] if count else chain
        body = int(model.body_parentid[body])
    names = [model.joint(k).name or f"(joint {k})" for k in chain]
    others = [n for n, k in zip(names, chain, strict=True) if model.jnt_type[k] != mujoco.mjtJoint.mjJNT_HINGE]
    if others:
        raise BadInput(
            f"{where}: found the joint {shown(others[0])} between base and flange, which is no hinge, expected "
            f"{JOINTS} hinges"
        )
    if len(chain) != JOINTS:
        listed = ", ".join(shown(name) for name in names)[:200]
        raise BadInput(
            f"{where}: found {len(chain)} hinges between base and the flange {shown(told.flange)!r} ({listed}), "
            f"expected {JOINTS}"
        )
    if told.joints is not None and list(told.joints) != names:
        raise BadInput(
            f"{shown(path)}: joints: found {', '.join(map(shown, told.joints))[:200]}, expected from the base on: "
            f"{', '.join(map(shown, names))[:200]}"
        )
    return chain


def _limits_deg(
    model: mujoco.MjModel, joints: list[int], told: RobotFile
) -> tuple[Float[np.ndarray, "6 2"], list[str]]:
    if told.limits_deg is not None:
        return np.array(told.limits_deg), []
    limits_deg, remarks = np.degrees(model.jnt_range[joints]), []
    for k, joint in enumerate(joints):
        if not model.jnt_limited[joint]:
            limits_deg[k] = (-_ENDLESS_DEG, _ENDLESS_DEG)
            name = shown(model.joint(joint).name)
            remarks.append(f"joint {name} has no limits: taken as {_ENDLESS_DEG:.0f} deg either way; see limits_deg")
    return limits_deg, remarks


def _speeds_rad_s(plain: PlainModel, names: list[str], told: RobotFile) -> Float[np.ndarray, "6"]:
    if told.speeds_deg_s is not None:
        return np.radians(told.speeds_deg_s)
    usual = float(np.radians(_USUAL_SPEED_DEG_S))
    speeds = [plain.speeds_rad_s.get(name, 0.0) for name in names]
    return np.array([speed if speed > 0 else usual for speed in speeds])


def _frozen(model: mujoco.MjModel, joints: list[int]) -> list[str]:
    others = [shown(model.joint(k).name) for k in range(model.njnt) if k not in joints]
    return [f"joints beside the chain are frozen as drawn: {', '.join(others)[:200]}"] if others else []

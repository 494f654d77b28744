"""The scene as a compiled MuJoCo model: workshop, arm with torch and sensor, and the parts that can be placed."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import CellConfig, SensorConfig
from weldcell.cell.frames import translation
from weldcell.cell.world.cell import CLEARANCE_M, Cell
from weldcell.cell.world.controller import Controller
from weldcell.cell.world.robot_error import JOINTS, RobotError, exact_robot
from weldcell.cell.world.seam_part import seam_part
from weldcell.models.arm import KR5_ARC, build_arm
from weldcell.models.board import Board
from weldcell.models.boss import boss
from weldcell.models.own_arm import OwnArm, build_own_arm
from weldcell.models.room import BENCH_TOP_M, build_room
from weldcell.models.sensor_head import HeadDesign, build_sensor_head
from weldcell.models.sphere import sphere_stand
from weldcell.models.torch import T_FLANGE_TORCH, build_torch
from weldcell.models.workpiece import Workpiece

HOME_RAD = np.radians([11.7, -75.7, 76.3, -34.4, 96.1, -80.0])
"""A posture with the tool above the table, clear of everything: the arm's usual configuration."""

_POST_M = 0.30  # from the sphere's centre to its stand's foot, which is clamped under the table's top
SHELF = {
    "sphere": translation([0.45, 1.00, BENCH_TOP_M + _POST_M]),
    "plate": translation([0.12, 1.00, BENCH_TOP_M]),
    "boss": translation([0.80, 1.00, BENCH_TOP_M]),
}
"""Where parts stand while they are not in use."""

AWAY = translation([-1.0, -1.6, 0.1])
"""Where boards lie while they are not in use."""

_BODIES = {"sphere": "stand/sphere_stand", "boss": "boss"}


@dataclass(frozen=True, kw_only=True)
class Parts:
    """What can stand on the table, with exact features."""

    plate: Workpiece
    boss: Workpiece
    sphere_radius_m: float
    tip_radius_m: float


def build_parts(config: CellConfig, own_part: Workpiece | None = None) -> Parts:
    """The parts that a configuration asks for; `own_part` stands in the place of the plate."""
    block = config.boss
    return Parts(
        plate=own_part or seam_part(config.seam),
        boss=boss(
            slant_edge_m=1e-3 * block.slant_edge_mm,
            slope_rad=float(np.radians(block.slope_deg)),
            top_m=1e-3 * block.top_mm,
        ).with_surface(block.material, block.texture),
        sphere_radius_m=0.5e-3 * config.calibration.sphere_diameter_mm,
        tip_radius_m=1e-3 * config.calibration.tip_radius_mm,
    )


def head_design(config: SensorConfig) -> HeadDesign:
    """The head that holds a configuration's camera and laser where they belong."""
    stand_off_m, triangulation_rad = 1e-3 * config.working_distance_mm, float(np.radians(config.triangulation_deg))
    return HeadDesign(
        stand_off_m=stand_off_m,
        triangulation_rad=triangulation_rad,
        laser_range_m=1e-3 * config.laser_range_mm or stand_off_m * float(np.cos(triangulation_rad)),
        stripe_along=config.stripe_along,
        look_ahead_m=1e-3 * config.look_ahead_mm,
        below_tip_m=1e-3 * config.below_tip_mm,
    )


def build_cell(
    parts: Parts,
    head: HeadDesign,
    error: RobotError | None,
    boards: Sequence[Board] = (),
    own_arm: OwnArm | None = None,
) -> Cell:
    """The cell with an actual robot; without error the one that the controller knows, which keeps its clearance.

    `boards` lie on the floor behind the arm until they are placed. `own_arm` stands in the place of the cell's arm.
    """
    actual = exact_robot() if error is None else error
    spec = build_room()
    arm = build_arm(KR5_ARC) if own_arm is None else build_own_arm(own_arm)
    _misbuild(arm, actual)
    spec.attach(arm, prefix="arm/", frame=spec.worldbody.add_frame())
    for prefix, tool in (
        ("torch/", build_torch(translation(actual.tip_flange_m) * T_FLANGE_TORCH, parts.tip_radius_m)),
        ("sensor/", build_sensor_head(head, head.T_flange_camera * actual.T_camera_mount)),
    ):
        spec.attach(tool, prefix=prefix, site=spec.site("arm/flange"))
    parts.plate.add_to(spec, SHELF["plate"])
    parts.boss.add_to(spec, SHELF["boss"])
    stand = sphere_stand(parts.sphere_radius_m, centre_height_m=_POST_M, crank_m=0.0)
    spec.attach(stand, prefix="stand/", frame=spec.worldbody.add_frame(pos=SHELF["sphere"].translation))
    bodies = _BODIES | {"plate": parts.plate.name}
    for name in bodies.values():
        spec.body(name).mocap = True
    for board in boards:
        board.add_to(spec, AWAY)
    model = spec.compile()
    if error is None:
        model.geom_margin[model.geom_group > 0] = CLEARANCE_M
    return Cell(model, actual, bodies | {board.name: board.name for board in boards})


def build_controller(known_cell: Cell, own_arm: OwnArm | None = None) -> Controller:
    """The controller of the arm that the known cell holds."""
    speeds_rad_s = np.array(KR5_ARC.speeds_rad_s) if own_arm is None else own_arm.speeds_rad_s
    return Controller.from_model(known_cell.model, speeds_rad_s)


def _misbuild(arm: mujoco.MjSpec, error: RobotError) -> None:
    """Moves and turns each link of the arm by the robot's geometric errors."""
    for k in range(JOINTS):
        body = arm.body(f"link_{k + 1}")
        body.pos = body.pos + error.link_m[k]
        turned = Rotation.from_quat(body.quat, scalar_first=True) * Rotation.from_rotvec(error.twist_rad[k])
        body.quat = turned.as_quat(scalar_first=True)

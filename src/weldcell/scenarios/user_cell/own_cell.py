"""The user's own part and arm, as far as a configuration names them."""

from dataclasses import dataclass
from pathlib import Path

from weldcell.cell.configuration import CellConfig
from weldcell.cell.errors import BadInput
from weldcell.models.own_arm import OwnArm
from weldcell.models.workpiece import Workpiece
from weldcell.scenarios.user_cell.part_file import read_part
from weldcell.scenarios.user_cell.robot_file import read_robot


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnCell:
    """What the user brings; None is the cell's own."""

    part: Workpiece | None = None
    arm: OwnArm | None = None
    remarks: tuple[str, ...] = ()
    """What was odd about it and what was done, in words."""


def own_cell(config: CellConfig) -> OwnCell:
    """The part and the arm of the files that a configuration names."""
    part, arm, remarks = None, None, []
    if config.seam.part_file:
        path = Path(config.seam.part_file)
        read = read_part(path)
        part, remarks = read.workpiece, [f"{path.name}: {remark}" for remark in read.remarks]
        if part.seam_part is None:
            raise BadInput(f"{path}: found no seam, expected seam_file or seam_near_mm")
    if config.arm_file:
        path = Path(config.arm_file)
        robot = read_robot(path)
        arm = robot.arm
        remarks += [f"{path.name}: {remark}" for remark in robot.remarks]
    return OwnCell(part=part, arm=arm, remarks=tuple(remarks))

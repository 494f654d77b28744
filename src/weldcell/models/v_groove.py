"""A plate with a V-groove along an S-shaped path, and the exact lines of the groove."""

from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSize
from weldcell.models.seam_path import SPath
from weldcell.models.swept_joint import joint_part
from weldcell.models.workpiece import Workpiece


def v_groove_plate(
    length_m: float,
    width_m: float,
    thickness_m: float,
    groove_angle_rad: float,
    root_gap_m: float,
    root_face_m: float,
    amplitude_m: float,
    spacing_m: float = 0.5e-3,
) -> Workpiece:
    """The plate, one solid when `root_gap_m` is 0, else two; `seam_part` has `left`, `root` and `right`.

    `left` and `right` are the groove's top edges, `root` the V's bottom (with a gap: midway between its two edges).
    The path is y(x) = amplitude sin(2 pi x / length). `spacing_m` is the largest spacing of the mesh's cross-sections.
    """
    size = JointSize(
        thickness_m=thickness_m, groove_angle_rad=groove_angle_rad, root_gap_m=root_gap_m, root_face_m=root_face_m
    )
    path = SPath(length_m=length_m, amplitude_m=amplitude_m)
    return joint_part(joint_section("v", size), path, width_m, name="v_groove_plate", spacing_m=spacing_m)

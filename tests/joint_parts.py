"""Parts with every kind of joint, of common sizes."""

from dataclasses import replace

import numpy as np

from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointKind, JointSize
from weldcell.models.seam_path import PlanePath, SPath, StraightPath
from weldcell.models.swept_joint import joint_part
from weldcell.models.workpiece import Workpiece

KINDS: tuple[JointKind, ...] = ("butt", "v", "v-gap", "bevel", "u", "j", "lap", "fillet", "corner")
_PART_M, _WIDTH_M = 0.20, 0.14


def random_part(kind: JointKind, rng: np.random.Generator) -> Workpiece:
    """A part with this kind of joint, straight or S-shaped, of a common size."""
    path: PlanePath = StraightPath(length_m=_PART_M)
    if rng.random() < 0.5:
        path = SPath(length_m=_PART_M, amplitude_m=rng.uniform(0.004, 0.008))
    return joint_part(joint_section(kind, _size(kind, rng)), path, _WIDTH_M)


def _size(kind: JointKind, rng: np.random.Generator) -> JointSize:
    """A common size of the kind (ISO 9692-1 gives the grooves' ranges)."""
    thickness_m, gap_m, deg = rng.uniform(0.008, 0.016), rng.uniform(0.0015, 0.003), np.pi / 180
    plain = JointSize(thickness_m=thickness_m, root_face_m=0.002)
    match kind:
        case "butt":
            return JointSize(thickness_m=rng.uniform(0.004, 0.01), root_gap_m=rng.uniform(0.001, 0.003))
        case "v":
            return replace(plain, groove_angle_rad=rng.uniform(45, 80) * deg)
        case "v-gap":
            return replace(plain, groove_angle_rad=rng.uniform(45, 80) * deg, root_gap_m=gap_m)
        case "bevel":
            return replace(plain, groove_angle_rad=rng.uniform(35, 55) * deg, root_gap_m=gap_m)
        case "u" | "j":
            angle_rad, radius_m = rng.uniform(16, 30) * deg, rng.uniform(0.004, 0.006)
            return JointSize(
                thickness_m=rng.uniform(0.014, 0.02),
                groove_angle_rad=angle_rad,
                root_face_m=0.003,
                root_radius_m=radius_m,
                root_gap_m=gap_m if rng.random() < 0.5 else 0.0,
            )
        case "lap":
            return JointSize(thickness_m=0.008, upper_thickness_m=rng.uniform(0.002, 0.008))
        case "fillet":
            return JointSize(thickness_m=0.01, upper_thickness_m=0.008, rise_m=0.05)
        case "corner":
            return JointSize(
                thickness_m=rng.uniform(0.006, 0.01), groove_angle_rad=90 * deg, root_face_m=0.001, rise_m=0.04
            )

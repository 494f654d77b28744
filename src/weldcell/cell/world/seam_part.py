"""The workpiece that a configuration asks for: a joint of these sizes along this path."""

import numpy as np

from weldcell.cell.configuration import SeamConfig
from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.models.curved_surface import CurvedSurface
from weldcell.models.joint_kinds import joint_section
from weldcell.models.joint_section import JointSection, JointSize
from weldcell.models.saddle_joint import SaddleSize, saddle_part
from weldcell.models.seam_path import ArcPath, PlanePath, SPath, StraightPath
from weldcell.models.surface_joint import surface_joint_part
from weldcell.models.swept_joint import TackWelds, joint_part, joint_seam
from weldcell.models.workpiece import Workpiece

_NAMES = {"v": "v_groove_plate", "v-gap": "v_groove_plate"}
_SPACING_M = 0.5e-3  # of the cross-sections: slivers as long as a plate's side would slow its rays
_BELOW_SURFACE_M = 0.017  # of a free-form block, below the plate that the joint speaks of, in the surface's hollows
_SURFACE_ACROSS_M, _SURFACE_TWIST = (
    0.25,
    0.3,
)  # P1's part is domed and twisted a little; chosen, for it gives no figures
_SADDLE_WALLS = (0.107, 0.171)  # thickness of run and branch by their radii: common pipes


def seam_part(seam: SeamConfig) -> Workpiece:
    """The workpiece with its exact seam; raises BadInput if there is no such part."""
    try:
        part = _part(seam)
    except BadGeometry as refusal:
        raise BadInput(f"seam: {refusal}") from refusal
    return part.with_surface(seam.material, seam.texture, seam.tack_spots)


def _part(seam: SeamConfig) -> Workpiece:
    name = _NAMES.get(seam.joint, f"{seam.joint}_joint")
    if seam.path == "saddle":
        if seam.joint != "fillet":
            raise BadGeometry(f"joint is {seam.joint}, expected fillet: a saddle's pipes meet in a fillet")
        start_rad, end_rad = np.radians(seam.saddle_deg)
        return saddle_part(_saddle(seam), start_rad, end_rad, _saddle_tacks(seam), name)
    if seam.path == "surface":
        plan = SPath(length_m=1e-3 * seam.length_mm, amplitude_m=1e-3 * seam.amplitude_mm)
        section = _section(seam, seam.root_gap_mm)
        return surface_joint_part(
            section, plan, _surface(seam), 1e-3 * seam.width_mm, _tacks(seam, section, plan), name
        )
    path, section = _plane_path(seam), _section(seam, seam.root_gap_mm)
    end = None if seam.root_gap_end_mm < 0 else _section(seam, seam.root_gap_end_mm, may_close=True)
    tacks = _tacks(seam, section, path)
    return joint_part(section, path, 1e-3 * seam.width_mm, tacks, name, _SPACING_M, end, seam.root_gap_share)


def _section(seam: SeamConfig, root_gap_mm: float, may_close: bool = False) -> JointSection:
    size = JointSize(
        thickness_m=1e-3 * seam.thickness_mm,
        groove_angle_rad=float(np.radians(seam.groove_angle_deg)),
        root_gap_m=1e-3 * root_gap_mm,
        root_face_m=1e-3 * seam.root_face_mm,
        root_radius_m=1e-3 * seam.root_radius_mm,
        mismatch_m=1e-3 * seam.mismatch_mm,
        upper_thickness_m=1e-3 * seam.upper_thickness_mm,
        rise_m=1e-3 * seam.rise_mm,
        corner_angle_rad=float(np.radians(seam.corner_angle_deg)),
    )
    return joint_section(seam.joint, size, may_close)


def _plane_path(seam: SeamConfig) -> PlanePath:
    length_m = 1e-3 * seam.length_mm
    if seam.path == "straight":
        return StraightPath(length_m=length_m)
    if seam.path == "arc":
        return ArcPath(length_m=length_m, radius_m=1e-3 * seam.radius_mm)
    return SPath(length_m=length_m, amplitude_m=1e-3 * seam.amplitude_mm)


def _surface(seam: SeamConfig) -> CurvedSurface:
    return CurvedSurface(
        height_m=1e-3 * (seam.thickness_mm + seam.surface_wave_mm) + _BELOW_SURFACE_M,
        wave_m=1e-3 * seam.surface_wave_mm,
        wavelength_m=1.1e-3 * seam.length_mm,
        across_radius_m=_SURFACE_ACROSS_M,
        twist=_SURFACE_TWIST,
    )


def _saddle(seam: SeamConfig) -> SaddleSize:
    run_m, branch_m = 1e-3 * seam.run_radius_mm, 1e-3 * seam.branch_radius_mm
    return SaddleSize(
        run_radius_m=run_m,
        branch_radius_m=branch_m,
        run_wall_m=_SADDLE_WALLS[0] * run_m,
        branch_wall_m=_SADDLE_WALLS[1] * branch_m,
        run_length_m=1e-3 * seam.length_mm,
        branch_height_m=1e-3 * seam.rise_mm,
    )


def _tacks(seam: SeamConfig, section: JointSection, path: PlanePath) -> TackWelds | None:
    """Tack welds evenly along the seam, half a spacing from its ends."""
    return _evenly(seam, float(joint_seam(section, path).arc_length_m[-1])) if seam.tack_welds else None


def _saddle_tacks(seam: SeamConfig) -> TackWelds | None:
    if not seam.tack_welds:
        return None
    start_rad, end_rad = np.radians(seam.saddle_deg)
    bare = saddle_part(_saddle(seam), start_rad, end_rad).seam_part
    assert bare is not None
    return _evenly(seam, float(bare.arc_length_m[-1]))


def _evenly(seam: SeamConfig, length_m: float) -> TackWelds:
    stations_m = (np.arange(seam.tack_welds) + 0.5) / seam.tack_welds * length_m
    return TackWelds(stations_m=tuple(stations_m.tolist()), length_m=1e-3 * seam.tack_length_mm)

"""The workpiece with its seam, its scan, and each joint's sizes."""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from weldcell.cell.configuration.bounds import Finite, Point, Positive, Unsigned
from weldcell.cell.configuration.surface import MaterialName, TextureName

JointName = Literal["butt", "v", "v-gap", "bevel", "u", "j", "lap", "fillet", "corner"]
PathName = Literal["straight", "arc", "s", "surface", "saddle"]


@dataclass(frozen=True, kw_only=True)
class SeamConfig:
    """The workpiece with its seam, and its scan; `SEAM_PRESETS` holds the sizes that are each joint's defaults."""

    joint: JointName = "v"
    """Joint; the other fields' defaults are sizes that suit it."""
    path: PathName = "s"
    """Course of the seam; `surface` is an S on a free-form surface (grooves), `saddle` a branch pipe on a run pipe."""
    length_mm: Positive = 300.0
    """Length of the part along the seam."""
    width_mm: Positive = 160.0
    """Width of the part across the seam."""
    thickness_mm: Positive = 60.0
    """Plate thickness; of a lap and a fillet that of the lower plate."""
    groove_angle_deg: Annotated[float, Ge(0), Le(120)] = 45.0
    """Groove angle between the two walls."""
    root_gap_mm: Unsigned = 0.0
    """Gap at the root; of a lap and a fillet between the plates."""
    root_gap_end_mm: Annotated[float, Ge(-1), Le(1e6)] = -1.0
    """Gap at the seam's end if it changes along the seam (0: it closes); -1 is the same all along."""
    root_gap_share: Annotated[float, Gt(0), Le(1)] = 1.0
    """Share of the seam over which the gap changes evenly; from there on it stays."""
    root_face_mm: Unsigned = 4.0
    """Height of the land below the root."""
    root_radius_mm: Unsigned = 0.0
    """Radius of the rounded bottom of a U or J."""
    mismatch_mm: Finite = 0.0
    """How much higher the left member of a groove stands."""
    upper_thickness_mm: Unsigned = 0.0
    """Thickness of a lap's upper plate and of a fillet's web; 0 is the lower plate's."""
    rise_mm: Positive = 50.0
    """Height of a fillet's web; length of a corner's plates along their inner sides."""
    corner_angle_deg: Annotated[float, Ge(30), Le(150)] = 90.0
    """Angle between both plates of a corner, on the inner side."""
    amplitude_mm: Unsigned = 20.0
    """How far an S-shaped path swings to either side."""
    radius_mm: Finite = 400.0
    """Radius of an arc; negative bends to the right."""
    surface_wave_mm: Unsigned = 18.0
    """How far a free-form surface swings up and down along the seam."""
    run_radius_mm: Positive = 75.0
    """Outer radius of a saddle's run pipe."""
    branch_radius_mm: Positive = 35.0
    """Outer radius of a saddle's branch pipe."""
    saddle_deg: tuple[Finite, Finite] = (200.0, 340.0)
    """Where a saddle's seam begins and ends about the branch's axis, from the run's direction counter-clockwise."""
    tack_welds: Annotated[int, Ge(0), Le(50)] = 0
    """Tack welds, evenly along the seam."""
    tack_length_mm: Positive = 15.0
    """Length of a tack weld."""
    part_file: str = ""
    """YAML file of a part of one's own, instead of all these sizes; `joint` says how its seam is found."""
    material: MaterialName = "matt-white"
    """What the part's surface is."""
    texture: TextureName = "none"
    """Pattern of the part's brightness."""
    tack_spots: Annotated[int, Ge(0), Le(100)] = 0
    """Dark heat-tinted spots along the seam, where it was tacked."""
    position_mm: Point = (930.0, 0.0, 300.0)
    """Centre of the part's underside, in the robot base, as the controller was told."""
    yaw_deg: Finite = 90.0
    """Direction of the seam and of travel, about the vertical from the base's x."""
    misplacement_mm: Unsigned = 2.0
    """How far off the part actually stands (one sigma, horizontal)."""
    misplacement_deg: Unsigned = 0.3
    """How far off the part is actually turned (one sigma)."""
    frames: Annotated[int, Ge(8), Le(100_000)] = 300
    """Pictures along the seam."""
    speed_mm_s: Positive = 20.0
    """Scan speed."""
    scan_height_mm: Annotated[float, Ge(0), Le(100)] = 20.0
    """Wire's tip above the joint's highest feature during the scan; 20 mm more where the torch would touch the part."""


SEAM_PRESETS: dict[JointName, SeamConfig] = {
    "v": SeamConfig(),
    "v-gap": SeamConfig(joint="v-gap", thickness_mm=20.0, groove_angle_deg=60.0, root_gap_mm=2.0, root_face_mm=2.0),
    "butt": SeamConfig(joint="butt", thickness_mm=8.0, root_gap_mm=1.0, root_face_mm=0.0),
    "bevel": SeamConfig(joint="bevel", thickness_mm=20.0, groove_angle_deg=45.0, root_face_mm=2.0),
    "u": SeamConfig(joint="u", thickness_mm=25.0, groove_angle_deg=20.0, root_face_mm=3.0, root_radius_mm=6.0),
    "j": SeamConfig(joint="j", thickness_mm=25.0, groove_angle_deg=20.0, root_face_mm=3.0, root_radius_mm=8.0),
    "lap": SeamConfig(joint="lap", thickness_mm=6.0, root_face_mm=0.0),
    "fillet": SeamConfig(joint="fillet", thickness_mm=10.0, root_face_mm=0.0),
    "corner": SeamConfig(joint="corner", thickness_mm=12.0, root_face_mm=2.0),
}
"""P2's plate for the V; the others in sizes that ISO 9692-1 recommends for arc welding, with plates that suit them."""

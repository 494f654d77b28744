"""The named feature points of a joint in one profile, for each kind of joint that is known."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from weldcell.cell.errors import BadInput
from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import JointFeatures, Profile
from weldcell.tracking.bevel_groove import BEVEL_NAMES, find_bevel
from weldcell.tracking.confidence import confidence
from weldcell.tracking.fillet import FILLET_NAMES, find_fillet
from weldcell.tracking.found import Found
from weldcell.tracking.lap_joint import LAP_NAMES, find_lap
from weldcell.tracking.plate_edges import BUTT_NAMES, find_butt
from weldcell.tracking.round_groove import J_NAMES, U_NAMES, find_j, find_u
from weldcell.tracking.section import section_of
from weldcell.tracking.v_groove import GAPPED_V, OUTSIDE_CORNER, V_NAMES, find_v


@dataclass(frozen=True, kw_only=True)
class JointKind:
    """How one kind of joint is found."""

    names: tuple[str, ...]
    """Its features, from left to right of the travel."""
    anchor: str
    """The feature that a tracker follows: the last frame's one gates the next."""
    find: Callable[..., Found]
    """From a section and x of the last anchor (m, laser frame; None: no last frame) to its corners."""
    kept: str = ""
    """The last frame's measure that `find` also takes, as `previous_` with this name."""


JOINT_KINDS = {
    "butt": JointKind(names=BUTT_NAMES, anchor="left", find=find_butt, kept="gap_m"),
    "v": JointKind(names=V_NAMES, anchor="root", find=find_v),
    "v-gap": JointKind(names=V_NAMES, anchor="root", find=partial(find_v, shape=GAPPED_V), kept="depth_m"),
    "bevel": JointKind(names=BEVEL_NAMES, anchor="root", find=find_bevel, kept="kept_depth_m"),
    "u": JointKind(names=U_NAMES, anchor="centre", find=find_u, kept="depth_m"),
    "j": JointKind(names=J_NAMES, anchor="root", find=find_j, kept="depth_m"),
    "lap": JointKind(names=LAP_NAMES, anchor="root", find=find_lap),
    "fillet": JointKind(names=FILLET_NAMES, anchor="root", find=find_fillet),
    "corner": JointKind(names=V_NAMES, anchor="root", find=partial(find_v, shape=OUTSIDE_CORNER)),
}
"""A new kind of joint is a module with a `find` of its own, and a line here."""


def find_joint(
    profile: Profile, kind: str, plane: LaserPlane, *, previous: JointFeatures | None = None
) -> JointFeatures:
    """The joint's features in the camera frame; `valid` is False, with the reason, where there is no such joint.

    Left is left of the travel. The sensor travels along the torch's +x and looks back at the torch: with the torch's z
    down, its y points to the right, the camera's x is -y of the torch, and left has the larger x in the laser frame.
    `previous` is what this function gave for the frame before; joints far away from it don't count.

    Raises BadInput for a kind that is not known.
    """
    if kind not in JOINT_KINDS:
        raise BadInput(f"joint kind: {kind!r} is not known. Available: {', '.join(sorted(JOINT_KINDS))}")
    joint = JOINT_KINDS[kind]
    if not profile.valid.any():
        return not_found(joint.names, profile.reason or "the profile holds no valid point")
    kept = {}
    if joint.kept and previous is not None and joint.kept in previous.measures:
        kept = {f"previous_{joint.kept}": previous.measures[joint.kept]}
    near_m = anchor_x_m(kind, plane, previous) if previous is not None and previous.valid else None
    found = joint.find(section_of(profile, plane), near_m, **kept)
    if not found.corners:
        return not_found(joint.names, found.reason)
    points_laser = np.array([[corner.x_m, 0.0, corner.z_m] for corner in found.corners])
    return JointFeatures(
        names=joint.names,
        points_camera=plane.T_camera_laser.apply(points_laser),
        sigma_m=np.array([corner.sigma_m for corner in found.corners]),
        valid=True,
        measures=found.measures,
        confidence=confidence(found.corners, found.trust),
    )


def anchor_x_m(kind: str, plane: LaserPlane, joint: JointFeatures) -> float:
    """x, in the laser frame, of the feature that a tracker follows."""
    anchor_camera = joint.points_camera[joint.names.index(JOINT_KINDS[kind].anchor)]
    T_camera_laser = plane.T_camera_laser.as_matrix()
    return float((anchor_camera - T_camera_laser[:3, 3]) @ T_camera_laser[:3, 0])


def not_found(names: tuple[str, ...], reason: str) -> JointFeatures:
    """Features that are not there, and why."""
    count = len(names)
    return JointFeatures(
        names=names,
        points_camera=np.full((count, 3), np.nan),
        sigma_m=np.full(count, np.nan),
        valid=False,
        reason=reason,
        confidence=np.zeros(count),
    )

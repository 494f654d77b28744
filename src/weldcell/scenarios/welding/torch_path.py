"""The torch along a taught path: its place and orientation there, and the readings that take it there."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import WeldConfig
from weldcell.cell.errors import OutOfReach
from weldcell.cell.frames import rigid_from
from weldcell.cell.seam import Seam, length_along
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import torch_rotations
from weldcell.tracking.taught_path import TaughtPath

WORK_CLEARANCE_M = 1.5e-3
"""A torch at work keeps this far from the part."""
_CHECK_EVERY_M = 0.01
_LARGEST_STEP_RAD = 0.5  # over that distance; more means that the arm changed its configuration


@dataclass(frozen=True, kw_only=True, eq=False)
class TorchPath:
    """How the torch goes along a taught path: leaning as told, its light on the path ahead."""

    taught: TaughtPath
    """The seam that the controller expects."""
    look_ahead_m: float
    """From the wire's tip to where the light crosses the path."""
    height_m: float
    """The wire's tip above the seam."""
    work_rad: float
    """Lean to the right."""
    travel_rad: float
    """Lean in the direction of travel."""
    tip_flange: Float[np.ndarray, "3"]
    """The torch tip as calibration found it, m."""

    @staticmethod
    def along(taught: TaughtPath, config: WeldConfig, station: Station, alignment: Alignment) -> "TorchPath":
        """The torch path of a configuration."""
        return TorchPath(
            taught=taught,
            look_ahead_m=station.head.look_ahead_m,
            height_m=1e-3 * config.height_mm,
            work_rad=float(np.radians(config.work_angle_deg)),
            travel_rad=float(np.radians(config.travel_angle_deg)),
            tip_flange=alignment.tip_flange,
        )

    def rotations(self, arc_length_m: Float[np.ndarray, "n"]) -> Rotation:
        """R_base_torch (stack): the wire against the path's up, leaning; x towards the path a look-ahead further on.

        A torch is the same all around its wire. Turned so, the light stays on a seam that bends.
        """
        here, ahead = self.taught.places(arc_length_m), self.taught.places(arc_length_m + self.look_ahead_m)
        upright = torch_rotations(ahead.points - here.points, here.ups)
        return upright * Rotation.from_euler("xy", [self.work_rad, -self.travel_rad])

    def flanges(
        self,
        arc_length_m: Float[np.ndarray, "n"],
        lateral_m: Float[np.ndarray, "n"],
        vertical_m: Float[np.ndarray, "n"],
    ) -> RigidTransform:
        """T_base_flange (stack) that takes the tip to these places of the path."""
        tips_base = self.taught.place(arc_length_m, lateral_m, vertical_m + self.height_m)
        rotations = self.rotations(arc_length_m) * T_FLANGE_TORCH.rotation.inv()
        return rigid_from(rotations, tips_base - rotations.apply(self.tip_flange))


def way_along(station: Station, path: TorchPath, start_m: float) -> Float[np.ndarray, "6"]:
    """Readings at `start_m` from which the arm, as it is known, follows the path in one configuration, clear of all.

    Raises OutOfReach if there are none, with what is in the way of the nearest configuration.
    """
    at_m = np.arange(start_m, path.taught.end_m + _CHECK_EVERY_M, _CHECK_EVERY_M)
    flanges = path.flanges(at_m, np.zeros(len(at_m)), np.zeros(len(at_m)))
    starts_rad = station.controller.all_inverse(flanges[0])
    effort = np.abs((starts_rad - station.joints_rad) / station.controller.speeds_rad_s).max(axis=1)
    refusal = "the arm cannot take the torch there within its joint limits; see seam.position_mm and yaw_deg"
    place_m = start_m
    for rank, start_rad in enumerate(starts_rad[np.argsort(effort)]):
        failure = _in_the_way(station, flanges, start_rad)
        if failure is None:
            return np.asarray(start_rad)
        if rank == 0:
            place_m, refusal = at_m[failure[0]], failure[1]
    length_mm = 1e3 * path.taught.end_m
    raise OutOfReach(f"weld: {1e3 * place_m:.0f} mm along the seam of {length_mm:.0f} mm: {refusal}")


def _in_the_way(station: Station, flanges: RigidTransform, start_rad: Float[np.ndarray, "6"]) -> tuple[int, str] | None:
    """Which pose cannot be followed from these readings on, and why; None if all can."""
    near_rad = start_rad
    for index, T_base_flange in enumerate(flanges):
        try:
            readings_rad = station.controller.inverse(T_base_flange, near_rad)
        except OutOfReach:
            return index, "out of the arm's reach; see seam.position_mm and yaw_deg"
        if np.abs(readings_rad - near_rad).max() > _LARGEST_STEP_RAD:
            return index, "the arm would have to change its configuration; see seam.position_mm and yaw_deg"
        if not station.planner.free(readings_rad, WORK_CLEARANCE_M):
            return index, (
                f"torch, head or arm come closer than {1e3 * WORK_CLEARANCE_M:g} mm to something; see weld.height_mm, "
                "work_angle_deg and travel_angle_deg, or take a wider joint"
            )
        near_rad = readings_rad
    return None


def taught_along(seam: Seam, T_base_part: RigidTransform, spacing_m: float = 1e-3) -> TaughtPath:
    """A seam's one line as a taught path, where the part is said to lie; up is out of the joint."""
    ((name, _),) = seam.points.items()
    count = max(2, int(np.ceil((seam.arc_length_m[-1] - seam.arc_length_m[0]) / spacing_m)) + 1)
    at_m = np.linspace(seam.arc_length_m[0], seam.arc_length_m[-1], count)
    points_base = T_base_part.apply(seam.at(name, at_m))
    ups_base = T_base_part.rotation.apply(seam.approach_at(at_m))
    arc_length_m = length_along(points_base)
    lefts_base = np.cross(ups_base, np.gradient(points_base, arc_length_m, axis=0))
    return TaughtPath(arc_length_m=arc_length_m, points_base=points_base, lefts_base=lefts_base, ups_base=ups_base)

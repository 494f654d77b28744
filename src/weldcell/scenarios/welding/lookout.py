"""The sensor on its way: pictures at its rate, and what they say of the seam, some time later."""

from collections import deque

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import WeldConfig
from weldcell.cell.randomness import generator
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.seam_tracking import joint_kind
from weldcell.scenarios.station import Sight, Station
from weldcell.scenarios.welding.torch_path import TorchPath
from weldcell.tracking.joint import JOINT_KINDS
from weldcell.tracking.joint_follower import SEARCH_M, JointFollower
from weldcell.tracking.sighting import Sighting

STAGE = "weld"
_MARGIN_M = 0.012  # at the seam's ends: there the light may miss a slanting part's corners
_NEWTON_STEPS = 4
# What the arm errs by on its way, after calibration, and over what distance it errs alike. Pictures closer together
# than that share an error: taken as independent, many of them would outvote what the tracker knows of misplacement.
_ARM_SIGMA_M, _ARM_ALIKE_M = 2.5e-5, 5e-3


class Lookout:
    """Takes pictures when they are due and hands on what they say when it is known."""

    def __init__(self, station: Station, path: TorchPath, alignment: Alignment, config: WeldConfig) -> None:
        self._station, self._path, self._alignment, self._config = station, path, alignment, config
        self._kind = joint_kind(station)
        self._follower = JointFollower(self._kind, station.belief.plane, search_m=SEARCH_M)
        spacing_m = 1e-3 * config.speed_mm_s / config.frame_hz
        self._arm_sigma_m = _ARM_SIGMA_M * np.sqrt(max(1.0, _ARM_ALIKE_M / spacing_m))
        self._due_s = 0.0
        self._waiting: deque[tuple[float, Sighting]] = deque()
        self.index = 0
        """How many pictures were due so far."""
        self.on_seam = 0
        """In how many the light was on the seam, as far as is known beforehand."""
        self.valid = 0
        """In how many of these the joint was found."""
        self.lost = 0
        """How many never arrived."""

    def begin(self, time_s: float) -> None:
        """The first picture is due now."""
        self._due_s = time_s

    def due(self, time_s: float) -> bool:
        """Whether a picture is due now; the next one is a frame later."""
        if time_s < self._due_s - 1e-9:
            return False
        self._due_s += 1 / self._config.frame_hz
        return True

    def look(
        self,
        arc_length_m: float,
        arc_s: float,
        rates_rad_s: Float[np.ndarray, "6"],
        stray_rad: Float[np.ndarray, "6"],
    ) -> None:
        """Takes a picture, the torch being there, with the arm as the station has it."""
        station = self._station
        index, self.index = self.index, self.index + 1
        crossing_m = self._crossing_m(arc_length_m)
        on_seam = self._path.taught.start_m + _MARGIN_M <= crossing_m <= self._path.taught.end_m - _MARGIN_M
        self.on_seam += int(on_seam)
        if generator(station.seed, "weld/lost", index).random() < self._config.lost_frames_ratio:
            self.lost += 1
            sighting = Sighting(
                time_s=station.time_s, arc_length_m=crossing_m, arc_s=arc_s, reason="the picture never arrived"
            )
        else:
            sight = station.see(STAGE, index, rates_rad_s, stray_rad)
            sighting = self._sighting(sight, crossing_m, arc_s, on_seam)
        self._waiting.append((station.time_s + 1e-3 * self._config.latency_ms, sighting))

    def results(self, time_s: float) -> list[Sighting]:
        """What has become known by now."""
        known = []
        while self._waiting and self._waiting[0][0] <= time_s + 1e-9:
            known.append(self._waiting.popleft()[1])
        return known

    def _sighting(self, sight: Sight, crossing_m: float, arc_s: float, on_seam: bool) -> Sighting:
        station, alignment = self._station, self._alignment
        joint = self._follower.find(sight.profile)
        station.log_sight(sight, alignment.T_flange_camera, joint)
        if not joint.valid:
            return Sighting(time_s=sight.shot.time_s, arc_length_m=crossing_m, arc_s=arc_s, reason=joint.reason)
        self.valid += int(on_seam)
        reported = RigidTransform.concatenate([sight.shot.T_base_flange])
        T_base_camera = alignment.flanges(sight.joints_rad[None], reported)[0] * alignment.T_flange_camera
        used = middle_features(self._kind)
        rows = [joint.names.index(name) for name in used]
        points_camera = alignment.corrected(joint.points_camera[rows], station.belief)
        return Sighting(
            time_s=sight.shot.time_s,
            arc_length_m=crossing_m,
            arc_s=arc_s,
            point_base=T_base_camera.apply(points_camera).mean(axis=0),
            sigma_m=float(np.hypot(np.sqrt(np.mean(joint.sigma_m[rows] ** 2) / len(rows)), self._arm_sigma_m)),
            confidence=float(joint.confidence[rows].min()),
            gap_m=joint.measures.get("gap_m"),
        )

    def _crossing_m(self, arc_length_m: float) -> float:
        """Where the light's plane cuts the taught path, by what the controller knows of both."""
        taught, belief = self._path.taught, self._station.belief
        T_base_camera = self._station.controller.forward(self._station.joints_rad) * self._alignment.T_flange_camera
        normal_base = T_base_camera.rotation.apply(belief.plane.normal_camera)
        point_base = T_base_camera.apply(belief.plane.normal_camera * belief.plane.offset_m)
        at_m = np.array([arc_length_m + self._path.look_ahead_m])
        for _ in range(_NEWTON_STEPS):
            place = taught.places(at_m)
            rate = max(abs(float(normal_base @ place.steps[0])), 0.2) * np.sign(float(normal_base @ place.steps[0]))
            at_m = at_m - float(normal_base @ (place.points[0] - point_base)) / rate
        return float(at_m[0])


def middle_features(kind: str) -> tuple[str, ...]:
    """The features whose mean is the line that the torch is to follow: the root, else midway between the edges."""
    joint = JOINT_KINDS[kind]
    return (joint.anchor,) if joint.anchor in ("root", "centre") else joint.names

"""Touches of the torch tip on the standard sphere: planned on what is known, stopped by what is there."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import JobFailed, OutOfReach
from weldcell.cell.randomness import generator
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at

_STANDOFF_M = 0.020  # where the approach starts, from the sphere's surface
_OVERTRAVEL_M = 0.010  # an approach that meets nothing is given up this far inside the known surface
_OFF_AXIS_RAD = np.radians(60)  # between the approach and the torch's axis: beyond it the nozzle would touch first
_LOWEST_RAD = np.radians(85)  # polar angle of the touched place: below it the post is near
_ATTEMPTS = 200  # directions tried for each touch
_APPROACH_M_S = 0.02
_CONTACT_M = 1e-9  # how closely the contact is resolved


def touch_sphere(
    station: Station, centre_base: Float[np.ndarray, "3"], orientations: Rotation, count: int, stage: str = "touch"
) -> Float[np.ndarray, "count 6"]:
    """The joint readings at touches all round the upper sphere.

    `centre_base` is where the sphere is believed to stand. The flange takes the `orientations` (R_base_flange, a
    stack) in turn: those in which the sensor saw the sphere, so that the robot errs alike in sights and touches.
    """
    readings = []
    for index in station.progress.track(range(count), "touch the sphere"):
        rng = generator(station.seed, f"{stage}/plan", index)
        approach = _approach(station, centre_base, orientations[index % len(orientations)], rng)
        readings.append(_touch(station, approach, stage, index))
    return np.array(readings)


@dataclass(frozen=True, kw_only=True)
class _Approach:
    """A straight way of the nominal tip towards the sphere."""

    start_base: Float[np.ndarray, "3"]
    direction_base: Float[np.ndarray, "3"]
    rotation_base_flange: Rotation
    joints_rad: Float[np.ndarray, "6"]

    def flange(self, station: Station, travel_m: float) -> RigidTransform:
        tip_base = self.start_base + travel_m * self.direction_base
        return flange_at(tip_base, self.rotation_base_flange, station.tip_nominal_flange)


def _approach(
    station: Station, centre_base: Float[np.ndarray, "3"], rotation: Rotation, rng: np.random.Generator
) -> _Approach:
    radius_m = station.parts.sphere_radius_m + station.parts.tip_radius_m
    wire_base = (rotation * T_FLANGE_TORCH.rotation).apply([0, 0, 1])
    for _ in range(_ATTEMPTS):
        outward = _outward(rng)
        if outward @ -wire_base < np.cos(_OFF_AXIS_RAD):
            continue
        start_base = centre_base + (radius_m + _STANDOFF_M) * outward
        T_base_flange = flange_at(start_base, rotation, station.tip_nominal_flange)
        try:
            joints_rad = station.controller.inverse(T_base_flange, station.planner.home_rad)
        except OutOfReach:
            continue
        if station.planner.working(joints_rad):
            return _Approach(
                start_base=start_base,
                direction_base=-outward,
                rotation_base_flange=rotation,
                joints_rad=joints_rad,
            )
    raise JobFailed("touches: no approach to the sphere was found that is in reach and clear of the parts")


def _outward(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    """A direction spread evenly over the part of the sphere that can be touched."""
    up = rng.uniform(np.cos(_LOWEST_RAD), 1)
    turn = rng.uniform(0, 2 * np.pi)
    side = np.sqrt(1 - up**2)
    return np.array([side * np.cos(turn), side * np.sin(turn), up])


def _touch(station: Station, approach: _Approach, stage: str, index: int) -> Float[np.ndarray, "6"]:
    """The joint readings at which the actual tip meets the actual sphere."""
    station.go(approach.joints_rad)

    def readings(travel_m: float) -> Float[np.ndarray, "6"]:
        return station.controller.inverse(approach.flange(station, travel_m), approach.joints_rad)

    def gap_m(travel_m: float) -> float:
        station.cell.take(readings(travel_m), generator(station.seed, f"{stage}/pose", index))
        return station.gap_to_sphere_m()

    reach_m = _STANDOFF_M + _OVERTRAVEL_M
    if gap_m(0.0) <= 0 or gap_m(reach_m) >= 0:
        raise JobFailed(f"touch {index}: the torch met no sphere where it is believed to stand")
    joints_rad = readings(brentq(gap_m, 0.0, reach_m, xtol=_CONTACT_M))
    station.stand_at(joints_rad, station.time_s + _STANDOFF_M / _APPROACH_M_S)
    station.recording.log_touch(station.cell.tip_base, frame=station.frame, time_s=station.time_s)
    station.frame += 1  # a touch counts like a picture, so that the recording can be stopped at it
    station.stand_at(approach.joints_rad, station.time_s + _STANDOFF_M / _APPROACH_M_S)
    return joints_rad

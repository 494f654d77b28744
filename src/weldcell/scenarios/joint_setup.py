"""The joint estimate on the sights and touches of the standard sphere."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib import joint_estimate
from weldcell.calib.joint_problem import ALL_GROUPS, JointProblem, SphereSights, TargetDistance, Touches
from weldcell.calib.sensor_errors import circles_by_sensor
from weldcell.scenarios.sphere_sights import SphereSight
from weldcell.scenarios.station import Station


@dataclass(frozen=True, kw_only=True, eq=False)
class SphereData:
    """What was seen and touched of one sphere."""

    sights: Sequence[SphereSight]
    """Views of it."""
    touches_rad: Float[np.ndarray, "m 6"]
    """Joint readings at the touches."""


def estimate_jointly(
    station: Station, spheres: Sequence[SphereData], T_flange_camera: RigidTransform, bar_m: float | None = None
) -> joint_estimate.JointResult:
    """Camera, spheres, tip, arm and sensor from all that was seen and touched; `T_flange_camera` is where to start.

    `bar_m` is the known distance of the first two spheres.
    """
    parts, tip_known = station.parts, not station.config.calibration.estimate_tip
    touched = np.concatenate([sphere.touches_rad for sphere in spheres])
    return joint_estimate.solve(
        JointProblem(
            arm=station.arm,
            sights=_sphere_sights(station, spheres),
            touches=Touches(
                joints_rad=touched,
                targets=np.repeat(np.arange(len(spheres)), [len(sphere.touches_rad) for sphere in spheres]),
                sums_m=np.full(len(touched), parts.sphere_radius_m + parts.tip_radius_m),
            ),
            distances=() if bar_m is None else (TargetDistance(first=0, second=1, distance_m=bar_m),),
            tip_flange=station.tip_nominal_flange,
            T_flange_camera=T_flange_camera,
            estimate=ALL_GROUPS - {"tip"} if tip_known else ALL_GROUPS,
        )
    )


def _sphere_sights(station: Station, spheres: Sequence[SphereData]) -> SphereSights:
    sights = [seen for sphere in spheres for seen in sphere.sights]
    circles_laser = np.array([seen.centre.circle_laser for seen in sights])
    radii_m = np.array([seen.profile.radius_m for seen in sights])
    belief = station.belief
    return SphereSights(
        joints_rad=np.array([seen.joints_rad for seen in sights]),
        circles_laser=circles_laser,
        covariances_laser=np.array([seen.centre.circle_covariance_laser for seen in sights]),
        targets=np.repeat(np.arange(len(spheres)), [len(sphere.sights) for sphere in spheres]),
        radii_m=radii_m,
        sides=np.array([seen.profile.side for seen in sights]),
        T_camera_laser=belief.plane.T_camera_laser,
        by_sensor=circles_by_sensor(
            [seen.arc_camera for seen in sights],
            np.array([seen.centre.centre_camera for seen in sights]),
            circles_laser,
            radii_m,
            belief.camera,
            belief.plane,
        ),
    )

"""The joint estimate on the sights and touches of the standard sphere."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib import joint_estimate
from weldcell.calib.joint_problem import ALL_GROUPS, JointProblem, SphereSights, Touches
from weldcell.calib.sensor_errors import circles_by_sensor
from weldcell.scenarios.sphere_sights import SphereSight
from weldcell.scenarios.station import Station


def estimate_jointly(
    station: Station,
    sights: Sequence[SphereSight],
    touches_rad: Float[np.ndarray, "m 6"],
    T_flange_camera: RigidTransform,
) -> joint_estimate.JointResult:
    """Camera, sphere, tip, arm and sensor from all that was seen and touched; `T_flange_camera` is where to start."""
    parts, tip_known = station.parts, not station.config.calibration.estimate_tip
    return joint_estimate.solve(
        JointProblem(
            arm=station.arm,
            sights=_sphere_sights(station, sights),
            touches=Touches(
                joints_rad=touches_rad,
                targets=np.zeros(len(touches_rad), dtype=int),
                sums_m=np.full(len(touches_rad), parts.sphere_radius_m + parts.tip_radius_m),
            ),
            tip_flange=station.tip_nominal_flange,
            T_flange_camera=T_flange_camera,
            estimate=ALL_GROUPS - {"tip"} if tip_known else ALL_GROUPS,
        )
    )


def _sphere_sights(station: Station, sights: Sequence[SphereSight]) -> SphereSights:
    circles_laser = np.array([seen.centre.circle_laser for seen in sights])
    radii_m = np.array([seen.profile.radius_m for seen in sights])
    belief = station.belief
    return SphereSights(
        joints_rad=np.array([seen.joints_rad for seen in sights]),
        circles_laser=circles_laser,
        covariances_laser=np.array([seen.centre.circle_covariance_laser for seen in sights]),
        targets=np.zeros(len(sights), dtype=int),
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

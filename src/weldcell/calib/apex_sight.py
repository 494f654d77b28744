"""A fixed point from one light section: the crossing of the two straight flanks of a pyramid's top.

The flanks are fitted left and right of the point nearest to the sensor, without the part next to it, where a light
plane that misses the apex a little cuts a third face. The crossing is the apex but for what the plane misses it by
along its normal, which no single section can tell: the covariance has it as `aim_sigma_m`.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import median_filter

from weldcell.calib.least_squares import Fit, Model, fit, robust_spread
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import LaserPlane

_LEFT_OUT_M = 1.5e-3  # next to the apex: a plane that misses it by 0.5 mm, turned by 30 deg, cuts a third face there
_FLANK_M = 9e-3  # how far along x a flank is looked at
_FEWEST_POINTS = 15
_ROUGH_M = 6e-5  # twice what speckle does to a point
_LEAST_ANGLE_RAD = np.deg2rad(20)  # between the flanks' directions and a straight line
_MEDIAN_POINTS = 7
_SIGMA_FLOOR_M = 1e-6  # no triangulation sensor knows a single point better
_SOUND_WEIGHT = 0.35
_ROUNDS = 2  # the second sorts the points by the first's apex


@dataclass(frozen=True, kw_only=True, eq=False)
class ApexSightProblem:
    """One profile that crosses the apex."""

    points_camera: Float[np.ndarray, "n 3"]
    """Points of the light section (m); rows with NaN are left out."""
    sigma_m: Float[np.ndarray, "n"]
    """Standard deviation of each point along the light."""
    plane: LaserPlane
    """The light plane in which the points lie."""
    aim_sigma_m: float = 1e-4
    """How well the light plane was put on the apex, across the plane."""

    def __post_init__(self) -> None:
        if self.points_camera.shape != (len(self.sigma_m), 3):
            raise BadInput(f"apex sight: points of shape {self.points_camera.shape}, {len(self.sigma_m)} sigmas")
        if not (np.isfinite(self.aim_sigma_m) and self.aim_sigma_m >= 0):
            raise BadInput(f"apex sight: aim_sigma_m is {self.aim_sigma_m}, expected 0 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class ApexSightResult:
    """The apex as this profile shows it."""

    apex_camera: Float[np.ndarray, "3"]
    """Metres; NaN if not valid."""
    covariance_camera: Float[np.ndarray, "3 3"]
    """Of the apex (m^2), the aim included; NaN if not valid."""
    inliers: Bool[np.ndarray, "n"]
    """The points on the flanks."""
    valid: bool
    reason: str = ""
    """Why there is no apex, if there is none."""


def solve(problem: ApexSightProblem) -> ApexSightResult:
    """The apex; deterministic."""
    points_laser = problem.plane.T_camera_laser.inv().apply(problem.points_camera)
    usable = np.flatnonzero(np.isfinite(points_laser).all(axis=1) & np.isfinite(problem.sigma_m))
    usable = usable[np.argsort(points_laser[usable, 0], kind="stable")]
    if len(usable) < 2 * _FEWEST_POINTS:
        return _invalid(problem, f"{len(usable)} points in the profile, expected at least {2 * _FEWEST_POINTS}")
    section, sigma_m = points_laser[usable][:, [0, 2]], np.maximum(problem.sigma_m[usable], _SIGMA_FLOOR_M)
    top_x = section[np.argmin(median_filter(section[:, 1], _MEDIAN_POINTS, mode="nearest")), 0]
    for _ in range(_ROUNDS):
        offset = section[:, 0] - top_x
        near = (np.abs(offset) > _LEFT_OUT_M) & (np.abs(offset) < _FLANK_M)
        right = offset > 0
        if min(np.sum(near & right), np.sum(near & ~right)) < _FEWEST_POINTS:
            return _invalid(problem, f"fewer than {_FEWEST_POINTS} points on a flank of the apex")
        found = fit(_flanks(section[near], sigma_m[near], right[near]), _start(section[near], right[near]))
        top_x = float(found.parameters[0])
    return _judged(problem, found, usable[near])


def _judged(problem: ApexSightProblem, found: Fit, flanks: np.ndarray) -> ApexSightResult:
    x, z, left_slope, right_slope = found.parameters
    usual_sigma_m = float(np.median(np.maximum(problem.sigma_m[flanks], _SIGMA_FLOOR_M)))
    rms_m = robust_spread(found.residuals, unknowns=4) * usual_sigma_m
    rough_m = max(_ROUGH_M, 2 * usual_sigma_m)
    bend_rad = float(np.arctan(right_slope) - np.arctan(left_slope))
    reason = ""
    if not (found.converged and np.all(np.isfinite(found.covariance))):
        reason = f"the flanks' fit did not converge: {found.message}"
    elif rms_m > rough_m:
        reason = f"points lie {rms_m * 1e3:.3g} mm off two lines, expected at most {rough_m * 1e3:.3g}: no flanks"
    elif bend_rad < _LEAST_ANGLE_RAD:
        least = np.rad2deg(_LEAST_ANGLE_RAD)
        reason = f"the profile bends by {np.rad2deg(bend_rad):.3g} deg at its top, expected at least {least:.0f}"
    if reason:
        return _invalid(problem, reason)
    T_camera_laser = problem.plane.T_camera_laser
    covariance_laser = np.zeros((3, 3))
    covariance_laser[np.ix_([0, 2], [0, 2])] = found.covariance[:2, :2]
    covariance_laser[1, 1] = problem.aim_sigma_m**2
    R_camera_laser = T_camera_laser.rotation.as_matrix()
    inliers = np.zeros(len(problem.points_camera), dtype=bool)
    inliers[flanks] = found.weights > _SOUND_WEIGHT
    return ApexSightResult(
        apex_camera=T_camera_laser.apply([x, 0.0, z]),
        covariance_camera=R_camera_laser @ covariance_laser @ R_camera_laser.T,
        inliers=inliers,
        valid=True,
    )


def _start(section: Float[np.ndarray, "n 2"], right: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "4"]:
    """Crossing and slopes of two straight lines."""
    (left_slope, left_z), (right_slope, right_z) = (
        np.polyfit(section[side, 0], section[side, 1], 1) for side in (~right, right)
    )
    bend = right_slope - left_slope
    x = (left_z - right_z) / bend if abs(bend) > 1e-9 else float(section[:, 0].mean())
    return np.array([x, left_z + left_slope * x, left_slope, right_slope])


def _flanks(section: Float[np.ndarray, "n 2"], sigma_m: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> Model:
    """Depths less those of two lines that meet at (x, z), in sigmas, by x, z and the slopes left and right."""

    def model(parameters: Float[np.ndarray, "4"]) -> tuple[np.ndarray, np.ndarray]:
        x, z, *slopes = parameters
        slope, offset = np.where(right, slopes[1], slopes[0]), section[:, 0] - x
        residuals = section[:, 1] - z - slope * offset
        jacobian = np.column_stack([slope, -np.ones(len(slope)), -offset * ~right, -offset * right])
        return (residuals / sigma_m)[:, None], (jacobian / sigma_m[:, None])[:, None]

    return model


def _invalid(problem: ApexSightProblem, reason: str) -> ApexSightResult:
    return ApexSightResult(
        apex_camera=np.full(3, np.nan),
        covariance_camera=np.full((3, 3), np.nan),
        inliers=np.zeros(len(problem.points_camera), dtype=bool),
        valid=False,
        reason=reason,
    )

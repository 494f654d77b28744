"""`weldcell calibrate hand-eye`: the hand-eye estimators on the user's own files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from weldcell.calib import compensation, robust_hand_eye, sphere_sight, touches
from weldcell.calib.hand_eye import HandEyeProblem
from weldcell.calib.robust_hand_eye import RobustHandEyeResult
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import LaserPlane
from weldcell.scenarios.atomic_file import write_bytes
from weldcell.scenarios.calibration_file import hand_eye_report, write_report
from weldcell.scenarios.residual_plot import Bar, residual_png
from weldcell.scenarios.user_data import EULER_SEQUENCES, Poses, match_ids, read_points, read_poses

# A profile lies in y = 0 and z is depth. The plane's own frame then is the sensor's, for y points against the normal.
_SENSOR_PLANE = LaserPlane(normal_camera=np.array([0.0, -1.0, 0.0]), offset_m=0.0)
_SIGMA_FLOOR_M = 5e-6  # no profiler's point is better
_EXACT_M = 1e-5  # better than any robot: nothing to doubt
_EULER_RATIO = 0.5  # of the residuals with the angles as given
_SIDE_RATIO = 2.0  # by which the wrong side's residuals must be larger for the data to tell the side


@dataclass(frozen=True, kw_only=True)
class HandEyeRequest:
    """What the command line asks for."""

    target: Literal["point", "sphere"]
    radius_m: float | None
    """Of the sphere."""
    side: int | None
    """+1 if the sphere's centre lies at y > 0 of the sensor; None: found from the data."""
    poses_file: Path
    points_file: Path
    touches_file: Path | None
    tip_flange: tuple[float, float, float] | None
    """Of the torch (m); for touches."""
    tip_radius_m: float
    """Of the tip's rounding."""
    euler: str | None

    def __post_init__(self) -> None:
        sphere = self.target == "sphere"
        if sphere and not (self.radius_m is not None and np.isfinite(self.radius_m) and self.radius_m > 0):
            raise BadInput("--radius-mm: --target sphere needs the sphere's radius, above 0")
        if not sphere and (self.radius_m is not None or self.side is not None or self.touches_file is not None):
            raise BadInput("--radius-mm, --side and --touches belong to --target sphere, found --target point")
        if self.side not in (None, -1, 1):
            raise BadInput(f"--side: found {self.side}, expected -1 or 1")
        if (self.touches_file is None) != (self.tip_flange is None):
            raise BadInput("--touches and --tcp-mm: expected both or neither")
        if self.tip_flange is not None and not np.all(np.isfinite(self.tip_flange)):
            raise BadInput(f"--tcp-mm: found {self.tip_flange}, expected 3 finite numbers")
        if not 0 <= self.tip_radius_m < np.inf:
            raise BadInput(f"--tip-radius-mm: found {self.tip_radius_m * 1e3}, expected 0 or more")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sights:
    """Where the sensor saw the target in each pose."""

    centres_sensor: Float[np.ndarray, "n 3"]
    """Metres; NaN where not seen."""
    covariances_sensor: Float[np.ndarray, "n 3 3"] | None
    reasons: tuple[str, ...]
    """Why a pose shows no target; empty where it does."""

    @property
    def seen(self) -> Bool[np.ndarray, "n"]:
        return np.array([not reason for reason in self.reasons])


def hand_eye(request: HandEyeRequest, place: Path, *, overwrite: bool = False) -> tuple[str, tuple[str, ...]]:
    """Verdict and reasons; writes `result.json` and `residuals.png` into the folder."""
    target = place / "result.json"
    if target.exists() and not overwrite:
        raise BadInput(f"{target}: found a result, expected a free place (--overwrite replaces it)")
    if place.exists() and not place.is_dir():
        raise BadInput(f"{place}: found a file, expected a folder to write the result into")
    poses = read_poses(request.poses_file, request.euler)
    report = _calibrate(request, poses)
    write_bytes(place / "residuals.png", _plot(report))
    write_report(target, report)
    return report["verdict"], tuple(report["reasons"])


def _plot(report: dict[str, Any]) -> bytes:
    """How far each pose misses the target."""
    bars = [
        Bar(name=name, value=found["length_mm"], outlier=name in report["outliers"])
        for name, found in report["residuals"].items()
    ]
    return residual_png("hand-eye: distance of each pose's target from the common one", "mm", bars)


def _calibrate(request: HandEyeRequest, poses: Poses) -> dict[str, Any]:
    sights, found, notes = _best_side(request, poses)
    touched = None
    if request.touches_file is not None:
        touched = _compensate(request, poses, sights, found)
    return hand_eye_report(
        poses.ids, sights.reasons, found, touched, doubts=_doubt_euler(request, sights, found), notes=notes
    )


def _doubt_euler(request: HandEyeRequest, sights: _Sights, found: RobustHandEyeResult) -> list[str]:
    """A doubt where another reading of the angles fits far better with no more outliers."""
    if request.euler is None or found.rms_m < _EXACT_M:
        return []
    best, best_m = "", _EULER_RATIO * found.rms_m
    for other in EULER_SEQUENCES:
        read = read_poses(request.poses_file, other)
        tried = _solve(request, read, sights)
        if tried.verdict != "refused" and tried.rms_m < best_m and np.sum(tried.sound) >= np.sum(found.sound):
            best, best_m = other, tried.rms_m
    if not best:
        return []
    return [
        f"--euler {request.euler} leaves {found.rms_m * 1e3:.3g} mm rms, {best} would leave {best_m * 1e3:.3g} mm: "
        "does the controller mean that?"
    ]


def _best_side(request: HandEyeRequest, poses: Poses) -> tuple[_Sights, RobustHandEyeResult, list[str]]:
    """The estimate with the side that was given, or with the one whose residuals are clearly smaller."""
    if request.target == "point" or request.side is not None:
        sights = _sights(request, poses, request.side or 1)
        return sights, _solve(request, poses, sights), []
    tried = []
    for side in (1, -1):
        sights = _sights(request, poses, side)
        tried.append((sights, _solve(request, poses, sights), side))
    (sights, found, side), (_, other, _) = sorted(tried, key=lambda one: one[1].rms_m)
    if other.rms_m < _SIDE_RATIO * found.rms_m:
        raise BadInput(
            f"{request.points_file}: both sides fit ({found.rms_m * 1e3:.3g} and {other.rms_m * 1e3:.3g} mm rms), "
            "expected --side -1 or --side 1"
        )
    note = (
        f"the sphere's centre lies on side {side:+d} ({found.rms_m * 1e3:.3g} mm rms, {other.rms_m * 1e3:.3g} mm else)"
    )
    return sights, found, [note]


def _solve(request: HandEyeRequest, poses: Poses, sights: _Sights) -> RobustHandEyeResult:
    seen = sights.seen
    if np.sum(seen) < 3:
        why = next((f" (id {name}: {why})" for name, why in zip(poses.ids, sights.reasons, strict=True) if why), "")
        raise BadInput(f"{request.points_file}: found {np.sum(seen)} poses that show the target, expected 3{why}")
    return robust_hand_eye.solve(
        HandEyeProblem(T_base_flange=poses.T_base_flange[seen], centres_camera=sights.centres_sensor[seen])
    )


def _sights(request: HandEyeRequest, poses: Poses, side: int) -> _Sights:
    points = read_points(request.points_file, once=request.target == "point")
    match_ids(request.poses_file, poses, request.points_file, points)
    if request.target == "point":
        by_id = dict(zip(points.ids, points.points_sensor, strict=True))
        centres = np.array([by_id[name] for name in poses.ids])
        return _Sights(centres_sensor=centres, covariances_sensor=None, reasons=("",) * len(poses.ids))
    names = np.array(points.ids)
    results = [_sphere(points.points_sensor[names == name], request.radius_m or 0.0, side) for name in poses.ids]
    return _Sights(
        centres_sensor=np.array([result.centre_camera for result in results]),
        covariances_sensor=np.array([result.covariance_camera for result in results]),
        reasons=tuple(result.reason for result in results),
    )


def _sphere(points_sensor: Float[np.ndarray, "n 3"], radius_m: float, side: int) -> sphere_sight.SphereSightResult:
    sigma_m = np.full(len(points_sensor), _point_sigma_m(points_sensor))
    return sphere_sight.solve(
        sphere_sight.SphereSightProblem(
            points_camera=points_sensor, sigma_m=sigma_m, plane=_SENSOR_PLANE, radius_m=radius_m, side=-side
        )
    )


def _point_sigma_m(points_sensor: Float[np.ndarray, "n 3"]) -> float:
    """Noise of a profile's depth from its second differences, whose variance is 6 times a point's; robust."""
    depths = points_sensor[np.argsort(points_sensor[:, 0], kind="stable"), 2]
    if len(depths) < 3:
        return _SIGMA_FLOOR_M
    return max(float(np.median(np.abs(np.diff(depths, 2)))) / (0.6745 * np.sqrt(6)), _SIGMA_FLOOR_M)


def _compensate(
    request: HandEyeRequest, poses: Poses, sights: _Sights, found: RobustHandEyeResult
) -> tuple[touches.TouchResult, compensation.CompensationResult]:
    """P2's last step on the sound rows: the touches tell where the sphere is."""
    if request.touches_file is None or request.tip_flange is None or request.radius_m is None:
        raise BadInput("--touches: expected with --tcp-mm and --radius-mm")
    touched = touches.solve(
        touches.TouchProblem(
            T_base_flange=read_poses(request.touches_file, request.euler).T_base_flange,
            tip_flange=np.array(request.tip_flange),
            radius_m=request.radius_m,
            tip_radius_m=request.tip_radius_m,
            estimate_tip=False,
        )
    )
    rows = np.flatnonzero(sights.seen)[found.sound]
    covariances = sights.covariances_sensor
    return touched, compensation.solve(
        compensation.CompensationProblem(
            T_base_flange=poses.T_base_flange[rows],
            centres_camera=sights.centres_sensor[rows],
            centre_base=touched.centre_base,
            T_flange_camera=found.T_flange_camera,
            covariances_camera=None if covariances is None else covariances[rows],
            centre_covariance_base=touched.covariance[:3, :3],
        )
    )

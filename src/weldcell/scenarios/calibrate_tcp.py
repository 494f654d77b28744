"""`weldcell calibrate tcp`: the torch's tip on the flange, from the user's own files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from weldcell.calib import pivot, touches
from weldcell.cell.errors import BadInput
from weldcell.scenarios.calibration_file import write_report
from weldcell.scenarios.user_data import EULER_SEQUENCES, Poses, read_poses

_EXACT_M = 1e-5  # better than any robot: nothing to doubt
_EULER_RATIO = 0.5  # of the residuals with the angles as given


@dataclass(frozen=True, kw_only=True)
class TcpRequest:
    """What the command line asks for."""

    method: Literal["pivot", "sphere"]
    poses_file: Path
    euler: str | None
    radius_m: float | None
    """Of the sphere."""
    tip_radius_m: float
    """Of the tip's rounding, for the sphere."""
    tip_flange: tuple[float, float, float] | None
    """The nominal tip (m), where the search starts; for the sphere."""

    def __post_init__(self) -> None:
        sphere = self.method == "sphere"
        if sphere and not (self.radius_m is not None and np.isfinite(self.radius_m) and self.radius_m > 0):
            raise BadInput("--radius-mm: --method sphere needs the sphere's radius, above 0")
        if sphere and self.tip_flange is None:
            raise BadInput("--tcp-mm: --method sphere needs the nominal tip to start from")
        if not sphere and (self.radius_m is not None or self.tip_flange is not None or self.tip_radius_m != 0):
            raise BadInput("--radius-mm, --tip-radius-mm and --tcp-mm belong to --method sphere, found --method pivot")
        if self.tip_flange is not None and not np.all(np.isfinite(self.tip_flange)):
            raise BadInput(f"--tcp-mm: found {self.tip_flange}, expected 3 finite numbers")
        if not 0 <= self.tip_radius_m < np.inf:
            raise BadInput(f"--tip-radius-mm: found {self.tip_radius_m * 1e3}, expected 0 or more")


def tcp(request: TcpRequest, place: Path, *, overwrite: bool = False) -> tuple[str, tuple[str, ...]]:
    """Verdict and reasons; writes `result.json` into the folder."""
    target = place / "result.json"
    if target.exists() and not overwrite:
        raise BadInput(f"{target}: found a result, expected a free place (--overwrite replaces it)")
    if place.exists() and not place.is_dir():
        raise BadInput(f"{place}: found a file, expected a folder to write the result into")
    poses = read_poses(request.poses_file, request.euler)
    report = _by_pivot(request, poses) if request.method == "pivot" else _by_sphere(request, poses)
    write_report(target, report)
    return report["verdict"], tuple(report["reasons"])


def _by_pivot(request: TcpRequest, poses: Poses) -> dict[str, Any]:
    found = pivot.solve(pivot.PivotProblem(T_base_flange=poses.T_base_flange))
    lengths_mm = 1e3 * np.linalg.norm(found.residuals_base, axis=1)
    outliers = [name for name, sound in zip(poses.ids, found.sound, strict=True) if not sound]
    reasons = list(found.reasons) + [
        f"id {name} is an outlier: it misses the others' point by {length:.3g} mm"
        for name, length, sound in zip(poses.ids, lengths_mm, found.sound, strict=True)
        if not sound
    ]
    doubts = _doubt_euler(request, found)
    residuals = {
        name: {**dict(zip(("x_mm", "y_mm", "z_mm"), row * 1e3, strict=True)), "length_mm": length}
        for name, row, length in zip(poses.ids, found.residuals_base, lengths_mm, strict=True)
    }
    return _report(
        found,
        verdict="doubtful" if found.verdict == "accepted" and (doubts or outliers) else found.verdict,
        reasons=reasons + doubts,
        other={"point_base_mm": found.point_base * 1e3},
        covariance=found.covariance,
        residuals=residuals,
        outliers=outliers,
        leave_one_out_rms_mm=found.leave_one_out_rms_m * 1e3,
    )


def _by_sphere(request: TcpRequest, poses: Poses) -> dict[str, Any]:
    if request.radius_m is None or request.tip_flange is None:
        raise BadInput("--method sphere: expected --radius-mm and --tcp-mm")
    found = touches.solve(
        touches.TouchProblem(
            T_base_flange=poses.T_base_flange,
            tip_flange=np.array(request.tip_flange),
            radius_m=request.radius_m,
            tip_radius_m=request.tip_radius_m,
        )
    )
    tip_first = np.r_[3:6, 0:3]
    names = [name for name, sound in zip(poses.ids, found.sound, strict=True) if not sound]
    return _report(
        found,
        verdict=found.verdict,
        reasons=list(found.reasons),
        other={"sphere_centre_base_mm": found.centre_base * 1e3},
        covariance=found.covariance[np.ix_(tip_first, tip_first)],
        residuals={name: {"length_mm": miss * 1e3} for name, miss in zip(poses.ids, found.residual_m, strict=True)},
        outliers=names,
        leave_one_out_rms_mm=None,
    )


def _report(
    found: pivot.PivotResult | touches.TouchResult,
    *,
    verdict: str,
    reasons: list[str],
    other: dict[str, Any],
    covariance: Float[np.ndarray, "6 6"],
    residuals: dict[str, dict[str, float]],
    outliers: list[str],
    leave_one_out_rms_mm: float | None,
) -> dict[str, Any]:
    refused = verdict == "refused"
    target = next(iter(other)).removesuffix("_mm")
    return {
        "estimate": None if refused else {"tip_flange_mm": found.tip_flange * 1e3},
        **({} if refused else other),
        "covariance": covariance * 1e6,
        "covariance_of": [f"tip_flange_{axis}_mm" for axis in "xyz"] + [f"{target}_{axis}_mm" for axis in "xyz"],
        "residuals": residuals,
        "residual_rms_mm": found.rms_m * 1e3,
        "outliers": outliers,
        "condition_number": found.condition_number,
        "observability": list(found.observability),
        "leave_one_out_rms_mm": leave_one_out_rms_mm,
        "verdict": verdict,
        "reasons": reasons,
        "notes": [],
    }


def _doubt_euler(request: TcpRequest, found: pivot.PivotResult) -> list[str]:
    """A doubt where another reading of the angles fits far better with no more outliers."""
    if request.euler is None or found.rms_m < _EXACT_M:
        return []
    best, best_m = "", _EULER_RATIO * found.rms_m
    for other in EULER_SEQUENCES:
        tried = pivot.solve(pivot.PivotProblem(T_base_flange=read_poses(request.poses_file, other).T_base_flange))
        if tried.verdict != "refused" and tried.rms_m < best_m and np.sum(tried.sound) >= np.sum(found.sound):
            best, best_m = other, tried.rms_m
    if not best:
        return []
    return [
        f"--euler {request.euler} leaves {found.rms_m * 1e3:.3g} mm rms, {best} would leave {best_m * 1e3:.3g} mm: "
        "does the controller mean that?"
    ]

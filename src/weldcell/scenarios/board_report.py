"""result.json and residuals.png of camera and laser plane calibrations, in mm, degrees and pixels."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from weldcell.calib.board_bundle import Corners, StripePoints
from weldcell.calib.camera import CameraResult
from weldcell.calib.laser_plane import LaserPlaneResult, angle_and_base
from weldcell.calib.verdict import Verdict
from weldcell.scenarios.camera_file import camera_mapping
from weldcell.scenarios.residual_plot import Bar, Field, residual_png

_OUTLYING = 4.0  # times the median picture's rms
_LEAST_OUTLYING_MM = 0.05
_WORST: tuple[Verdict, ...] = ("refused", "doubtful", "accepted")
_ANGLES = ("tau_x", "tau_y")


def camera_report(found: CameraResult, names: Sequence[str], left_out: Mapping[str, str]) -> dict[str, Any]:
    """The report of a camera calibration; `left_out` says why pictures don't count."""
    refused = found.verdict == "refused"
    units = np.array([np.degrees(1.0) if name in _ANGLES else 1.0 for name in found.names])
    return {
        "estimate": None if refused else camera_mapping(found.camera),
        "covariance": found.covariance * np.outer(units, units),
        "covariance_of": [_with_unit(name) for name in found.names],
        "residuals": {name: {"corner_rms_px": rms} for name, rms in zip(names, found.picture_rms_px, strict=True)},
        "residual_rms_px": found.rms_px,
        "held_out_rms_px": found.held_out_rms_px,
        "outliers": [names[k] for k in found.outlying],
        "left_out": dict(left_out),
        "condition_number": found.condition_number,
        "observability": list(found.observability),
        "verdict": found.verdict,
        "reasons": [*(_named(reason, names) for reason in found.reasons), *_left_out(left_out)],
    }


def plane_report(
    found: LaserPlaneResult,
    estimated: CameraResult | None,
    stripe: StripePoints,
    names: Sequence[str],
    left_out: Mapping[str, str],
    wrong: Mapping[str, float],
) -> dict[str, Any]:
    """The report of a light plane; `estimated` is the camera from the same pictures, if it was not known.

    `wrong` holds the pictures that did not agree with the others and were not used, and how far off they are (mm).
    """
    rms_mm = _picture_rms_mm(found, stripe, names, wrong)
    outliers = _outliers(rms_mm, names)
    unlit = [name for k, name in enumerate(names) if not np.any(stripe.picture == k) and name not in wrong]
    verdicts, reasons = [found.verdict], list(found.reasons)
    if estimated is not None:
        verdicts.append(estimated.verdict)
        reasons += [f"camera: {_named(reason, names)}" for reason in estimated.reasons]
    if outliers:
        verdicts.append("doubtful")
        reasons += [f"{name} misses the light plane by {rms_mm[names.index(name)]:.3g} mm rms" for name in outliers]
    reasons += [f"{name}: no stripe was found on the board" for name in unlit]
    verdict = min(verdicts, key=_WORST.index)
    theta_rad, base_m = angle_and_base(found.plane) if verdict != "refused" else (np.nan, np.nan)
    units = np.array([np.degrees(1.0), np.degrees(1.0), 1e3])
    return {
        "estimate": None
        if verdict == "refused"
        else {
            "normal": found.plane.normal_camera,
            "offset_mm": 1e3 * found.plane.offset_m,
            "theta_deg": np.degrees(theta_rad),
            "base_mm": 1e3 * base_m,
            "camera": camera_mapping(found.camera),
        },
        "covariance": found.covariance * np.outer(units, units),
        "covariance_of": ["normal_tilt_along_laser_x_deg", "normal_tilt_along_laser_z_deg", "offset_mm"],
        "residuals": {
            name: {"stripe_rms_mm": rms_mm[k], "stripe_points": int(np.sum(stripe.picture == k))}
            for k, name in enumerate(names)
        },
        "residual_rms_mm": 1e3 * found.rms_m,
        "corner_rms_px": found.corner_rms_px,
        "camera_held_out_rms_px": None if estimated is None else estimated.held_out_rms_px,
        "outliers": outliers,
        "left_out": dict(left_out) | dict.fromkeys(unlit, "no stripe was found on the board"),
        "condition_number": found.condition_number,
        "observability": list(found.observability),
        "leave_one_out_rms_mm": 1e3 * found.leave_one_out_rms_m,
        "verdict": verdict,
        "reasons": [*reasons, *_left_out(left_out)],
    }


def camera_plot(found: CameraResult, corners: Corners, names: Sequence[str], left_out: Mapping[str, str]) -> bytes:
    """Root mean square residual of each picture, and all residual vectors in the picture."""
    bars = [
        Bar(name=name, value=float(rms), outlier=k in found.outlying)
        for k, (name, rms) in enumerate(zip(names, found.picture_rms_px, strict=True))
    ]
    field = Field(
        points_px=corners.pixels,
        residuals=found.residuals_px,
        unit="px",
        width_px=found.camera.width_px,
        height_px=found.camera.height_px,
    )
    return residual_png("camera: corners, found minus expected", "px rms", bars + _without(left_out), field)


def plane_plot(
    found: LaserPlaneResult,
    stripe: StripePoints,
    names: Sequence[str],
    left_out: Mapping[str, str],
    wrong: Mapping[str, float],
) -> bytes:
    """Each picture's distance from the light plane, and that of every stripe point as a stroke at its place."""
    rms_mm = _picture_rms_mm(found, stripe, names, wrong)
    outliers = _outliers(rms_mm, names)
    bars = [Bar(name=name, value=float(rms), outlier=name in outliers) for name, rms in zip(names, rms_mm, strict=True)]
    field = Field(
        points_px=stripe.pixels,
        residuals=np.column_stack([np.zeros(len(stripe.pixels)), 1e3 * found.residuals_m]),
        unit="mm off the plane (down: beyond it)",
        width_px=found.camera.width_px,
        height_px=found.camera.height_px,
    )
    return residual_png("laser plane: stripe points off the plane", "mm rms", bars + _without(left_out), field)


def picture_rms(
    residuals: Float[np.ndarray, "n"], picture: Int[np.ndarray, "n"], count: int
) -> Float[np.ndarray, "count"]:
    """Root mean square of each picture; NaN for those without any."""
    number = np.bincount(picture, minlength=count)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(np.bincount(picture, residuals**2, minlength=count) / number)


def _picture_rms_mm(
    found: LaserPlaneResult, stripe: StripePoints, names: Sequence[str], wrong: Mapping[str, float]
) -> Float[np.ndarray, "k"]:
    used_mm = 1e3 * picture_rms(found.residuals_m, stripe.picture, len(names))
    return np.array([wrong.get(name, value) for name, value in zip(names, used_mm, strict=True)])


def _outliers(rms_mm: Float[np.ndarray, "k"], names: Sequence[str]) -> list[str]:
    if not np.isfinite(rms_mm).any():
        return []
    with np.errstate(invalid="ignore"):
        far = rms_mm > max(_OUTLYING * float(np.nanmedian(rms_mm)), _LEAST_OUTLYING_MM)
    return [name for name, out in zip(names, far, strict=True) if out]


def _without(left_out: Mapping[str, str]) -> list[Bar]:
    return [Bar(name=name, value=float("nan"), outlier=True) for name in left_out]


def _left_out(left_out: Mapping[str, str]) -> list[str]:
    return [f"{name} is left out: {why}" for name, why in left_out.items()]


def _named(reason: str, names: Sequence[str]) -> str:
    """The reason with a picture's name in place of its number."""
    return re.sub(r"picture (\d+) \(counted from 0\)", lambda match: names[int(match[1])], reason)


def _with_unit(name: str) -> str:
    if name in _ANGLES:
        return f"{name}_deg"
    return f"{name}_px" if name in ("fx", "fy", "cx", "cy") else name

"""result.json: what a calibration of the user's own data found, in mm and degrees."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from weldcell.calib.compensation import CompensationResult
from weldcell.calib.consensus import WRONG_SHARE
from weldcell.calib.robust_hand_eye import RobustHandEyeResult
from weldcell.calib.touches import TouchResult
from weldcell.calib.verdict import Verdict
from weldcell.scenarios.atomic_file import write_text

_WORST: tuple[Verdict, ...] = ("refused", "doubtful", "accepted")
_COVARIANCE_OF = [f"rotation_sensor_{axis}_deg" for axis in "xyz"] + [f"translation_flange_{axis}_mm" for axis in "xyz"]
_COVARIANCE_UNITS = np.array([np.rad2deg(1.0)] * 3 + [1e3] * 3)


def write_report(path: Path, report: dict[str, Any]) -> None:
    """Writes the file; it appears when it is whole."""
    write_text(path, json.dumps(_plain(report), indent=2, allow_nan=False, ensure_ascii=False) + "\n")


def hand_eye_report(
    ids: Sequence[str],
    unseen: Sequence[str],
    found: RobustHandEyeResult,
    touched: tuple[TouchResult, CompensationResult] | None,
    doubts: Sequence[str],
    notes: Sequence[str],
) -> dict[str, Any]:
    """The report of a hand-eye calibration; `unseen` says why an id shows no target, or is empty."""
    seen_ids = [name for name, why in zip(ids, unseen, strict=True) if not why]
    outliers = [name for name, sound in zip(seen_ids, found.sound, strict=True) if not sound]
    outliers += [name for name, why in zip(ids, unseen, strict=True) if why]
    final = found if touched is None else touched[1]
    residuals_base = found.residuals_base.copy()
    if touched is not None:
        residuals_base[found.sound] = touched[1].residuals_base
    left_out = _left_out(ids, unseen, found)
    verdict, weighed = _weighed(found, touched)
    if verdict == "accepted" and (doubts or len(outliers) > WRONG_SHARE * len(ids)):
        verdict = "doubtful"
    refused = verdict == "refused"
    report: dict[str, Any] = {
        "estimate": None if refused else {"T_flange_sensor": _matrix_mm(final.T_flange_camera.as_matrix())},
        "targets": None if refused else _targets(ids, unseen, found),
        "covariance": final.covariance * np.outer(_COVARIANCE_UNITS, _COVARIANCE_UNITS),
        "covariance_of": _COVARIANCE_OF,
        "residuals": _residuals(seen_ids, residuals_base),
        "residual_rms_mm": final.rms_m * 1e3,
        "outliers": outliers,
        "condition_number": max(found.condition_number, final.condition_number),
        "observability": list(found.observability),
        "leave_one_out_rms_mm": found.leave_one_out_rms_m * 1e3 if touched is None else None,
        "verdict": verdict,
        "reasons": [*weighed, *doubts, *left_out],
        "notes": list(notes),
    }
    if touched is not None:
        report["touches"] = {
            "sphere_centre_base_mm": touched[0].centre_base * 1e3,
            "touch_rms_mm": touched[0].rms_m * 1e3,
            "compensation_rms_before_mm": touched[1].rms_before_m * 1e3,
            "compensation_rms_mm": touched[1].rms_m * 1e3,
        }
    return report


def _weighed(
    found: RobustHandEyeResult, touched: tuple[TouchResult, CompensationResult] | None
) -> tuple[Verdict, list[str]]:
    """The worst verdict of all steps, and all their reasons."""
    steps = (found,) if touched is None else (found, *touched)
    verdicts = [step.verdict for step in steps]
    reasons = [reason for step in steps for reason in step.reasons]
    if touched is not None and len(found.targets_base) > 1:
        verdicts.append("refused")
        reasons.append(
            "touches: the pose groups disagree about the sphere's place, so no touched centre holds for both"
        )
    return min(verdicts, key=_WORST.index), reasons


def _left_out(ids: Sequence[str], unseen: Sequence[str], found: RobustHandEyeResult) -> list[str]:
    """Why ids do not count, a line each."""
    seen_ids = [name for name, why in zip(ids, unseen, strict=True) if not why]
    lengths_mm = np.linalg.norm(found.residuals_base, axis=1) * 1e3
    outliers = [
        f"id {name} is an outlier: it misses the others' target by {length:.3g} mm"
        for name, length, sound in zip(seen_ids, lengths_mm, found.sound, strict=True)
        if not sound
    ]
    return outliers + [f"id {name} is left out: {why}" for name, why in zip(ids, unseen, strict=True) if why]


def _targets(ids: Sequence[str], unseen: Sequence[str], found: RobustHandEyeResult) -> list[dict[str, Any]]:
    """Each target's place, and the ids of the sound rows that it rests on."""
    seen_ids = [name for name, why in zip(ids, unseen, strict=True) if not why]
    several = len(found.targets_base) > 1
    return [
        {
            "place_base_mm": place * 1e3,
            "ids": [
                name
                for name, in_group, sound in zip(seen_ids, found.group, found.sound, strict=True)
                if sound and (not several or in_group == (index == 0))
            ],
        }
        for index, place in enumerate(found.targets_base)
    ]


def _residuals(ids: Sequence[str], residuals_base: Float[np.ndarray, "n 3"]) -> dict[str, dict[str, float]]:
    return {
        name: {
            **dict(zip(("x_mm", "y_mm", "z_mm"), row * 1e3, strict=True)),
            "length_mm": float(np.linalg.norm(row)) * 1e3,
        }
        for name, row in zip(ids, residuals_base, strict=True)
    }


def _matrix_mm(matrix: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    scaled = matrix.copy()
    scaled[:3, 3] *= 1e3
    return scaled


def _plain(value: Any) -> Any:
    """For JSON: lists and plain numbers, null for what is not finite."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(one) for one in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if np.isfinite(value) else None
    return value

"""What all recipes share: opening the station for a job, and closing with an outcome."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from jaxtyping import Float

from weldcell.calib.arm_model import ArmSlices
from weldcell.calib.compensation import CompensationResult
from weldcell.calib.hand_eye import HandEyeResult
from weldcell.calib.joint_estimate import JointResult
from weldcell.calib.touches import TouchResult
from weldcell.models.board import Board
from weldcell.scenarios.acceptance import failures, limits_for
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.results_table import results_markdown
from weldcell.scenarios.sensor_setup import SensorSetup
from weldcell.scenarios.station import Station


@contextmanager
def station_for(job: Job, boards: tuple[Board, ...] = ()) -> Iterator[Station]:
    """The station of a job, with its recording; `boards` are targets besides the usual parts."""
    title = f"{job.scenario}, robot {job.config.robot}, seed {job.seed}"
    with (
        Recording(job.recording_path, job.config.recording, title=title) as recording,
        Station(job.config, job.seed, recording, job.progress, boards) as station,
    ):
        yield station


def conclude(
    station: Station, title: str, metrics: Mapping[str, float | None], more_failures: tuple[str, ...] = ()
) -> Outcome:
    """The outcome, which also becomes the recording's results page."""
    outcome = Outcome(metrics=metrics, limits=limits_for(metrics), failures=failures(metrics) + more_failures)
    station.recording.log_text("results", f"# {title}\n\n{results_markdown(outcome)}")
    return outcome


def write_calibration(job: Job, setup: SensorSetup) -> None:
    """Leaves the results of calibration and compensation in the run's folder."""
    found: dict[str, HandEyeResult | CompensationResult | JointResult] = {
        "hand_eye_before": setup.first,
        "hand_eye": setup.compensated,
    }
    if setup.joint is not None:
        found |= {"hand_eye_p2": setup.compensated, "hand_eye": setup.joint}
    for name, result in found.items():
        write_hand_eye(job, name, result)
    touched = setup.touched
    tip = {
        "tip_flange_mm": 1e3 * touched.tip_flange,
        "sphere_centre_base_mm": 1e3 * touched.centre_base,
        "covariance": touched.covariance,
        "covariance_order": "sphere centre (m, base axes), tip (m, flange axes)",
    }
    job.write_calibration("tcp" if setup.joint is None else "tcp_p2", tip | _weight(touched))
    if setup.joint is not None:
        job.write_calibration("tcp", _joint_tip(setup.joint))
        job.write_calibration("arm", _arm_errors(setup.joint))


def write_hand_eye(job: Job, name: str, result: HandEyeResult | CompensationResult | JointResult) -> None:
    """Leaves where the sensor is on the flange in the run's folder."""
    content = {
        "T_flange_sensor": _matrix_mm(result.T_flange_camera.as_matrix()),
        "covariance": result.covariance,
        "covariance_order": "rotation vector (rad, sensor axes), translation (m, flange axes)",
    }
    job.write_calibration(name, content | _weight(result))


def _weight(result: HandEyeResult | CompensationResult | JointResult | TouchResult) -> dict[str, Any]:
    """How far a result may be trusted."""
    return {
        "rms_mm": 1e3 * result.rms_m,
        "condition_number": result.condition_number,
        "verdict": result.verdict,
        "reasons": list(result.reasons),
    }


def _joint_tip(joint: JointResult) -> dict[str, Any]:
    """Torch tip and sphere as the joint estimate has them."""
    return {
        "tip_flange_mm": 1e3 * joint.tip_flange,
        "sphere_centre_base_mm": 1e3 * joint.targets_base[0],
        "covariance": joint.tip_covariance,
        "covariance_order": "tip (m, flange axes)",
    } | _weight(joint)


def _arm_errors(joint: JointResult) -> dict[str, Any]:
    """The arm's and the sensor's errors, to be used with hand_eye and tcp of the same run only."""
    places, errors = ArmSlices.of(joint.arm.nominal.joints), joint.arm.errors
    return {
        "offsets_mm": 1e3 * errors[places.offsets].reshape(-1, 3),
        "twists_deg": np.degrees(errors[places.twists].reshape(-1, 3)),
        "zeros_deg": np.degrees(errors[places.zeros]),
        "compliances_urad_per_nm": 1e6 * errors[places.compliances],
        "axes": "one row a link, along and about the axes of the base at joint readings of zero",
        "plane_turn_deg": np.degrees(joint.sensor[:2]),
        "plane_offset_mm": 1e3 * joint.sensor[2],
        "focal_ratio": joint.sensor[3],
        "principal_px": joint.sensor[4:],
        "repeatability_deg": float(np.degrees(joint.sizes.joint_noise_rad)),
        "leave_one_out_rms_mm": 1e3 * joint.leave_one_out_rms_m,
    }


def _matrix_mm(T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """A rigid transform with its translation in mm, as the files have it."""
    return T * np.array([[1, 1, 1, 1e3]] * 3 + [[1, 1, 1, 1]])

"""What all recipes share: opening the station for a job, and closing with an outcome."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from jaxtyping import Float

from weldcell.scenarios.acceptance import failures, limits_for
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.results_table import results_markdown
from weldcell.scenarios.sensor_setup import SensorSetup
from weldcell.scenarios.station import Station


@contextmanager
def station_for(job: Job) -> Iterator[Station]:
    """The station of a job, with its recording."""
    title = f"{job.scenario}, robot {job.config.robot}, seed {job.seed}"
    with (
        Recording(job.recording_path, job.config.recording, title=title) as recording,
        Station(job.config, job.seed, recording, job.progress) as station,
    ):
        yield station


def conclude(station: Station, title: str, metrics: Mapping[str, float | None]) -> Outcome:
    """The outcome, which also becomes the recording's results page."""
    outcome = Outcome(metrics=metrics, limits=limits_for(metrics), failures=failures(metrics))
    station.recording.log_text("results", f"# {title}\n\n{results_markdown(outcome)}")
    return outcome


def write_calibration(job: Job, setup: SensorSetup) -> None:
    """Leaves the results of calibration and compensation in the run's folder."""
    for name, T_flange_camera, result in (
        ("hand_eye_before", setup.first.T_flange_camera, setup.first),
        ("hand_eye", setup.compensated.T_flange_camera, setup.compensated),
    ):
        job.write_calibration(
            name,
            {
                "T_flange_sensor": _matrix_mm(T_flange_camera.as_matrix()),
                "covariance": result.covariance,
                "covariance_order": "rotation vector (rad, sensor axes), translation (m, flange axes)",
                "rms_mm": 1e3 * result.rms_m,
                "condition_number": result.condition_number,
                "verdict": result.verdict,
                "reasons": list(result.reasons),
            },
        )
    touched = setup.touched
    job.write_calibration(
        "tcp",
        {
            "tip_flange_mm": 1e3 * touched.tip_flange,
            "sphere_centre_base_mm": 1e3 * touched.centre_base,
            "covariance": touched.covariance,
            "covariance_order": "sphere centre (m, base axes), tip (m, flange axes)",
            "rms_mm": 1e3 * touched.rms_m,
            "condition_number": touched.condition_number,
            "verdict": touched.verdict,
            "reasons": list(touched.reasons),
        },
    )


def _matrix_mm(T: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """A rigid transform with its translation in mm, as the files have it."""
    return T * np.array([[1, 1, 1, 1e3]] * 3 + [[1, 1, 1, 1]])

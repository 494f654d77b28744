"""The S-shaped V-groove scanned with a calibrated sensor, and compared with the exact seam."""

from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recipe import conclude, station_for, write_calibration
from weldcell.scenarios.seam_tracking import seam_metrics, track_seam
from weldcell.scenarios.sensor_setup import set_up_sensor


def run(job: Job) -> Outcome:
    """Torch errors along the seam."""
    with station_for(job) as station:
        setup = set_up_sensor(station)
        write_calibration(job, setup)
        metrics = setup.metrics(station) | seam_metrics(station, track_seam(station, setup.after), setup.after)
        return conclude(station, "V-groove seam", metrics)

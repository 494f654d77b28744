"""P1's experiment: 300 pictures along the U seam on a free-form surface, the fitted track against the exact one."""

from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.morphology_track import morphology_metrics, track_both
from weldcell.scenarios.recipe import conclude, station_for, write_calibration
from weldcell.scenarios.seam_tracking import seam_metrics
from weldcell.scenarios.sensor_setup import set_up_sensor


def run(job: Job) -> Outcome:
    """Torch errors along the seam, by the joint's finder and by P1's morphology."""
    with station_for(job) as station:
        setup = set_up_sensor(station)
        write_calibration(job, setup)
        tracked, watch = track_both(station, setup.after)
        metrics = setup.metrics(station) | seam_metrics(station, tracked, setup.after)
        return conclude(station, "U seam", metrics | morphology_metrics(station, tracked, setup.after, watch))

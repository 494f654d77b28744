"""Hand-eye on the standard sphere, compensation by touches, and torch errors near and far."""

from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recipe import conclude, station_for, write_calibration
from weldcell.scenarios.sensor_setup import set_up_sensor
from weldcell.scenarios.verification import verify


def run(job: Job) -> Outcome:
    """How well the torch finds what the sensor saw."""
    with station_for(job) as station:
        setup = set_up_sensor(station)
        write_calibration(job, setup)
        metrics = setup.metrics(station) | verify(station, setup.alignments)
        return conclude(station, "Hand-eye on the sphere", metrics)

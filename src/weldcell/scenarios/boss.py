"""The boss scanned with a calibrated sensor, and measured."""

from weldcell.scenarios.boss_scan import boss_metrics, scan_boss
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recipe import conclude, station_for, write_calibration
from weldcell.scenarios.sensor_setup import set_up_sensor


def run(job: Job) -> Outcome:
    """Errors of the boss's edges and angles."""
    with station_for(job) as station:
        setup = set_up_sensor(station)
        write_calibration(job, setup)
        metrics = setup.metrics(station) | boss_metrics(station, scan_boss(station, setup.after))
        return conclude(station, "Boss", metrics)

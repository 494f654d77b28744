"""The main job: calibrate, compensate, verify, track the V-groove, scan the boss (paper P2 whole)."""

from weldcell.scenarios.boss_scan import boss_metrics, scan_boss
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recipe import conclude, station_for, write_calibration
from weldcell.scenarios.seam_tracking import seam_metrics, track_seam
from weldcell.scenarios.sensor_setup import set_up_sensor
from weldcell.scenarios.verification import verify


def run(job: Job) -> Outcome:
    """What the whole commissioning measured."""
    with station_for(job) as station:
        setup = set_up_sensor(station)
        write_calibration(job, setup)
        metrics = setup.metrics(station) | verify(station, setup.alignments)
        metrics |= seam_metrics(station, track_seam(station, setup.after), setup.after)
        metrics |= boss_metrics(station, scan_boss(station, setup.after))
        return conclude(station, "Commissioning", metrics)

"""A seam welded in closed loop (or along a scan) on a part that lies elsewhere than was told, and drifts."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadInput
from weldcell.cell.seam import length_along
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.recipe import conclude, station_for, write_calibration
from weldcell.scenarios.seam_tracking import joint_kind, track_seam
from weldcell.scenarios.sensor_setup import set_up_sensor
from weldcell.scenarios.station import Station
from weldcell.scenarios.welding.arc_guide import ByArc
from weldcell.scenarios.welding.guide import AsTaught, ByLaser, Guide
from weldcell.scenarios.welding.lookout import STAGE, middle_features
from weldcell.scenarios.welding.moving_part import MovingPart, drift_base, misplaced
from weldcell.scenarios.welding.torch_path import TorchPath, taught_along, way_along
from weldcell.scenarios.welding.weld_pass import WeldPass
from weldcell.scenarios.welding.weld_report import record_weld, weld_errors, weld_metrics
from weldcell.tracking.taught_path import TaughtPath
from weldcell.tracking.weaving import Weave

_LIFT_M, _LIFT_STEPS = 0.08, 20


def run(job: Job) -> Outcome:
    """What the torch missed the exact seam by."""
    with station_for(job) as station:
        setup = set_up_sensor(station)
        write_calibration(job, setup)
        metrics, failures = weld(station, setup.after)
        return conclude(station, "Weld", setup.metrics(station) | metrics, failures)


def weld(station: Station, alignment: Alignment) -> tuple[dict[str, float | None], tuple[str, ...]]:
    """Errors of the weld, and why it is not acceptable if it came to a stop before the seam's end."""
    config = station.config.weld
    misplacement = misplaced(config, station.seed)
    taught = _taught(station, alignment, misplacement)
    station.begin(STAGE, "Weld")
    station.place_plate(misplacement)
    seam = station.parts.plate.middle_seam()
    part = MovingPart(
        T_base_told=station.told_plate(),
        misplacement=misplacement,
        drift_base=drift_base(config, station.seed),
        weld_s=(taught.end_m - taught.start_m) / (1e-3 * config.speed_mm_s),
        seam_part=seam,
    )
    path = TorchPath.along(taught, config, station, alignment)
    weave = _weave(station)
    weld_pass = WeldPass(station, alignment, path, part, _guide(station, taught, weave), weave)
    station.go(way_along(station, path, weld_pass.start_m))
    trace = weld_pass.run()
    exact = taught_along(seam, RigidTransform.identity())
    errors = weld_errors(trace, exact, path)
    record_weld(station, trace, errors, part)
    station.back_off(_LIFT_M, _LIFT_STEPS)
    failures = () if trace.stop_kind == "end" else (f"the weld stopped: {trace.stop_reason}",)
    return weld_metrics(trace, errors, exact, path, weld_pass.lookout), failures


def _taught(station: Station, alignment: Alignment, misplacement: RigidTransform) -> TaughtPath:
    """The seam that the controller expects: as drawn where the part is told to lie, or as a scan found it."""
    drawn = taught_along(station.parts.plate.middle_seam(), station.told_plate())
    if station.config.weld.guidance != "scan":
        return drawn
    tracked = track_seam(station, alignment, misplacement)
    names = middle_features(joint_kind(station))
    line_base = np.mean([tracked.seam.points[name] for name in names], axis=0)
    at_m, _, _ = drawn.project(line_base)
    places = drawn.places(at_m)
    return TaughtPath(
        arc_length_m=length_along(line_base),
        points_base=line_base,
        lefts_base=places.lefts,
        ups_base=places.ups,
    )


def _guide(station: Station, taught: TaughtPath, weave: Weave | None) -> Guide:
    config = station.config
    if config.weld.guidance == "laser":
        return ByLaser(taught, drift=config.weld.drift_model)
    if config.weld.guidance == "arc":
        assert weave is not None
        return ByArc(taught, weave, config.seam)
    return AsTaught(taught)


def _weave(station: Station) -> Weave | None:
    config = station.config.weld
    shape = "sine" if config.guidance == "arc" and config.weave == "none" else config.weave
    if shape == "none":
        return None
    if config.weave_amplitude_mm == 0:
        raise BadInput("weld.weave_amplitude_mm: found 0, expected more where the torch weaves")
    return Weave(amplitude_m=1e-3 * config.weave_amplitude_mm, frequency_hz=config.weave_hz, shape=shape)

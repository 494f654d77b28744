"""P1's hand-eye calibration: a fixed point, pure translations and free poses, as the controller shows them."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib import hand_eye
from weldcell.cell.frames import difference, rigid_from
from weldcell.models.pyramid import Pyramid
from weldcell.scenarios.atomic_file import write_text
from weldcell.scenarios.job import Job, Outcome
from weldcell.scenarios.point_sights import PointSight, plan_point_views, take_point_sights
from weldcell.scenarios.recipe import conclude, station_for, write_hand_eye
from weldcell.scenarios.run_folder import CALIBRATION
from weldcell.scenarios.station import Station

_FEWEST = 4
_SHOWN_MM, _SHOWN_DEG = 2, 2  # digits after the point, as in P1's table III


def run(job: Job) -> Outcome:
    """How well P1's two steps find the camera on the flange."""
    target = Pyramid()
    with station_for(job, boards=(target,)) as station:
        sights, translations = _see_point(station, target)
        if min(translations, len(sights) - translations) < _FEWEST:
            failure = f"{translations} translations and {len(sights) - translations} free views show the point"
            return _outcome(station, None, np.nan, (f"{failure}, expected {_FEWEST} of each",))
        shown = _shown(sights)
        found = hand_eye.solve(
            hand_eye.HandEyeProblem(
                T_base_flange=shown,
                centres_camera=np.array([sight.apex.apex_camera for sight in sights]),
                translations=np.arange(len(sights)) < translations,
                covariances_camera=np.array([sight.apex.covariance_camera for sight in sights]),
                pose_sigma_m=1e-3 * job.config.calibration.robot_sigma_mm,
            )
        )
        write_hand_eye(job, "hand_eye", found)
        _write_tables(job, sights, shown)
        refused = tuple(f"hand-eye refused: {reason}" for reason in found.reasons) if found.verdict == "refused" else ()
        return _outcome(station, found, found.rms_m, refused)


def _see_point(station: Station, target: Pyramid) -> tuple[list[PointSight], int]:
    """All views, translations first, and how many these are."""
    plan = station.config.calibration
    turned = Rotation.from_euler("z", station.heading_rad)
    station.place_target(target.name, rigid_from(turned, station.sphere_known_base))
    still, free = plan_point_views(station, station.sphere_known_base, plan.translations, plan.free_poses)
    station.begin("translations", "Pure translations")
    first = take_point_sights(station, target, still, "translations", "see the point, pure translations")
    station.begin("free", "Free poses")
    return [*first, *take_point_sights(station, target, free, "free", "see the point, free poses")], len(first)


def _shown(sights: list[PointSight]) -> RigidTransform:
    """The flange poses as a controller shows them: XYZ angles and places with two digits after the point."""
    T_base_flange = RigidTransform.concatenate([sight.T_base_flange for sight in sights])
    angles_deg = np.round(T_base_flange.rotation.as_euler("XYZ", degrees=True), _SHOWN_DEG)
    places_mm = np.round(1e3 * T_base_flange.translation, _SHOWN_MM)
    return rigid_from(Rotation.from_euler("XYZ", angles_deg, degrees=True), 1e-3 * places_mm)


def _write_tables(job: Job, sights: list[PointSight], shown: RigidTransform) -> None:
    """P1's tables II and III of this run, for `weldcell calibrate hand-eye --target point --euler XYZ`."""
    angles_deg = shown.rotation.as_euler("XYZ", degrees=True)
    poses = ["id,x_mm,y_mm,z_mm,rx_deg,ry_deg,rz_deg"]
    points = ["id,x_mm,y_mm,z_mm"]
    for index, sight in enumerate(sights):
        numbers = [f"{value:.2f}" for value in (*(1e3 * shown[index].translation), *angles_deg[index])]
        poses.append(",".join([str(index + 1), *numbers]))
        points.append(",".join([str(index + 1), *(f"{value:.4f}" for value in 1e3 * sight.apex.apex_camera)]))
    write_text(job.folder / CALIBRATION / "poses.csv", "\n".join(poses) + "\n")
    write_text(job.folder / CALIBRATION / "points.csv", "\n".join(points) + "\n")


def _outcome(
    station: Station, found: hand_eye.HandEyeResult | None, rms_m: float, failures: tuple[str, ...]
) -> Outcome:
    metrics: dict[str, float | None] = {"hand_eye_rotation_error_deg": None, "hand_eye_translation_error_mm": None}
    if found is not None:
        angle_rad, distance_m = difference(found.T_flange_camera, station.cell.T_flange_camera)
        metrics["hand_eye_rotation_error_deg"] = float(np.degrees(angle_rad))
        metrics["hand_eye_translation_error_mm"] = 1e3 * distance_m
        metrics["point_spread_mm"] = 1e3 * rms_m
    outcome = conclude(station, "Hand-eye on a fixed point", metrics)
    return Outcome(metrics=outcome.metrics, limits=outcome.limits, failures=(*outcome.failures, *failures))

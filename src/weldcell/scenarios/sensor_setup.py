"""Calibrate and compensate: P2's procedure on the standard sphere, step by step."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib import compensation, hand_eye, touches
from weldcell.cell.errors import JobFailed
from weldcell.cell.frames import difference
from weldcell.scenarios.sphere_sights import CALIBRATING, SphereSight, plan_free, plan_translations, take_sights
from weldcell.scenarios.station import Station
from weldcell.scenarios.touching import touch_sphere
from weldcell.scenarios.verification import Alignment

_FEWEST_SIGHTS = 3


@dataclass(frozen=True, kw_only=True)
class SensorSetup:
    """What calibration and compensation found."""

    first: hand_eye.HandEyeResult
    """From the sights alone."""
    touched: touches.TouchResult
    """Sphere and torch tip from touches."""
    compensated: compensation.CompensationResult
    """The sights aligned with the touched sphere."""
    before: Alignment
    """As it is before compensation: first solution, nominal tip."""
    after: Alignment
    """As it is afterwards."""
    sights: list[SphereSight]
    """All views of the sphere, translations first."""

    def metrics(self, station: Station) -> dict[str, float]:
        """Errors of the final hand-eye transform against the truth, and how well the views agree."""
        angle_rad, distance_m = difference(self.after.T_flange_camera, station.cell.T_flange_camera)
        return {
            "hand_eye_rotation_error_deg": float(np.degrees(angle_rad)),
            "hand_eye_translation_error_mm": 1e3 * distance_m,
            "sphere_centre_spread_mm": 1e3 * self.compensated.rms_m,
        }


def set_up_sensor(station: Station) -> SensorSetup:
    """Ten translations and ten free views of the sphere, sixty touches, and the two solutions."""
    plan = station.config.calibration
    station.begin("calibration", "Calibration on the sphere")
    station.place_sphere(station.sphere_known_base, stage="calibrate")
    drawn = station.drawing_T_flange_camera
    postures = plan_translations(station, station.sphere_known_base, plan.translations)
    sights = take_sights(station, postures, drawn, "translations", "sphere: translations")
    translations = len(sights)
    postures = plan_free(station, station.sphere_known_base, plan.free_poses, CALIBRATING, "free poses")
    sights += take_sights(station, postures, drawn, "free poses", "sphere: free poses")
    if translations < _FEWEST_SIGHTS or len(sights) - translations < _FEWEST_SIGHTS:
        raise JobFailed(
            f"sphere: found in {translations} of {plan.translations} translations and {len(sights) - translations} of "
            f"{plan.free_poses} free poses, expected at least {_FEWEST_SIGHTS} each"
        )
    first = _first_solution(sights, translations)
    touched = _touch(station, first.target_base, _flanges(sights[translations - 1 :]).rotation)
    compensated = _compensate(sights, touched, first, 1e-3 * plan.robot_sigma_mm)
    return SensorSetup(
        first=first,
        touched=touched,
        compensated=compensated,
        before=Alignment(T_flange_camera=first.T_flange_camera, tip_flange=station.tip_nominal_flange),
        after=Alignment(T_flange_camera=compensated.T_flange_camera, tip_flange=touched.tip_flange),
        sights=sights,
    )


def _first_solution(sights: list[SphereSight], translations: int) -> hand_eye.HandEyeResult:
    result = hand_eye.solve(
        hand_eye.HandEyeProblem(
            T_base_flange=_flanges(sights),
            centres_camera=_centres(sights),
            translations=np.arange(len(sights)) < translations,
        )
    )
    _require(result.verdict, result.reasons, "hand-eye")
    return result


def _touch(station: Station, target_base: Float[np.ndarray, "3"], orientations: Rotation) -> touches.TouchResult:
    plan = station.config.calibration
    station.begin("touches", "Touches with the torch")
    T_base_flange = touch_sphere(station, target_base, orientations, plan.touches)
    result = touches.solve(
        touches.TouchProblem(
            T_base_flange=T_base_flange,
            tip_flange=station.tip_nominal_flange,
            radius_m=station.parts.sphere_radius_m,
            tip_radius_m=station.parts.tip_radius_m,
            estimate_tip=plan.estimate_tip,
        )
    )
    _require(result.verdict, result.reasons, "touches")
    return result


def _compensate(
    sights: list[SphereSight], touched: touches.TouchResult, first: hand_eye.HandEyeResult, pose_sigma_m: float
) -> compensation.CompensationResult:
    result = compensation.solve(
        compensation.CompensationProblem(
            T_base_flange=_flanges(sights),
            centres_camera=_centres(sights),
            covariances_camera=np.array([seen.centre.covariance_camera for seen in sights]),
            centre_base=touched.centre_base,
            centre_covariance_base=touched.covariance[:3, :3],
            T_flange_camera=first.T_flange_camera,
            pose_sigma_m=pose_sigma_m,
        )
    )
    _require(result.verdict, result.reasons, "compensation")
    return result


def _flanges(sights: list[SphereSight]) -> RigidTransform:
    return RigidTransform.concatenate([seen.T_base_flange for seen in sights])


def _centres(sights: list[SphereSight]) -> Float[np.ndarray, "n 3"]:
    return np.array([seen.centre.centre_camera for seen in sights])


def _require(verdict: str, reasons: tuple[str, ...], what: str) -> None:
    if verdict == "refused":
        raise JobFailed(f"{what} refused: {'; '.join(reasons)}")

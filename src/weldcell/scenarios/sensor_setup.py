"""Calibrate and compensate: P2's procedure on the standard sphere, step by step, and the joint estimate after it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.calib import compensation, hand_eye, touches
from weldcell.calib.joint_estimate import JointResult
from weldcell.cell.errors import BadInput, JobFailed
from weldcell.cell.frames import difference
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.joint_setup import SphereData, estimate_jointly
from weldcell.scenarios.sphere_sights import (
    CALIBRATING,
    SphereSight,
    centres_base,
    plan_free,
    plan_translations,
    take_sights,
)
from weldcell.scenarios.station import Station
from weldcell.scenarios.touching import touch_sphere

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
    joint: JointResult | None
    """Everything from all sights and touches; None if the method is P2's."""
    alignments: dict[str, Alignment]
    """What is known `before` compensation (first solution, nominal tip), by P2's way (`p2`, where it is not the last),
    and `after` everything."""
    sights: list[SphereSight]
    """All views of the sphere, translations first."""

    @property
    def after(self) -> Alignment:
        """What work goes on with."""
        return self.alignments["after"]

    def metrics(self, station: Station) -> dict[str, float]:
        """Errors of the final hand-eye transform against the truth, and how well the views agree."""
        angle_rad, distance_m = difference(self.after.T_flange_camera, station.cell.T_flange_camera)
        centre_base = self.touched.centre_base if self.joint is None else self.joint.targets_base[0]
        offsets = centres_base(station, self.sights, self.after) - centre_base
        return {
            "hand_eye_rotation_error_deg": float(np.degrees(angle_rad)),
            "hand_eye_translation_error_mm": 1e3 * distance_m,
            "sphere_centre_spread_mm": 1e3 * float(np.sqrt(np.mean(np.sum(offsets**2, axis=1)))),
        }


def set_up_sensor(station: Station) -> SensorSetup:
    """Ten translations and ten free views of the sphere, sixty touches, and what follows from them."""
    plan = station.config.calibration
    if any(plan.second_sphere_mm) and station.config.method != "joint":
        raise BadInput("calibration.second_sphere_mm: a second sphere needs --method joint")
    sights, translations = _see_sphere(station)
    first = _first_solution(sights, translations)
    station.begin("touches", "Touches with the torch")
    orientations = _flanges(sights[translations - 1 :]).rotation
    touches_rad = touch_sphere(station, first.target_base, orientations, plan.touches)
    touched = _touched(station, touches_rad)
    compensated = _compensate(sights, touched, first, 1e-3 * plan.robot_sigma_mm)
    before = Alignment(T_flange_camera=first.T_flange_camera, tip_flange=station.tip_nominal_flange)
    p2 = Alignment(T_flange_camera=compensated.T_flange_camera, tip_flange=touched.tip_flange)
    joint, alignments = None, {"before": before, "after": p2}
    if station.config.method == "joint":
        spheres, bar_m = [SphereData(sights=sights, touches_rad=touches_rad)], None
        if any(plan.second_sphere_mm):
            bar_m = 1e-3 * float(np.linalg.norm(plan.second_sphere_mm))
            spheres.append(_second_sphere(station, touched.centre_base, bar_m))
        joint = estimate_jointly(station, spheres, compensated.T_flange_camera, bar_m)
        _require(joint.verdict, joint.reasons, "joint estimate")
        alignments = {"before": before, "p2": p2, "after": _joint_alignment(joint)}
    return SensorSetup(
        first=first,
        touched=touched,
        compensated=compensated,
        joint=joint,
        alignments=alignments,
        sights=sights,
    )


def _see_sphere(station: Station) -> tuple[list[SphereSight], int]:
    """The views that found the sphere, translations first, and how many of them are translations."""
    plan = station.config.calibration
    station.begin("calibration", "Calibration on the sphere")
    station.place_sphere(station.sphere_known_base, stage="calibrate")
    drawn = station.head.T_flange_camera
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
    return sights, translations


def _second_sphere(station: Station, first_base: Float[np.ndarray, "3"], bar_m: float) -> SphereData:
    """Free views and touches of a second sphere on a bar with the first, which stands where `first_base` found it."""
    plan = station.config.calibration
    first_actual_base = station.cell.T_base_part("sphere").translation
    known_base = first_base + 1e-3 * np.array(plan.second_sphere_mm)
    station.begin("second sphere", "The second sphere of the bar")
    station.place_sphere(known_base, stage="second sphere", bar=(first_actual_base, bar_m))
    postures = plan_free(station, known_base, plan.free_poses, CALIBRATING, "second sphere")
    sights = take_sights(station, postures, station.head.T_flange_camera, "second sphere", "second sphere: free poses")
    if len(sights) < _FEWEST_SIGHTS:
        raise JobFailed(f"second sphere: found in {len(sights)} views, expected at least {_FEWEST_SIGHTS}")
    touches_rad = touch_sphere(station, known_base, _flanges(sights).rotation, plan.touches, "second touch")
    return SphereData(sights=sights, touches_rad=touches_rad)


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


def _joint_alignment(joint: JointResult) -> Alignment:
    return Alignment(
        T_flange_camera=joint.T_flange_camera, tip_flange=joint.tip_flange, arm=joint.arm, sensor=joint.sensor
    )


def _touched(station: Station, touches_rad: Float[np.ndarray, "m 6"]) -> touches.TouchResult:
    result = touches.solve(
        touches.TouchProblem(
            T_base_flange=station.controller.forward(touches_rad),
            tip_flange=station.tip_nominal_flange,
            radius_m=station.parts.sphere_radius_m,
            tip_radius_m=station.parts.tip_radius_m,
            estimate_tip=station.config.calibration.estimate_tip,
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

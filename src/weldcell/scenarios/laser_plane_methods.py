"""The methods of laser plane calibration side by side: solved on the same pictures, compared with the truth."""

from dataclasses import dataclass

import numpy as np

from weldcell.calib import dual_step, laser_plane, vanishing_point
from weldcell.calib.camera import FREE, CameraProblem
from weldcell.calib.camera import solve as solve_camera
from weldcell.calib.verdict import Verdict
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.randomness import generator
from weldcell.scenarios.board_sights import CORNER_SIGMA_PX, with_noise
from weldcell.scenarios.laser_plane_sights import LaserPlaneSights, noisy_targets

METHODS = ("vanishing_point", "board", "dual_step", "bundle")
_CROSSING_SIGMA_PX = 0.05
_DRAWN_OFF_RAD, _DRAWN_OFF_M = np.radians(0.7), 0.5e-3  # how far the head is from its drawing (one sigma)


@dataclass(frozen=True, kw_only=True, eq=False)
class MethodResult:
    """One method's sensor."""

    camera: CameraModel
    """Intrinsics that it took, or found."""
    plane: LaserPlane
    covariance: np.ndarray
    """Of the normal's two tilts along the laser frame's x and z (rad) and the offset (m)."""
    verdict: Verdict
    reasons: tuple[str, ...]
    condition_number: float


def solve_all(sights: LaserPlaneSights, drawn: LaserPlane, tilted: bool) -> dict[str, MethodResult]:
    """Each method's answer; the camera of all but the bundle is the one found from the chessboards alone."""
    camera, free = sights.camera.camera, FREE["tilted" if tilted else "plain"]
    sigma_px = max(CORNER_SIGMA_PX, sights.camera.rms_px / np.sqrt(2))
    crossing_px = float(np.hypot(_CROSSING_SIGMA_PX, sigma_px))

    def boards(method: laser_plane.Method, free: tuple[str, ...] = ()) -> laser_plane.LaserPlaneResult:
        return laser_plane.solve(
            laser_plane.LaserPlaneProblem(
                camera=camera,
                corners=sights.corners,
                stripe=sights.stripe,
                method=method,
                free=free,
                corner_sigma_px=sigma_px,
            )
        )

    lines = vanishing_point.VanishingPointProblem(
        camera=camera, pixels=sights.crossings_px, spacing_m=sights.spacing_m, sigma_px=crossing_px
    )
    steps = dual_step.DualStepProblem(camera=camera, targets=sights.targets, start=drawn)
    bundle = boards("bundle", free)
    return {
        "vanishing_point": _result(vanishing_point.solve(lines), camera),
        "board": _result(boards("board"), camera),
        "dual_step": _result(dual_step.solve(steps), camera),
        "bundle": _result(bundle, bundle.camera),
    }


def drawn_plane(plane: LaserPlane, rng: np.random.Generator) -> LaserPlane:
    """A plane as the drawing has it: the sensor was built a little otherwise."""
    normal = plane.normal_camera + _DRAWN_OFF_RAD * rng.normal(size=3)
    return LaserPlane(
        normal_camera=normal / np.linalg.norm(normal), offset_m=plane.offset_m + _DRAWN_OFF_M * rng.normal()
    )


def errors(result: MethodResult, camera: CameraModel, plane: LaserPlane) -> dict[str, float]:
    """How far a result is from the true sensor.

    The light plane is given in the camera's frame, which hangs on the intrinsics: a principal point that is off by 1 px
    turns that frame by a pixel's angle. The first three errors are those after it has been turned back, which is what
    measured points feel; the `raw` ones are the plain differences of the numbers.
    """
    turned = laser_plane.agreement(camera, plane, result.camera, result.plane)
    angle_rad, base_m = laser_plane.angle_and_base(plane)
    found_rad, found_m = laser_plane.angle_and_base(turned.other_plane)
    raw_rad, raw_m = laser_plane.angle_and_base(result.plane)
    return {
        "theta_error_deg": float(np.degrees(abs(found_rad - angle_rad))),
        "base_error_mm": 1e3 * abs(found_m - base_m),
        "plane_rms_um": 1e6 * turned.plane_rms_m,
        "normal_error_deg": float(np.degrees(turned.normal_rad)),
        "theta_raw_error_deg": float(np.degrees(abs(raw_rad - angle_rad))),
        "base_raw_error_mm": 1e3 * abs(raw_m - base_m),
    }


def noise_table(
    sights: LaserPlaneSights,
    drawn: LaserPlane,
    truth: tuple[CameraModel, LaserPlane],
    *,
    levels_px: tuple[float, ...],
    repeats: int,
    tilted: bool,
    axis: int,
    seed: int,
) -> dict[str, float]:
    """Median errors of each method with normal noise added to all that was found in the pictures."""
    table: dict[str, float] = {}
    for level_px in levels_px:
        drawn_errors: dict[str, list[dict[str, float]]] = {name: [] for name in METHODS}
        for repeat in range(repeats if level_px > 0 else 1):
            rng = generator(seed, f"boards/noise {level_px}", repeat)
            noisy = _noisy(sights, level_px, tilted, axis, rng)
            for name, result in solve_all(noisy, drawn, tilted).items():
                drawn_errors[name].append(errors(result, *truth))
        label = f"{level_px:g}".replace(".", "_")
        for name, found in drawn_errors.items():
            for quantity in ("theta_error_deg", "plane_rms_um"):
                stem, unit = quantity.rsplit("_", 1)
                values = [one[quantity] for one in found]
                table[f"{name}_{stem}_at_{label}_px_{unit}"] = float(np.median(values))
    return table


def _noisy(
    sights: LaserPlaneSights, noise_px: float, tilted: bool, axis: int, rng: np.random.Generator
) -> LaserPlaneSights:
    """The sights with noise, and the camera as the noisy corners give it."""
    corners, stripe = with_noise(sights.corners, sights.stripe, noise_px, axis, rng)
    camera = sights.camera
    if noise_px > 0:
        start = sights.camera.camera
        camera = solve_camera(
            CameraProblem(
                width_px=start.width_px,
                height_px=start.height_px,
                corners=corners,
                lens="tilted" if tilted else "plain",
                sigma_px=float(np.hypot(CORNER_SIGMA_PX, noise_px)),
                hold_out=False,
            )
        )
    return LaserPlaneSights(
        camera=camera,
        corners=corners,
        stripe=stripe,
        crossings_px=sights.crossings_px + noise_px * rng.normal(size=sights.crossings_px.shape),
        spacing_m=sights.spacing_m,
        targets=noisy_targets(sights.targets, noise_px, axis, rng),
    )


def _result(
    found: vanishing_point.VanishingPointResult | laser_plane.LaserPlaneResult | dual_step.DualStepResult,
    camera: CameraModel,
) -> MethodResult:
    return MethodResult(
        camera=camera,
        plane=found.plane,
        covariance=found.covariance,
        verdict=found.verdict,
        reasons=found.reasons,
        condition_number=found.condition_number,
    )

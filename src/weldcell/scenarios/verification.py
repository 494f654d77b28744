"""Torch errors at points: how far the actual tip would miss when it is sent to where the sensor saw them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import JobFailed
from weldcell.cell.randomness import generator
from weldcell.scenarios.sphere_sights import WORKING, SphereSight, plan_free, take_sights
from weldcell.scenarios.station import Station


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """What is known at one time of sensor and torch."""

    T_flange_camera: RigidTransform
    """Hand-eye transform."""
    tip_flange: Float[np.ndarray, "3"]
    """Torch tip in the flange, m."""


@dataclass(frozen=True, kw_only=True)
class PointCheck:
    """One point seen from several viewpoints."""

    name: str
    point_base: Float[np.ndarray, "3"]
    """The exact point, m."""
    sights: list[SphereSight]
    """The viewpoints in which it was found."""


def visit_point(station: Station, name: str, offset_m: Float[np.ndarray, "3"], alignment: Alignment) -> PointCheck:
    """The standard sphere put at an offset from its place, and seen from the configured number of viewpoints.

    The point is the sphere's centre: a target whose place is exact and that no light plane can miss.
    """
    known_base = station.sphere_known_base + offset_m
    station.place_sphere(known_base, stage=name)
    postures = plan_free(station, known_base, station.config.calibration.viewpoints, WORKING, name)
    title = f"verify {name.replace('_', ' ')}"
    sights = take_sights(station, postures, alignment.T_flange_camera, name, title)
    if not sights:
        raise JobFailed(f"verification: {name} was not found in any of {len(postures)} views")
    return PointCheck(name=name, point_base=station.cell.T_base_part("sphere").translation, sights=sights)


def tips_base(station: Station, check: PointCheck, alignment: Alignment) -> Float[np.ndarray, "n 3"]:
    """Where the actual tip goes for each viewpoint, the flange keeping the orientation of the view (m)."""
    tips = []
    for index, seen in enumerate(check.sights):
        point_base = (seen.T_base_flange * alignment.T_flange_camera).apply(seen.centre.centre_camera)
        rng = generator(station.seed, f"{check.name}/send", index)
        tips.append(station.send_torch(point_base, seen.T_base_flange.rotation, alignment.tip_flange, rng))
    return np.array(tips)


def verify(station: Station, before: Alignment, after: Alignment) -> dict[str, float]:
    """Mean torch errors (mm) at the points near the sphere and over those far from it, before and after."""
    plan = station.config.calibration
    station.begin("verification", "Verification at points")
    metrics: dict[str, float] = {}
    for where, offsets_mm in (("point", plan.near_points_mm), ("far", plan.far_points_mm)):
        checks = [
            visit_point(station, f"{where}_{k + 1}", 1e-3 * np.array(offset_mm), after)
            for k, offset_mm in enumerate(offsets_mm)
        ]
        tips = {
            when: {check.name: tips_base(station, check, alignment) for check in checks}
            for when, alignment in (("before", before), ("after", after))
        }
        errors = {
            when: [1e3 * np.linalg.norm(found[check.name] - check.point_base, axis=1) for check in checks]
            for when, found in tips.items()
        }
        if where == "far":
            metrics |= {f"far_error_{when}_mm": float(np.concatenate(e).mean()) for when, e in errors.items() if e}
        else:
            for k in range(len(checks)):
                metrics |= {f"point_{k + 1}_error_{when}_mm": float(e[k].mean()) for when, e in errors.items()}
        if checks:
            exact = {check.name: check.point_base for check in checks}
            station.recording.log_points(exact, tips, frame=station.frame, time_s=station.time_s)
    return metrics

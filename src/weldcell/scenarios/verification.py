"""Torch errors at points: how far the actual tip would miss when it is sent to where the sensor saw them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import JobFailed
from weldcell.cell.randomness import generator
from weldcell.scenarios.alignment import Alignment
from weldcell.scenarios.sphere_sights import (
    WORKING,
    SphereSight,
    centres_base,
    flanges_of,
    plan_free,
    take_sights,
)
from weldcell.scenarios.station import Station


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
    points_base = centres_base(station, check.sights, alignment)
    rotations = flanges_of(check.sights, alignment).rotation
    for index, point_base in enumerate(points_base):
        rng = generator(station.seed, f"{check.name}/send", index)
        tips.append(station.send_torch(point_base, rotations[index], alignment.tip_flange, rng, alignment.arm))
    return np.array(tips)


def verify(station: Station, alignments: Mapping[str, Alignment]) -> dict[str, float]:
    """Mean torch errors (mm) at the points near the sphere and over those far from it, for each alignment.

    The last one is what the recording shows.
    """
    plan = station.config.calibration
    station.begin("verification", "Verification at points")
    metrics: dict[str, float] = {}
    *_, last = alignments.values()
    for where, offsets_mm in (("point", plan.near_points_mm), ("far", plan.far_points_mm)):
        checks = [
            visit_point(station, f"{where}_{k + 1}", 1e-3 * np.array(offset_mm), last)
            for k, offset_mm in enumerate(offsets_mm)
        ]
        tips = {
            when: {check.name: tips_base(station, check, alignment) for check in checks}
            for when, alignment in alignments.items()
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

"""Torch errors at points: how far the actual tip would miss when it is sent to where the sensor saw them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.randomness import generator
from weldcell.scenarios.sphere_sights import SphereSight, plan_free, take_sights
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


def visit_point(station: Station, name: str, offset_m: Float[np.ndarray, "3"]) -> PointCheck:
    """The standard sphere put at an offset from its place, and seen from the configured number of viewpoints.

    The point is the sphere's centre: a target whose place is exact and that no light plane can miss.
    """
    known_base = station.sphere_known_base + offset_m
    station.place_sphere(known_base, stage=name)
    postures = plan_free(station, known_base, station.config.calibration.viewpoints, name)
    sights = take_sights(station, postures, name, f"verify {name.replace('_', ' ')}")
    return PointCheck(name=name, point_base=station.cell.T_base_part("sphere").translation, sights=sights)


def torch_errors_m(station: Station, check: PointCheck, alignment: Alignment) -> Float[np.ndarray, "n"]:
    """The miss of the actual tip for each viewpoint, the flange keeping the orientation of the view."""
    errors = []
    for index, seen in enumerate(check.sights):
        T_base_flange = seen.T_base_flange
        point_base = (T_base_flange * alignment.T_flange_camera).apply(seen.centre.centre_camera)
        rng = generator(station.seed, f"{check.name}/send", index)
        tip_base = station.send_torch(point_base, T_base_flange.rotation, alignment.tip_flange, rng)
        errors.append(np.linalg.norm(tip_base - check.point_base))
    return np.array(errors)

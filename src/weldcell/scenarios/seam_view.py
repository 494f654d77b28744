"""How the sensor is carried along a seam as drawn: how high, how leaning, and which way the torch trails.

The light plane meets the camera's axis on the seam's middle, the wire (and the light) comes against the joint's
approach, and the torch follows along the tangent. Where the arm cannot do that, or torch and head would touch the part,
other views of the same seam are tried: the nearest first. A fillet's web on the inside of a bend, for one, stands in
the way of a torch that trails along the tangent, but not of one that trails over the seam; and an arm that cannot
lean far enough still sees a fillet well from 20 deg to either plate.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import JointName
from weldcell.cell.seam import Seam
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.models.workpiece import MIDDLE
from weldcell.scenarios.scanning import ScanPath
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at, torch_rotations

_END_MARGIN_M = 0.012  # at the ends the section, square to the slanting path, would miss the plate's corners
_HIGHER_M = (0.0, 0.020)
_UPRIGHT_RAD = tuple(np.radians([0.0, 15.0, 25.0]))
_TRAILING = (0.0, 1.0)
_MOST_TURN_RAD = np.radians(30)  # of the light plane against the seam: the section is drawn out by 15 % there
_LEAN_RAD: dict[JointName, float] = {"bevel": -np.radians(10), "j": -np.radians(10)}
"""From the approach to the right: light and camera must see a square face, which stands along the approach."""
_MARGIN_SHARE = 0.04  # of the picture, that features keep from its border


@dataclass(frozen=True, kw_only=True)
class SeamView:
    """One way to look at a seam."""

    higher_m: float
    """How far the wire's tip is above where the configuration wants it, along the wire."""
    upright_rad: float
    """By how much, at most, the wire is turned from the joint's approach towards the vertical."""
    trailing: float
    """0: the torch trails along the tangent; 1: over the seam, turned by 30 deg from the tangent at most."""


def views() -> Iterator[SeamView]:
    """The usual view, then those that differ from it, the wire's lean last: it is what shows a joint well."""
    for upright_rad, trailing, higher_m in product(_UPRIGHT_RAD, _TRAILING, _HIGHER_M):
        yield SeamView(higher_m=higher_m, upright_rad=upright_rad, trailing=trailing)


def view_paths(station: Station) -> list[ScanPath]:
    """The ways to scan the seam as drawn on the part as the controller was told it lies, the usual one first.

    Others are left out where they would not show all of the joint's features.
    """
    usual, *others = (_Look.of(station, view) for view in views())
    return [usual.path, *(look.path for look in others if look.shows_all)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """A view of the station's seam."""

    station: Station
    features_base: Float[np.ndarray, "k n 3"]
    """Each drawn feature where each picture is taken."""
    path: ScanPath

    @staticmethod
    def of(station: Station, view: SeamView) -> "_Look":
        """The path along which the seam is seen this way."""
        config = station.config.seam
        drawn = _drawn(station)
        arc_length_m = np.linspace(
            drawn.arc_length_m[0] + _END_MARGIN_M, drawn.arc_length_m[-1] - _END_MARGIN_M, config.frames
        )
        T_base_part = station.planner.known_cell.T_base_part("plate")
        middle_base = T_base_part.apply(drawn.at(MIDDLE, arc_length_m))
        travel_base = np.gradient(middle_base, axis=0)
        travel_base /= np.linalg.norm(travel_base, axis=1, keepdims=True)
        assert drawn.approach is not None
        approach_base = T_base_part.rotation.apply(drawn.approach_at(arc_length_m))
        lean = Rotation.from_rotvec(_LEAN_RAD.get(config.joint, 0.0) * travel_base)
        approach_base = _towards_vertical(lean.apply(approach_base), view.upright_rad)
        turn = view.trailing * _turn_over_seam(station, drawn, arc_length_m, travel_base, approach_base)
        heading_base = Rotation.from_rotvec(turn[:, None] * approach_base).apply(travel_base)
        features_base = np.array([T_base_part.apply(drawn.at(name, arc_length_m)) for name in drawn.points])
        above_m = np.max(np.sum((features_base - middle_base) * approach_base, axis=2))
        crossing_m = above_m + 1e-3 * config.scan_height_mm + view.higher_m - station.head.below_tip_m
        path = ScanPath(
            points_base=middle_base + crossing_m * approach_base,
            torch_rotations=torch_rotations(heading_base, approach_base),
            speed_m_s=1e-3 * config.speed_mm_s,
        )
        return _Look(station=station, features_base=features_base, path=path)

    @property
    def shows_all(self) -> bool:
        """Whether all features, as drawn, lie well within the picture."""
        return all(self._shown(index).all() for index in range(len(self.path.points_base)))

    def _shown(self, index: int) -> Bool[np.ndarray, "k"]:
        head, camera = self.station.head, self.station.belief.camera
        rotation = self.path.torch_rotations[index] * T_FLANGE_TORCH.rotation.inv()
        T_base_flange: RigidTransform = flange_at(self.path.points_base[index], rotation, head.crossing_flange)
        points_camera = (T_base_flange * head.T_flange_camera).inv().apply(self.features_base[:, index])
        pixels = camera.project(points_camera)
        size = np.array([camera.width_px, camera.height_px])
        return np.all((pixels > _MARGIN_SHARE * size) & (pixels < (1 - _MARGIN_SHARE) * size), axis=1)


def _drawn(station: Station) -> Seam:
    """The part's seam with its middle line as one more, and with an approach: upright where nobody knows better."""
    part = station.parts.plate
    assert part.seam_part is not None
    middle = part.middle_seam()
    return replace(middle, points={**part.seam_part.points, **middle.points})


def _towards_vertical(directions_base: Float[np.ndarray, "n 3"], most_rad: float) -> Float[np.ndarray, "n 3"]:
    """These unit directions turned upwards by this angle, or until they are upright."""
    axis = np.cross(directions_base, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis, axis=1)
    angle = np.minimum(np.arctan2(sine, directions_base[:, 2]), most_rad)
    return Rotation.from_rotvec((angle / np.maximum(sine, 1e-12))[:, None] * axis).apply(directions_base)


def _turn_over_seam(
    station: Station,
    drawn: Seam,
    arc_length_m: Float[np.ndarray, "n"],
    travel_base: Float[np.ndarray, "n 3"],
    approach_base: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    """Angle about the approach from the tangent to a heading that leaves the torch over the seam, within limits.

    The torch trails by the look-ahead; before the seam's start the seam goes on straight.
    """
    T_base_part = station.planner.known_cell.T_base_part("plate")
    behind_m = arc_length_m - station.head.look_ahead_m
    start_m = drawn.arc_length_m[0]
    first = drawn.at(MIDDLE, np.array([start_m, start_m + 1e-3]))
    behind = drawn.at(MIDDLE, np.maximum(behind_m, start_m))
    behind += np.minimum(behind_m - start_m, 0.0)[:, None] * (first[1] - first[0]) / 1e-3
    chord_base = T_base_part.rotation.apply(drawn.at(MIDDLE, arc_length_m) - behind)
    across = np.sum(np.cross(travel_base, chord_base) * approach_base, axis=1)
    return np.clip(np.arctan2(across, np.sum(travel_base * chord_base, axis=1)), -_MOST_TURN_RAD, _MOST_TURN_RAD)

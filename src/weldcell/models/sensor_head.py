"""The laser-line sensor's head: a sealed housing with camera and laser windows, and its bracket on the flange.

Its layout, in the torch frame (x forward, z down the wire): the light plane is vertical, y and z, at x = look-ahead.
The camera stands beyond it and looks back and down, a = angle between its axis and the light:

    axis = (-sin a, 0, cos a),   crossing = (look-ahead, 0, below tip),   camera = crossing - stand-off * axis.

The laser shines straight down on the crossing. The stripe of a flat surface lies along the torch's y. A camera whose
rows lie along y has its x along -y (it looks back at the torch); one whose columns do is rolled by a quarter turn, so
that a deeper point moves along +x of the picture as it moves along +y of the other.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import mujoco
import numpy as np
from jaxtyping import Float
from manifold3d import Manifold
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.frames import rigid_from
from weldcell.models.mesh_body import (
    BLACK,
    BLUE,
    DARK_GREY,
    GROUP_SENSOR,
    LIGHT_GREY,
    STEEL,
    Finish,
    Piece,
    add_pieces,
    set_inertia,
)
from weldcell.models.shapes import bolt_circle, box, hull, join, rod, slab
from weldcell.models.torch import T_FLANGE_TORCH

SENSOR_MASS_KG = 1.5
"""Head with bracket; plausible for this size, not measured."""

_HALF_WIDTH_M = 0.030
_WINDOW_M = 0.022  # from camera centre and laser source to the outside of their windows
_LASER_BACK_M = 0.0855  # from the laser source to the housing's back
_BRIDGE_M = 0.051  # from camera centre and laser source up to the middle of the bridge between them
_FIN_PITCH_M = 0.0095
_FIN_MARGIN_M = 0.033  # no fins on the blocks at the bridge's ends
_GLASS = Finish(rgba=(0.16, 0.03, 0.04, 1.0), specular=1.0, shininess=0.9)
_GREEN_LED = Finish(rgba=(0.1, 0.85, 0.25, 1.0), specular=0.5, shininess=0.5)


@dataclass(frozen=True, kw_only=True)
class HeadDesign:
    """Where camera and laser stand in the head, and the head on the torch; the defaults are those of P2's sensor."""

    stand_off_m: float = 0.275
    """From the camera's centre to the crossing, where its axis meets the light plane."""
    triangulation_rad: float = np.pi / 4
    """Angle between the camera's axis and the light plane."""
    laser_range_m: float = 0.275 * np.cos(np.pi / 4)
    """From the laser's source to the crossing; stand-off times the cosine of the angle is level with the camera."""
    stripe_along: Literal["rows", "columns"] = "rows"
    """What the stripe of a flat surface runs along in the picture."""
    look_ahead_m: float = 0.060
    """From the wire's tip to the light plane along the direction of travel."""
    below_tip_m: float = 0.025
    """From the wire's tip down to the crossing: puts the range about the joint."""

    @cached_property
    def T_torch_camera(self) -> RigidTransform:
        """The camera (x right, y down, z forward) on the torch."""
        sin, cos = np.sin(self.triangulation_rad), np.cos(self.triangulation_rad)
        axis = np.array([-sin, 0.0, cos])
        deeper, across = np.array([cos, 0.0, sin]), np.array([0.0, 1.0, 0.0])
        x, y = (-across, deeper) if self.stripe_along == "rows" else (deeper, across)
        crossing_torch = np.array([self.look_ahead_m, 0.0, self.below_tip_m])
        rotation = Rotation.from_matrix(np.column_stack([x, y, axis]))
        return rigid_from(rotation, crossing_torch - self.stand_off_m * axis)

    @cached_property
    def T_flange_camera(self) -> RigidTransform:
        """The camera's mount as drawn."""
        return T_FLANGE_TORCH * self.T_torch_camera

    @property
    def crossing_flange(self) -> Float[np.ndarray, "3"]:
        """Where the camera's axis meets the light plane, m."""
        return T_FLANGE_TORCH.apply([self.look_ahead_m, 0.0, self.below_tip_m])

    @property
    def source_camera(self) -> Float[np.ndarray, "3"]:
        """Where the light fan starts, m: in the light plane, straight above the crossing."""
        source_torch = [self.look_ahead_m, 0.0, self.below_tip_m - self.laser_range_m]
        return self.T_torch_camera.inv().apply(source_torch)

    @property
    def T_camera_housing(self) -> RigidTransform:
        """The housing's frame: at the camera's centre, its axes those of the torch frame when nominal."""
        return rigid_from(self.T_torch_camera.rotation.inv(), np.zeros(3))


def build_sensor_head(design: HeadDesign, T_flange_camera: RigidTransform | None = None) -> mujoco.MjSpec:
    """Body `sensor_head` in the flange frame with sites `camera` and `laser_source` (turned as the camera).

    `T_flange_camera` is where the camera actually stands, with the whole head; as drawn if it is not given.
    """
    T_flange_camera = design.T_flange_camera if T_flange_camera is None else T_flange_camera
    spec = mujoco.MjSpec()
    spec.modelname = "sensor_head"
    body = spec.worldbody.add_body(name="sensor_head")
    pieces = head_pieces(design, T_flange_camera)
    add_pieces(spec, body, pieces, group=GROUP_SENSOR)
    set_inertia(body, pieces, SENSOR_MASS_KG)
    quaternion = T_flange_camera.rotation.as_quat(scalar_first=True)
    body.add_site(name="camera", pos=T_flange_camera.translation, quat=quaternion, group=5)
    body.add_site(name="laser_source", pos=T_flange_camera.apply(design.source_camera), quat=quaternion, group=5)
    return spec


def head_pieces(design: HeadDesign, T_flange_camera: RigidTransform) -> list[Piece]:
    """The coloured solids of head and bracket in the flange frame; the first three are the housing."""
    T_flange_housing = T_flange_camera * design.T_camera_housing
    laser = design.T_camera_housing.inv().apply(design.source_camera)
    solids = [*_laser_solids(laser), *_camera_solids(design.triangulation_rad), *_bridge_solids(laser)]
    solids.sort(key=lambda solid: solid[0] not in _HOUSING)
    matrix = T_flange_housing.as_matrix()[:3]
    pieces = [Piece(name=name, solid=solid.transform(matrix), finish=finish) for name, solid, finish in solids]
    return pieces + _bracket_pieces(T_flange_housing, laser)


_HOUSING = ("sensor_laser_block", "sensor_bridge", "sensor_camera_block")
_Solids = list[tuple[str, Manifold, Finish]]  # in the housing's frame


def _laser_solids(laser: Float[np.ndarray, "3"]) -> _Solids:
    """The upright block of the laser, shining down from `laser`."""
    edge, at = 0.006, tuple(laser)
    block = slab(_rectangle(-0.025, 0.025, -_LASER_BACK_M, _WINDOW_M - 0.001, edge), _HALF_WIDTH_M, edge)
    window = box((-0.010, -0.020, _WINDOW_M - 0.004), (0.010, 0.020, _WINDOW_M), 0.0008)
    side = -_HALF_WIDTH_M
    led = rod((0, side - 0.001, -0.03), (0, side + 0.002, -0.03), 0.004, edge=0.0005, segments=16)
    return [
        ("sensor_laser_block", block.translate(at), BLUE),
        ("sensor_laser_window", window.translate(at), _GLASS),
        ("sensor_led", led.translate(at), _GREEN_LED),
    ]


def _camera_solids(triangulation_rad: float) -> _Solids:
    """The block of the camera along its axis, with its window in front and its plugs at the back."""
    edge, sin, cos = 0.006, np.sin(triangulation_rad), np.cos(triangulation_rad)
    axis, across = np.array([-sin, 0, cos]), np.array([cos, 0, sin])
    corners = [
        tuple((a * axis + p * across)[[0, 2]])
        for a in (-0.062 + edge, _WINDOW_M - 0.001 - edge)
        for p in (-0.028 + edge, 0.028 - edge)
    ]
    block = slab(corners, _HALF_WIDTH_M, edge)
    window = rod(axis * (_WINDOW_M - 0.004), axis * _WINDOW_M, 0.017, edge=0.0005)
    rim = rod(axis * (_WINDOW_M - 0.004), axis * (_WINDOW_M - 0.0005), 0.020, edge=0.0005)
    sides = [np.array([0, y, 0]) for y in (-0.012, 0.012)]
    plugs = join(rod(-0.058 * axis + y, -0.079 * axis + y, 0.0075, edge=0.001, segments=24) for y in sides)
    return [
        ("sensor_camera_block", block, BLUE),
        ("sensor_camera_rim", rim, BLACK),
        ("sensor_camera_window", window, _GLASS),
        ("sensor_plugs", plugs, LIGHT_GREY),
    ]


def _bridge_solids(laser: Float[np.ndarray, "3"]) -> _Solids:
    """What joins laser and camera, with cooling fins on its sides."""
    edge = 0.006
    end = slab(_rectangle(-0.0235, 0.0235, -0.0335, 0.033, edge), _HALF_WIDTH_M - 0.0015, edge)
    first, last = laser - [0, 0, _BRIDGE_M], np.array([-0.0035, 0, -_BRIDGE_M])
    length_m = float(np.linalg.norm(last - first))
    margin_m = max(_FIN_MARGIN_M, 0.26 * length_m)
    count = 1 + max(int((length_m - 2 * margin_m) / _FIN_PITCH_M), 0)
    middle, pitch = (first + last) / 2, _FIN_PITCH_M * (last - first) / length_m
    reach = _HALF_WIDTH_M + 0.002
    fin = box((-0.002, -reach, -0.025), (0.002, reach, 0.025), 0.0012)
    fins = join(fin.translate(tuple(middle + k * pitch)) for k in np.arange(count) - (count - 1) / 2)
    return [
        ("sensor_bridge", hull([end.translate(tuple(first)), end.translate(tuple(last))]), BLUE),
        ("sensor_fins", fins, DARK_GREY),
    ]


def _bracket_pieces(T_flange_housing: RigidTransform, laser: Float[np.ndarray, "3"]) -> list[Piece]:
    """A ring round the torch's adapter and two cheeks from it to the pad on the housing's back."""
    ring = rod((0, 0, 0.002), (0, 0, 0.016), 0.056, edge=0.002) - Manifold.cylinder(0.1, 0.0405, -1.0, 48).translate(
        (0, 0, -0.05)
    )
    # The pad lies on the laser's block and on as much of the bridge as is level with it.
    level_m = max(-laser[0] + laser[2], 0.0)
    start, end = laser[0] - 0.0155, laser[0] + 0.0195 + 0.5 * level_m
    back = laser[2] - _LASER_BACK_M
    pad_housing = slab(_rectangle(start, end, back - 0.010, back + 0.0015, 0.002), 0.027, 0.002)
    pad_ends = T_flange_housing.apply(np.array([[start + 0.005, 0, back - 0.0055], [end - 0.005, 0, back - 0.0055]]))
    outline = [(0.047, 0.005), (0.053, 0.005), (0.047, 0.013), *((x, z) for x, _, z in pad_ends)]
    cheek = slab(outline, 0.004, 0.002)
    cheeks = join([cheek.translate((0, -0.020, 0)), cheek.translate((0, 0.020, 0))])
    pad = pad_housing.transform(T_flange_housing.as_matrix()[:3])
    bolts = bolt_circle((0, 0, 0.015), (0, 0, 1), radius=0.048, count=8, bolt=0.003, height=0.004)
    return [
        Piece(name="sensor_bracket_ring", solid=ring, finish=STEEL),
        Piece(name="sensor_bracket", solid=join([cheeks, pad]), finish=STEEL),
        Piece(name="sensor_bracket_bolts", solid=bolts, finish=DARK_GREY),
    ]


def _rectangle(x0: float, x1: float, z0: float, z1: float, inset: float) -> list[tuple[float, float]]:
    return [(x, z) for x in (x0 + inset, x1 - inset) for z in (z0 + inset, z1 - inset)]

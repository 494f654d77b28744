"""The laser-line sensor's head: a sealed housing with camera and laser windows, and its bracket on the flange."""

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
from weldcell.models.shapes import bolt_circle, box, join, rod, slab
from weldcell.models.torch import T_FLANGE_TORCH

LOOK_AHEAD_M = 0.060
"""From the wire's tip to the light plane along the direction of travel."""
BELOW_TIP_M = 0.025
"""From the wire's tip down to where camera axis and light plane meet: the range lies about the joint."""
STAND_OFF_M = 0.275
"""From the camera's centre to where its axis meets the light plane, there 45 deg apart (P2's sensor)."""
_REACH_M = float(STAND_OFF_M / np.sqrt(2))  # the same along the torch's x and along its z

_T_TORCH_CAMERA: RigidTransform = rigid_from(
    Rotation.from_matrix(np.array([[0, 1, -1], [-np.sqrt(2), 0, 0], [0, 1, 1]]) / np.sqrt(2)),
    np.array([LOOK_AHEAD_M + _REACH_M, 0, BELOW_TIP_M - _REACH_M]),
)
T_FLANGE_CAMERA: RigidTransform = T_FLANGE_TORCH * _T_TORCH_CAMERA
"""Nominal camera mount (camera: x right, y down, z forward)."""

# The housing frame: at the camera's centre, its axes those of the torch frame when nominal.
_T_CAMERA_HOUSING: RigidTransform = rigid_from(_T_TORCH_CAMERA.rotation.inv(), np.zeros(3))

LASER_SOURCE_CAMERA: Float[np.ndarray, "3"] = _T_CAMERA_HOUSING.apply(np.array([-_REACH_M, 0, 0]))
"""Where the light fan starts, in the camera frame, m: level with the camera, straight above the crossing."""

SENSOR_MASS_KG = 1.5
"""Head with bracket; plausible for this size, not measured."""

_HALF_WIDTH_M = 0.030
_WINDOW_M = 0.022  # from camera centre and laser source to the outside of their windows
_GLASS = Finish(rgba=(0.16, 0.03, 0.04, 1.0), specular=1.0, shininess=0.9)
_GREEN_LED = Finish(rgba=(0.1, 0.85, 0.25, 1.0), specular=0.5, shininess=0.5)


def build_sensor_head(T_flange_camera: RigidTransform = T_FLANGE_CAMERA) -> mujoco.MjSpec:
    """Body `sensor_head` in the flange frame with sites `camera` and `laser_source` (turned as the camera)."""
    spec = mujoco.MjSpec()
    spec.modelname = "sensor_head"
    body = spec.worldbody.add_body(name="sensor_head")
    pieces = head_pieces(T_flange_camera)
    add_pieces(spec, body, pieces, group=GROUP_SENSOR)
    set_inertia(body, pieces, SENSOR_MASS_KG)
    quaternion = T_flange_camera.rotation.as_quat(scalar_first=True)
    body.add_site(name="camera", pos=T_flange_camera.translation, quat=quaternion, group=5)
    body.add_site(name="laser_source", pos=T_flange_camera.apply(LASER_SOURCE_CAMERA), quat=quaternion, group=5)
    return spec


def head_pieces(T_flange_camera: RigidTransform = T_FLANGE_CAMERA) -> list[Piece]:
    """The coloured solids of head and bracket in the flange frame; the first three are the housing."""
    T_flange_housing = T_flange_camera * _T_CAMERA_HOUSING
    return _housing_pieces(T_flange_housing) + _bracket_pieces(T_flange_housing)


def _housing_pieces(T_flange_housing: RigidTransform) -> list[Piece]:
    """Laser block, camera block set at 45 deg, and the bridge between them, each convex."""
    edge = 0.006
    inner, laser_x = edge, -_REACH_M
    laser_block = slab(
        _rectangle(laser_x - 0.025, laser_x + 0.025, -0.0855, _WINDOW_M - 0.001, inner), _HALF_WIDTH_M, edge
    )
    bridge = slab(_rectangle(laser_x - 0.0235, 0.020, -0.0845, -0.018, inner), _HALF_WIDTH_M - 0.0015, edge)
    along, across = np.array([-1, 1]) / np.sqrt(2), np.array([1, 1]) / np.sqrt(2)  # of the optical axis, in x and z
    corners = [(a, p) for a in (-0.062 + inner, _WINDOW_M - 0.001 - inner) for p in (-0.028 + inner, 0.028 - inner)]
    camera_block = slab([tuple(a * along + p * across) for a, p in corners], _HALF_WIDTH_M, edge)
    axis = np.array([along[0], 0, along[1]])
    camera_window = rod(axis * (_WINDOW_M - 0.004), axis * _WINDOW_M, 0.017, edge=0.0005)
    camera_rim = rod(axis * (_WINDOW_M - 0.004), axis * (_WINDOW_M - 0.0005), 0.020, edge=0.0005)
    laser_window = box((laser_x - 0.010, -0.020, _WINDOW_M - 0.004), (laser_x + 0.010, 0.020, _WINDOW_M), 0.0008)
    back = np.array([-axis[0], 0, -axis[2]]) * 0.058
    side = np.array([across[0], 0, across[1]])
    plugs = join(
        rod(
            back + 0.010 * s * side + [0, y, 0],
            back * 1.36 + 0.010 * s * side + [0, y, 0],
            0.0075,
            edge=0.001,
            segments=24,
        )
        for s, y in ((0, -0.012), (0, 0.012))
    )
    fins = join(
        box((x, -_HALF_WIDTH_M - 0.002, -0.078), (x + 0.004, _HALF_WIDTH_M + 0.002, -0.028), 0.0012)
        for x in np.arange(-0.145, -0.055, 0.0095)
    )
    led = rod(
        (laser_x, -_HALF_WIDTH_M - 0.001, -0.03),
        (laser_x, -_HALF_WIDTH_M + 0.002, -0.03),
        0.004,
        edge=0.0005,
        segments=16,
    )
    solids = [
        ("sensor_laser_block", laser_block, BLUE),
        ("sensor_bridge", bridge, BLUE),
        ("sensor_camera_block", camera_block, BLUE),
        ("sensor_fins", fins, DARK_GREY),
        ("sensor_camera_rim", camera_rim, BLACK),
        ("sensor_camera_window", camera_window, _GLASS),
        ("sensor_laser_window", laser_window, _GLASS),
        ("sensor_plugs", plugs, LIGHT_GREY),
        ("sensor_led", led, _GREEN_LED),
    ]
    matrix = T_flange_housing.as_matrix()[:3]
    return [Piece(name=name, solid=solid.transform(matrix), finish=finish) for name, solid, finish in solids]


def _bracket_pieces(T_flange_housing: RigidTransform) -> list[Piece]:
    """A ring round the torch's adapter and two cheeks from it to the pad on the housing's back."""
    ring = rod((0, 0, 0.002), (0, 0, 0.016), 0.056, edge=0.002) - Manifold.cylinder(0.1, 0.0405, -1.0, 48).translate(
        (0, 0, -0.05)
    )
    pad_housing = slab(_rectangle(-0.21, -0.075, -0.0955, -0.084, 0.002), 0.027, 0.002)
    ends = T_flange_housing.apply(np.array([[-0.205, 0, -0.091], [-0.080, 0, -0.091]]))
    outline = [(0.047, 0.005), (0.053, 0.005), (0.047, 0.013), *((x, z) for x, _, z in ends)]
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

"""The sensor's rays against MuJoCo's own on a plate of 240 000 triangles.

"Lit and seen" are two passes: the laser's rays, and the camera's rays back to the points that they light, whose own
tests and projection are part of our time. The sensor has two rays for each picture column; MuJoCo casts the very same
rays, in two plain calls of `mj_multiRay`.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks.table import Figure
from benchmarks.timing import interleaved_ms
from weldcell.cell.configuration import CellConfig, RecordingConfig, SeamConfig, SensorConfig
from weldcell.cell.frames import rigid_from, translation
from weldcell.cell.world.scene import build_cell
from weldcell.models.shapes import loft
from weldcell.models.workpiece import Workpiece
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.seam_tracking import taught_path
from weldcell.scenarios.station import Station
from weldcell.scenarios.torch_poses import flange_at
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.laser import laser_fan
from weldcell.sensor_sim.light_section import light_section
from weldcell.sensor_sim.rays import RayCaster

TRIANGLES = 240_000
REPEATS = 15
_SECTIONS = 601  # 0.5 mm apart, as fine as the plates that the cell makes
_LENGTH_M, _HALF_WIDTH_M, _THICKNESS_M, _ROOT_FACE_M, _HALF_GROOVE_RAD = 0.3, 0.08, 0.06, 0.004, np.pi / 8


@dataclass(frozen=True, kw_only=True)
class _Place:
    """A scene, and where the camera stands in it."""

    model: mujoco.MjModel
    data: mujoco.MjData
    T_base_camera: RigidTransform


def figures() -> list[Figure]:
    """How many times as fast as MuJoCo's two passes: the plate alone, and in the whole cell."""
    plate = fine_plate()
    return [
        figure
        for where, place in (("plate alone", _alone(plate)), ("plate in the cell", _in_cell(plate)))
        for figure in _figures(where, place)
    ]


def fine_plate(triangles: int = TRIANGLES) -> Workpiece:
    """The V-groove plate, straight, its faces cut into even strips across and along."""
    half_top_m = (_THICKNESS_M - _ROOT_FACE_M) * np.tan(_HALF_GROOVE_RAD)
    corners = np.array(
        [[-_HALF_WIDTH_M, 0], [_HALF_WIDTH_M, 0], [_HALF_WIDTH_M, _THICKNESS_M], [half_top_m, _THICKNESS_M],
         [0, _ROOT_FACE_M], [-half_top_m, _THICKNESS_M], [-_HALF_WIDTH_M, _THICKNESS_M], [-_HALF_WIDTH_M, 0]]
    )  # fmt: skip
    way_m = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    even_m = np.linspace(0, way_m[-1], triangles // (2 * _SECTIONS) - len(corners) + 3)
    at_m = np.union1d(even_m, way_m)[:-1]
    outline = np.column_stack([np.interp(at_m, way_m, corner) for corner in corners.T])
    x = np.linspace(-_LENGTH_M / 2, _LENGTH_M / 2, _SECTIONS)
    sections = np.concatenate(
        [np.broadcast_to(x[:, None, None], (_SECTIONS, len(outline), 1)),
         np.broadcast_to(outline, (_SECTIONS, *outline.shape))], axis=2
    )  # fmt: skip
    mesh = loft(sections).to_mesh64()
    faces = mesh.tri_verts.astype(np.int64)
    return Workpiece(name="v_groove_plate", vertices_part=mesh.vert_properties[:, :3], faces=faces)


def _alone(plate: Workpiece) -> _Place:
    spec = mujoco.MjSpec()
    plate.add_to(spec, translation([0, 0, -_THICKNESS_M]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    forward, across = np.array([-1.0, 0.0, -1.0]) / np.sqrt(2), np.array([0.0, 1.0, 0.0])
    upright = Rotation.from_matrix(np.column_stack([across, np.cross(forward, across), forward]))
    R = Rotation.from_euler("z", 0.1) * upright  # along the mesh's own lines all rays would meet alike triangles
    return _Place(model=model, data=data, T_base_camera=rigid_from(R, np.array([0, 0, -0.01]) - R.apply([0, 0, 0.275])))


def _in_cell(plate: Workpiece) -> _Place:
    config = CellConfig(
        robot="perfect", seam=SeamConfig(frames=9, amplitude_mm=0), recording=RecordingConfig(enabled=False)
    )
    with Station(config, 1, Recording(Path("unused.rrd"), config.recording, title=""), Progress()) as station:
        station.place_plate()
        path = taught_path(station)
        rotation = station.rotation_base_flange(path.headings_rad[4] + 0.1)
        T_base_flange = flange_at(path.points_base[4], rotation, station.head.crossing_flange)
        joints_rad = station.controller.inverse(T_base_flange, station.joints_rad)
        cell = build_cell(replace(station.parts, plate=plate), station.head, None)
        cell.place("plate", station.cell.T_base_part("plate"))
    cell.take(joints_rad)
    return _Place(model=cell.model, data=cell.data, T_base_camera=cell.T_base("camera"))


def _figures(where: str, place: _Place) -> list[Figure]:
    config = SensorConfig()
    camera = nominal_camera(config)
    fan = laser_fan(config, nominal_plane(config), nominal_source_camera(config))
    caster = RayCaster(place.model)
    section = light_section(caster, place.data, place.T_base_camera, camera, fan)
    R, centre_base = place.T_base_camera.rotation, place.T_base_camera.translation
    towards = section.points_camera[section.visible]
    passes = [
        (centre_base + R.apply(fan.source_camera), R.apply(fan.directions_camera)),
        (centre_base, R.apply(towards / np.linalg.norm(towards, axis=1, keepdims=True))),
    ]
    times_ms = interleaved_ms(
        {
            "ours": lambda: light_section(caster, place.data, place.T_base_camera, camera, fan),
            "casts": lambda: [caster.cast(place.data, origin, directions) for origin, directions in passes],
            "raw": lambda: [_raw_pass(place, origin, directions) for origin, directions in passes],
        },
        REPEATS,
    )
    columns = len(np.unique(np.rint(section.pixels[section.seen, 0])))
    return [
        Figure(name=f"{where}: columns with a lit and seen point", value=columns),
        Figure(name=f"{where}: rays, both passes", value=sum(len(directions) for _, directions in passes)),
        Figure(name=f"{where}: two raw mj_multiRay passes", value=times_ms["raw"], unit="ms"),
        Figure(name=f"{where}: lit and seen", value=times_ms["ours"], unit="ms"),
        Figure(name=f"{where}: of this, casting", value=times_ms["casts"], unit="ms"),
        Figure(name=f"{where}: times as fast", value=times_ms["raw"] / times_ms["ours"], at_least=6),
    ]


def _raw_pass(place: _Place, origin: Float[np.ndarray, "3"], directions: Float[np.ndarray, "n 3"]) -> None:
    count = len(directions)
    geoms, distances = np.zeros(count, np.int32), np.zeros(count)
    groups = np.array([1, 1, 1, 0, 0, 0], np.uint8)
    flat = np.ascontiguousarray(directions).ravel()
    mujoco.mj_multiRay(place.model, place.data, origin, flat, groups, 1, -1, geoms, distances, None, count, 10.0)

"""Simulated pictures of every kind of joint at rising noise, with the exact places of their features.

A part and the torch in the room, without the arm, which would be out of the picture. A track is a row of frames a
millimetre apart along one part's seam, so that a detector can be gated by the frame before. Every frame's light is
followed once; each level of noise makes its own picture of it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from jaxtyping import UInt8
from scipy.spatial.transform import RigidTransform, Rotation

from joint_parts import KINDS, random_part
from weldcell.cell.configuration import Disturbance, MaterialName, SensorConfig
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.randomness import generator
from weldcell.cell.world.scene import head_design
from weldcell.models.joint_section import JointKind
from weldcell.models.room import build_room
from weldcell.models.torch import T_FLANGE_TORCH, build_torch
from weldcell.models.workpiece import Workpiece
from weldcell.scenarios.torch_poses import flange_at
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.line_sensor import Exposure, FrameLight, LineSensor, Moment
from weldcell.sensor_sim.seam_labels import FeatureTruth, feature_truth

MATERIALS: tuple[MaterialName, ...] = ("matt-white", "mill-scale", "ground-steel", "stainless", "aluminium")
COUNTED_FRAMES = 4
"""Of a track; the frame before them only gates."""
STRIPE_GREY = 150.0
"""Median peak of the stripe that the exposure is chosen for, as sensors with automatic exposure do."""
_EXPOSURE_MS = (0.1, 5.0)
_WELD_EXPOSURE_MS = 1.0  # at most: the arc's light grows with the exposure, the stripe's share of it does not
_AMBIENT_GREY = 18.0
_STEP_M = 1e-3
_FRAME_S = 0.04
_LONG_AFTER_S = 100.0  # the disturbances began: fume and spatter are there
_T_BASE_PART = rigid_from(Rotation.from_euler("Z", np.pi / 2), np.array([0.93, 0.0, 0.3]))
_TOOL = "tool"
_WELD = (Disturbance(kind="arc"), Disturbance(kind="spatter"))
_WORK_RAD = {"fillet": np.pi / 4, "lap": np.radians(15)}
"""From upright towards the joint's open side; the others are looked at from above."""


@dataclass(frozen=True, kw_only=True)
class Level:
    """One level of noise."""

    name: str
    light: float = 1.0
    """Exposure time as a share of the automatic one, made good by gain: grey stays, electrons don't."""
    stripe: float = 1.0
    """The same without gain: the picture is darker."""
    added_grey: float = 0.0
    """Normal noise added to the picture, one sigma in levels of 255, as the papers with networks do."""
    weld: bool = False
    """Arc and spatter, both of strength 1."""


NOMINAL = Level(name="nominal")
HIGH = Level(name="20 grey added", added_grey=20)
LEVELS: tuple[Level, ...] = (
    NOMINAL,
    Level(name="light 1/8", light=1 / 8),
    Level(name="light 1/30", light=1 / 30),
    Level(name="5 grey added", added_grey=5),
    Level(name="10 grey added", added_grey=10),
    HIGH,
    Level(name="25 grey added", added_grey=25),
    Level(name="stripe 60, 10 grey added", stripe=0.4, added_grey=10),
    Level(name="arc and spatter", weld=True),
    Level(name="arc, spatter, 10 grey added", weld=True, added_grey=10),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledPicture:
    """One picture and the truth about it."""

    kind: JointKind
    material: MaterialName
    track: int
    frame: int
    """Of its track; 0 is the one that only gates."""
    level: Level
    picture: UInt8[np.ndarray, "height width"]
    stripe_grey: float
    """Median peak of the stripe without noise."""
    noise_grey: float
    """Standard deviation of a pixel beside the stripe: read, photon and added noise, before clipping."""
    truth: FeatureTruth
    camera: CameraModel
    plane: LaserPlane


def labelled_pictures(
    seed: int,
    *,
    kinds: Sequence[JointKind] = KINDS,
    tracks: int = 6,
    levels: Sequence[Level] = LEVELS,
    counted: int = COUNTED_FRAMES,
) -> Iterator[LabelledPicture]:
    """Pictures of all kinds: track by track, in each frame by frame, of each all levels."""
    for kind in kinds:
        for track in range(tracks):
            yield from _track(seed, kind, track, levels, counted)


def _track(seed: int, kind: JointKind, track: int, levels: Sequence[Level], counted: int) -> Iterator[LabelledPicture]:
    with JointScene(seed, kind, track) as scene:
        for frame in range(counted + 1):
            yield from scene.pictures(frame, levels)


@dataclass(frozen=True, kw_only=True)
class _Place:
    """Where the sensor stands in a track's first frame."""

    station_m: float
    lateral_m: float
    height_m: float
    turn: Rotation
    """From its usual orientation, in the torch frame."""


class JointScene:
    """One track's part under the sensor; use it in a `with` block."""

    def __init__(self, seed: int, kind: JointKind, track: int) -> None:
        rng = generator(seed, f"detectors/{kind}", track)
        self._kind, self._track, self._seed = kind, track, seed
        self._material = MATERIALS[rng.integers(len(MATERIALS))]
        part = random_part(kind, rng).with_surface(self._material)
        assert part.seam_part is not None
        self._seam = part.seam_part
        self._place = _drawn_place(rng)
        self._config = SensorConfig()
        self._head = head_design(self._config)
        self._model = _compiled(part)
        self._data = mujoco.MjData(self._model)
        self._sensor = LineSensor(
            self._config,
            nominal_camera(self._config),
            nominal_plane(self._config),
            nominal_source_camera(self._config),
            self._model,
            seed=seed,
        )
        self._exposure_ms = 0.0

    def __enter__(self) -> "JointScene":
        return self

    def __exit__(self, *_: object) -> None:
        self._sensor.close()

    def pictures(self, frame: int, levels: Sequence[Level]) -> Iterator[LabelledPicture]:
        """One frame's picture at each level."""
        T_base_flange = self._T_base_flange(frame)
        self._place_torch(T_base_flange)
        light = self._light(frame, T_base_flange, (), 1.0)
        peak_grey = float(np.median(light.stripe.amplitude_grey)) if len(light.stripe.amplitude_grey) else 1.0
        if not self._exposure_ms:
            self._exposure_ms = float(np.clip(STRIPE_GREY / max(peak_grey, 1e-6), *_EXPOSURE_MS))
        weld_ms = min(self._exposure_ms, _WELD_EXPOSURE_MS)
        welding = self._light(frame, T_base_flange, _WELD, weld_ms) if any(level.weld for level in levels) else light
        truth = self._truth(light)
        for number, level in enumerate(levels):
            rng = generator(self._seed, f"detectors/{self._kind}/{self._track}/{level.name}", frame)
            exposure = _exposure(weld_ms if level.weld else self._exposure_ms, level)
            picture = self._sensor.picture(welding if level.weld else light, rng, exposure)
            gain = 10 ** (exposure.gain_db / 20)
            yield LabelledPicture(
                kind=self._kind,
                material=self._material,
                track=self._track,
                frame=frame,
                level=level,
                picture=_with_noise(picture, level.added_grey, number + 1000 * frame + 1_000_000 * self._track),
                stripe_grey=peak_grey * exposure.exposure_ms * gain,
                noise_grey=self._noise_grey(gain, level.added_grey),
                truth=truth,
                camera=self._sensor.camera,
                plane=self._sensor.fan.plane,
            )

    def _light(
        self, frame: int, T_base_flange: RigidTransform, script: tuple[Disturbance, ...], exposure_ms: float
    ) -> FrameLight:
        own_seed = int(generator(self._seed, f"detectors/{self._kind}/weld", self._track).integers(2**31))
        moment = Moment(time_s=_LONG_AFTER_S + frame * _FRAME_S, T_base_torch=T_base_flange * T_FLANGE_TORCH)
        return self._sensor.light(
            self._data,
            T_base_flange * self._head.T_flange_camera,
            moment,
            exposure=Exposure(exposure_ms=exposure_ms, gain_db=0.0, ambient_grey=_AMBIENT_GREY),
            script=self._sensor.scripted(script, own_seed, exposure_ms),
        )

    def _noise_grey(self, gain: float, added_grey: float) -> float:
        """Read noise under gain, rounding, and what is added; the background's photons are few."""
        return float(np.sqrt((gain * self._config.read_noise_grey) ** 2 + 1 / 12 + added_grey**2))

    def _truth(self, light: FrameLight) -> FeatureTruth:
        T_camera_part = light.T_base_camera.inv() * _T_BASE_PART
        lines_camera = {name: T_camera_part.apply(line) for name, line in self._seam.points.items()}
        sensor = self._sensor
        return feature_truth(lines_camera, sensor.camera, sensor.fan, sensor.caster, self._data, light.T_base_camera)

    def _T_base_flange(self, frame: int) -> RigidTransform:
        place, seam = self._place, self._seam
        rng = generator(self._seed, f"detectors/{self._kind}/{self._track}/place", frame)
        station_m = np.array([place.station_m * seam.arc_length_m[-1] + frame * _STEP_M])
        around_m = station_m + np.array([-1e-4, 0.0, 1e-4])
        middle = np.mean([seam.at(name, around_m) for name in seam.points], axis=0)
        travel = _T_BASE_PART.rotation.apply(middle[2] - middle[0])
        travel /= np.linalg.norm(travel)
        left = np.cross([0.0, 0.0, 1.0], travel)
        up = np.cross(travel, left)
        work_rad = _WORK_RAD.get(self._kind, 0.0)  # the joint's open side is on the right
        out = np.cos(work_rad) * up - np.sin(work_rad) * left
        R_base_torch = Rotation.from_matrix(np.column_stack([travel, np.cross(-out, travel), -out])) * place.turn
        lateral_m = place.lateral_m + 2e-4 * rng.normal()
        height_m = place.height_m + 2e-4 * rng.normal()
        crossing_base = _T_BASE_PART.apply(middle[1]) + lateral_m * np.cross(out, travel) + height_m * out
        return flange_at(crossing_base, R_base_torch * T_FLANGE_TORCH.rotation.inv(), self._head.crossing_flange)

    def _place_torch(self, T_base_flange: RigidTransform) -> None:
        tool = int(self._model.body(_TOOL).mocapid[0])
        self._data.mocap_pos[tool] = T_base_flange.translation
        self._data.mocap_quat[tool] = T_base_flange.rotation.as_quat(scalar_first=True)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)


def _drawn_place(rng: np.random.Generator) -> _Place:
    """Stand-off, offset and angles as a scan has them when the part is out of place."""
    lean, roll, yaw = np.radians([rng.uniform(-8, 8), rng.uniform(-8, 8), rng.uniform(-12, 12)])
    return _Place(
        station_m=rng.uniform(0.25, 0.7),
        lateral_m=rng.uniform(-0.012, 0.012),
        height_m=rng.uniform(-0.012, 0.008),
        turn=Rotation.from_euler("ZYX", [yaw, lean, roll]),
    )


def _compiled(part: Workpiece) -> mujoco.MjModel:
    spec = build_room()
    part.add_to(spec, _T_BASE_PART)
    tool = spec.worldbody.add_body(name=_TOOL, mocap=True)
    spec.attach(build_torch(), prefix="torch/", frame=tool.add_frame())
    return spec.compile()


def _exposure(automatic_ms: float, level: Level) -> Exposure:
    return Exposure(
        exposure_ms=automatic_ms * level.light * level.stripe,
        gain_db=float(-20 * np.log10(level.light)),
        ambient_grey=_AMBIENT_GREY,
    )


def _with_noise(
    picture: UInt8[np.ndarray, "height width"], sigma_grey: float, seed: int
) -> UInt8[np.ndarray, "height width"]:
    """Normal noise on top, rounded and cut off at 0 and 255."""
    if not sigma_grey:
        return picture
    cv2.setRNGSeed(seed % 2**31)
    noise = cv2.randn(np.empty(picture.shape, np.float32), 0.0, sigma_grey)
    return cv2.add(picture.astype(np.float32), noise, dtype=cv2.CV_32F).clip(0, 255).round().astype(np.uint8)

"""The cell at work: the actual world, what its controller believes, the clock and the recording."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.calibrated_arm import CalibratedArm
from weldcell.cell.configuration import CellConfig
from weldcell.cell.frames import rigid_from, translation
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import JointFeatures, Profile, Shot, Stripe
from weldcell.cell.randomness import generator
from weldcell.cell.world.controller import nominal_arm
from weldcell.cell.world.motion import MotionPlanner
from weldcell.cell.world.robot_error import BUDGETS, RobotError, draw_error, flange_m_per_joint_rad
from weldcell.cell.world.scene import (
    HOME_RAD,
    SHELF,
    build_cell,
    build_controller,
    build_parts,
    head_design,
)
from weldcell.models.board import Board
from weldcell.models.own_arm import OwnArm
from weldcell.models.torch import T_FLANGE_TORCH
from weldcell.scenarios.progress import Progress
from weldcell.scenarios.recording import Recording
from weldcell.scenarios.torch_poses import flange_at, torch_rotation
from weldcell.scenarios.user_cell.own_cell import own_cell
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.disturbances import Disturbances
from weldcell.sensor_sim.line_sensor import STANDING, LineSensor, Moment
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate

_HOME_TIP_BASE = np.array([0.93, 0.0, 0.60])
_SPHERE_MISPLACEMENT_M = 1.5e-3  # one sigma: a stand put down by eye and jogged to by hand


@dataclass(frozen=True, kw_only=True)
class SensorBelief:
    """Intrinsics and light plane that the pipelines are given."""

    camera: CameraModel
    plane: LaserPlane


@dataclass(frozen=True, kw_only=True)
class Sight:
    """One picture and the profile in it."""

    frame: int
    """Number of the picture in the run."""
    joints_rad: Float[np.ndarray, "6"]
    """Joint readings from which it was taken."""
    shot: Shot
    stripe: Stripe
    profile: Profile


class Station:
    """A cell, its sensor and its controller, and what has been done with them so far."""

    def __init__(
        self,
        config: CellConfig,
        seed: int,
        recording: Recording,
        progress: Progress,
        boards: tuple[Board, ...] = (),
    ) -> None:
        """`boards` are targets besides the usual parts, out of the way until they are placed."""
        self.config, self.seed, self.recording, self.progress = config, seed, recording, progress
        own = own_cell(config)
        for remark in own.remarks:
            progress.stage(f"weldcell: note: {remark}")
        self.parts = build_parts(config, own.part)
        error = draw_error(BUDGETS[config.robot], generator(seed, "robot"), **_lever(own.arm))
        camera, plane = nominal_camera(config.sensor), nominal_plane(config.sensor)
        self.actual_plane = plane
        self.belief = believed_sensor(camera, plane, error)
        self.head = head_design(config.sensor)
        self.cell = build_cell(self.parts, self.head, error, boards, own.arm)
        known_cell = build_cell(self.parts, self.head, None, boards, own.arm)
        self.controller = build_controller(known_cell, own.arm)
        self.arm = nominal_arm(self.controller, known_cell.model)
        self.heading_rad = float(np.radians(config.seam.yaw_deg))
        home_rad = self._home_posture() if own.arm is None else own.arm.home_rad
        self.planner = MotionPlanner(controller=self.controller, known_cell=known_cell, home_rad=home_rad)
        source_camera = nominal_source_camera(config.sensor)
        self.sensor = LineSensor(
            config.sensor, camera, plane, source_camera, self.cell.model, script=config.disturbances, seed=seed
        )
        self.script: Disturbances | None = None
        """What disturbs the sensor from now on; None: what the configuration says."""
        self.joints_rad = home_rad.copy()
        self.time_s = 0.0
        self.frame = 0
        self.tip_nominal_flange = T_FLANGE_TORCH.translation
        self.sphere_known_base = 1e-3 * np.array(config.calibration.sphere_position_mm)
        self.recording.log_cell(self.cell.model)
        self.recording.log_sensor(
            camera=camera,
            plane=plane,
            source_camera=source_camera,
            fan_rad=float(np.radians(config.sensor.laser_fan_deg)),
        )

    def __enter__(self) -> "Station":
        return self

    def __exit__(self, *_: object) -> None:
        self.sensor.close()

    def rotation_base_flange(
        self, heading_rad: float, tilt_rad: float = 0.0, tilt_towards_rad: float = 0.0
    ) -> Rotation:
        """The flange's orientation that gives the torch the one of `torch_rotation`."""
        return torch_rotation(heading_rad, tilt_rad, tilt_towards_rad) * T_FLANGE_TORCH.rotation.inv()

    def place_sphere(
        self, known_base: Float[np.ndarray, "3"], stage: str, bar: tuple[Float[np.ndarray, "3"], float] | None = None
    ) -> None:
        """Puts the sphere where the controller is told it is, and actually a little off.

        On a `bar` it actually stands at this distance (m) from another sphere's actual centre.
        """
        off_m = generator(self.seed, f"{stage}/sphere").normal(size=3) * _SPHERE_MISPLACEMENT_M
        if bar is not None:
            way_m = known_base + off_m - bar[0]
            off_m = bar[0] + bar[1] * way_m / np.linalg.norm(way_m) - known_base
        self._place("sphere", translation(known_base), translation(off_m))

    def place_target(self, name: str, T_base_target: RigidTransform) -> None:
        """Puts one of the `boards` where the controller is told it is, and actually a little off."""
        off_m = generator(self.seed, f"{name}/place").normal(size=3) * _SPHERE_MISPLACEMENT_M
        for cell, T in ((self.planner.known_cell, T_base_target), (self.cell, translation(off_m) * T_base_target)):
            cell.place(name, T)
        self.recording.log_pose(self.frame, self.time_s, self.cell.data)

    def place_plate(self, misplacement: RigidTransform | None = None) -> None:
        """Puts the plate where the configuration says, and actually a little off: so much, or drawn."""
        seam = self.config.seam
        if misplacement is not None:
            self._place("plate", self.told_plate(), misplacement)
            return
        self._place_workpiece("plate", seam.position_mm, seam.yaw_deg, seam.misplacement_mm, seam.misplacement_deg)

    def told_plate(self) -> RigidTransform:
        """Where the controller is told that the plate stands."""
        return _told(self.config.seam.position_mm, self.config.seam.yaw_deg)

    def place_boss(self) -> None:
        """Puts the boss where the configuration says, and actually a little off."""
        boss = self.config.boss
        self._place_workpiece("boss", boss.position_mm, boss.yaw_deg, boss.misplacement_mm, boss.misplacement_deg)

    def go(self, joints_rad: Float[np.ndarray, "6"]) -> None:
        """Moves the arm there, clear of the parts; raises OutOfReach if there is no way."""
        motion = self.planner.move(self.joints_rad, joints_rad)
        start_s = self.time_s
        for time_s, readings_rad in zip(motion.times_s[1:], motion.joints_rad[1:], strict=True):
            self.stand_at(readings_rad, start_s + float(time_s))

    def back_off(self, distance_m: float, steps: int) -> None:
        """Draws the torch back along its wire, out of whatever it is in."""
        T_base_torch = self.controller.forward(self.joints_rad) * T_FLANGE_TORCH
        for share in np.arange(1, steps + 1) / steps:
            T_base_flange = T_base_torch * translation([0, 0, -share * distance_m]) * T_FLANGE_TORCH.inv()
            self.stand_at(self.controller.inverse(T_base_flange, self.joints_rad), self.time_s + 0.1)

    def stand_at(self, joints_rad: Float[np.ndarray, "6"], time_s: float) -> None:
        """The arm is at these readings at this time, on a motion that is known to be free."""
        self.joints_rad, self.time_s = np.asarray(joints_rad, float), time_s
        self.cell.take(self.joints_rad)
        self.recording.log_pose(self.frame, self.time_s, self.cell.data)

    def see(
        self,
        stage: str,
        index: int,
        rates_rad_s: Float[np.ndarray, "6"] | None = None,
        stray_rad: Float[np.ndarray, "6"] | None = None,
    ) -> Sight:
        """One picture from where the arm stands, with its profile.

        `rates_rad_s` are those of a moving arm's joints, `stray_rad` how far they are off now (drawn unless given).
        """
        moment = self._moment(f"{stage}/pose", index, rates_rad_s, stray_rad)
        T_base_camera, rng = self.cell.T_base("camera"), generator(self.seed, f"{stage}/picture", index)
        if self.config.sensor.profile_only:
            image, stripe = None, self.sensor.profile(self.cell.data, T_base_camera, rng, moment, self.script)
        else:
            light = self.sensor.light(self.cell.data, T_base_camera, moment, script=self.script)
            image = self.sensor.picture(light, rng)
            stripe = find_stripe(image, along=self.config.sensor.stripe_along)
        sight = Sight(
            frame=self.frame,
            joints_rad=self.joints_rad.copy(),
            shot=Shot(image=image, T_base_flange=self.controller.forward(self.joints_rad), time_s=self.time_s),
            stripe=stripe,
            profile=triangulate(stripe, self.belief.camera, self.belief.plane),
        )
        self.recording.log_pose(self.frame, self.time_s, self.cell.data)
        self.frame += 1
        return sight

    def _moment(
        self,
        stage: str,
        index: int,
        rates_rad_s: Float[np.ndarray, "6"] | None,
        stray_rad: Float[np.ndarray, "6"] | None,
    ) -> Moment:
        """What the sensor's picture needs to know of the cell, which stands as it does in the exposure's middle."""

        def take(joints_rad: Float[np.ndarray, "6"]) -> None:
            if stray_rad is None:
                self.cell.take(joints_rad, generator(self.seed, stage, index))
            else:
                self.cell.take(joints_rad + stray_rad)

        T_begin_end = STANDING
        if rates_rad_s is not None and self.config.sensor.motion_blur:
            step_rad = 0.5e-3 * self.config.sensor.exposure_ms * rates_rad_s
            ends = []
            for sign in (-1, 1):
                take(self.joints_rad + sign * step_rad)
                ends.append(self.cell.T_base("camera"))
            T_begin_end = ends[0].inv() * ends[1]
        take(self.joints_rad)
        return Moment(time_s=self.time_s, T_base_torch=self.cell.T_base("torch"), T_begin_end=T_begin_end)

    def log_sight(self, sight: Sight, T_flange_camera: RigidTransform, joint: JointFeatures | None = None) -> None:
        """Records a picture, its profile placed by a hand-eye transform, and what was found in it."""
        self.recording.log_shot(
            sight.frame,
            sight.shot,
            T_base_camera=sight.shot.T_base_flange * T_flange_camera,
            stripe=sight.stripe,
            profile=sight.profile,
            joint=joint,
        )

    def note(self, text: str) -> None:
        """Something worth a look happened."""
        self.recording.log_event(text, frame=self.frame, time_s=self.time_s, warning=True)

    def begin(self, stage: str, title: str) -> None:
        """A new stage of the work begins."""
        self.recording.begin_stage(stage, title, frame=self.frame, time_s=self.time_s)

    def send_torch(
        self,
        point_base: Float[np.ndarray, "3"],
        rotation_base_flange: Rotation,
        tip_flange: Float[np.ndarray, "3"],
        rng: np.random.Generator,
        arm: CalibratedArm | None = None,
    ) -> Float[np.ndarray, "3"]:
        """Where the actual tip goes (m, base) when the controller sends `tip_flange` to a point.

        With a calibrated `arm` the controller's readings are corrected by what is known of the arm's errors.
        """
        T_base_flange = flange_at(point_base, rotation_base_flange, tip_flange)
        joints_rad = self.controller.inverse(T_base_flange, self.joints_rad)
        if arm is not None:
            joints_rad = arm.readings(RigidTransform.concatenate([T_base_flange]), joints_rad[None])[0]
        self.cell.take(joints_rad, rng)
        return self.cell.tip_base

    def gap_to_sphere_m(self) -> float:
        """Actual distance between the surfaces of tip and sphere; negative when one is inside the other."""
        apart_m = np.linalg.norm(self.cell.tip_base - self.cell.T_base_part("sphere").translation)
        return float(apart_m) - self.parts.sphere_radius_m - self.parts.tip_radius_m

    def _home_posture(self) -> Float[np.ndarray, "6"]:
        """Readings with the torch upright over the table, clear of everything, its sensor ahead in travel."""
        rotation = self.rotation_base_flange(self.heading_rad)
        return self.controller.inverse(flange_at(_HOME_TIP_BASE, rotation, T_FLANGE_TORCH.translation), HOME_RAD)

    def _place_workpiece(
        self, part: str, position_mm: tuple[float, float, float], yaw_deg: float, off_mm: float, off_deg: float
    ) -> None:
        rng = generator(self.seed, f"{part}/place")
        off = rigid_from(
            Rotation.from_euler("Z", rng.normal() * off_deg, degrees=True),
            1e-3 * off_mm * np.append(rng.normal(size=2), 0),
        )
        self._place(part, _told(position_mm, yaw_deg), off)

    def _place(self, part: str, T_base_part: RigidTransform, misplacement: RigidTransform) -> None:
        """Puts a part on the table, the others back on the shelf, and the arm out of the way meanwhile."""
        if np.any(self.joints_rad != self.planner.home_rad):
            self.go(self.planner.home_rad)
        for cell, T in ((self.planner.known_cell, T_base_part), (self.cell, T_base_part * misplacement)):
            for other, T_base_shelf in SHELF.items():
                cell.place(other, T if other == part else T_base_shelf)
        self.recording.log_pose(self.frame, self.time_s, self.cell.data)


def _lever(arm: OwnArm | None) -> dict[str, float]:
    """How far an arm of one's own takes the flange for the joints' noise; the cell's own is known."""
    return {} if arm is None else {"flange_m_per_joint_rad": flange_m_per_joint_rad(arm, arm.home_rad)}


def _told(position_mm: tuple[float, float, float], yaw_deg: float) -> RigidTransform:
    """Where the controller is told that a part stands."""
    return rigid_from(Rotation.from_euler("Z", yaw_deg, degrees=True), 1e-3 * np.array(position_mm))


def believed_sensor(camera: CameraModel, plane: LaserPlane, error: RobotError) -> SensorBelief:
    """The actual sensor as its calibration left it."""
    turned = Rotation.from_rotvec(error.plane_rad).apply(plane.normal_camera)
    return SensorBelief(
        camera=replace(
            camera,
            focal_px=camera.focal_px * (1 + error.focal_ratio),
            principal_px=camera.principal_px + error.principal_px,
        ),
        plane=LaserPlane(normal_camera=turned / np.linalg.norm(turned), offset_m=plane.offset_m + error.plane_m),
    )

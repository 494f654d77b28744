"""A plate on the table and the sensor above it: one frame's picture and its truth.

The cell without its arm, which would be out of the picture: room, plate, and the torch where the sensor has it.
"""

from dataclasses import replace
from types import TracebackType

import mujoco
import numpy as np
from jaxtyping import Shaped
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import CellConfig
from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.cell.frames import rigid_from
from weldcell.cell.randomness import generator
from weldcell.cell.world.scene import head_design
from weldcell.models.room import build_room
from weldcell.models.torch import T_FLANGE_TORCH, build_torch
from weldcell.models.v_groove import v_groove_plate
from weldcell.models.workpiece import Workpiece
from weldcell.scenarios.dataset.plan import FramePlan, PlatePlan, tilt
from weldcell.scenarios.torch_poses import flange_at
from weldcell.sensor_sim.design import nominal_camera, nominal_plane, nominal_source_camera
from weldcell.sensor_sim.labels import FrameTruth, ghost_truth, hidden_section, stripe_mask, stripe_truth
from weldcell.sensor_sim.line_sensor import Exposure, FrameLight, LineSensor, Moment
from weldcell.sensor_sim.seam_labels import feature_truth

_END_MARGIN_M = 0.012  # at the ends the section, square to a slanting path, would miss the plate's corners
_TOOL = "tool"
_LONG_AFTER_S = 100.0  # the disturbances began: fume and spatter are there

Picture = Shaped[np.ndarray, "height width"]


class PlateScene:
    """A compiled scene with one plate; use it in a `with` block. One scene for each process."""

    def __init__(self, config: CellConfig, plan: PlatePlan, seed: int) -> None:
        plate = build_plate(config, plan).with_surface(plan.material, plan.texture, plan.tack_spots, plan.texture_seed)
        assert plate.seam_part is not None
        self._seam_part = plate.seam_part
        self._T_base_part = rigid_from(
            Rotation.from_euler("Z", config.seam.yaw_deg, degrees=True), 1e-3 * np.array(config.seam.position_mm)
        )
        self._model = _compiled(plate, self._T_base_part, 1e-3 * config.calibration.tip_radius_mm)
        self._data = mujoco.MjData(self._model)
        self._head = head_design(config.sensor)
        sensor, self._seed, self._speed_mm_s = config.sensor, seed, config.seam.speed_mm_s
        source_camera = nominal_source_camera(sensor)
        self._sensor = LineSensor(
            sensor, nominal_camera(sensor), nominal_plane(sensor), source_camera, self._model, seed=seed
        )

    def __enter__(self) -> "PlateScene":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sensor.close()

    @property
    def geom_names(self) -> list[str]:
        """Names of the geoms by their ids."""
        return [self._model.geom(k).name for k in range(self._model.ngeom)]

    def frame(self, plan: FramePlan) -> tuple[Picture, FrameTruth]:
        """The picture of one frame and all that is true of it."""
        T_base_flange = self._T_base_flange(plan)
        self._place_torch(T_base_flange)
        exposure = Exposure(exposure_ms=plan.exposure_ms, gain_db=plan.gain_db, ambient_grey=plan.ambient_grey)
        own_seed = int(generator(self._seed, "dataset/disturbances", plan.number).integers(2**31))
        light = self._sensor.light(
            self._data,
            T_base_flange * self._head.T_flange_camera,
            Moment(
                time_s=_LONG_AFTER_S,
                T_base_torch=T_base_flange * T_FLANGE_TORCH,
                T_begin_end=self._motion(1e-3 * plan.exposure_ms),
            ),
            exposure=exposure,
            script=self._sensor.scripted(plan.disturbances, own_seed, plan.exposure_ms),
        )
        picture = self._sensor.picture(light, generator(self._seed, "dataset/picture", plan.number), exposure)
        return picture, self._truth(light, T_base_flange, plan)

    def _truth(self, light: FrameLight, T_base_flange: RigidTransform, plan: FramePlan) -> FrameTruth:
        camera, fan = self._sensor.camera, self._sensor.fan
        faintest_grey = 1 / (plan.exposure_ms * light.exposure_ratio * 10 ** (plan.gain_db / 20))
        hidden_pieces = self._sensor.pieces(hidden_section(light.section, camera))
        T_camera_part = light.T_base_camera.inv() * self._T_base_part
        lines_camera = {name: T_camera_part.apply(line) for name, line in self._seam_part.points.items()}
        features = feature_truth(lines_camera, camera, fan, self._sensor.caster, self._data, light.T_base_camera)
        ghost_mask = np.zeros((camera.height_px, camera.width_px), bool)
        for _, pieces in light.ghosts:
            ghost_mask |= stripe_mask(pieces, camera, faintest_grey)
        return FrameTruth(
            camera=camera,
            plane=fan.plane,
            T_base_flange_actual=T_base_flange,
            T_base_flange_nominal=T_base_flange,  # no arm carries it, so no arm errs
            T_flange_camera=T_base_flange.inv() * light.T_base_camera,
            T_base_part=self._T_base_part,
            stripe=stripe_truth(light.section, light.stripe, hidden_pieces, camera, fan.plane),
            ghosts=ghost_truth(light.ghosts, camera),
            features=features if light.laser_on else replace(features, visibility=np.zeros_like(features.visibility)),
            stripe_mask=stripe_mask(light.stripe, camera, faintest_grey),
            ghost_mask=ghost_mask,
        )

    def _T_base_flange(self, plan: FramePlan) -> RigidTransform:
        """Where the flange is, so that the light crosses the seam where the plan says."""
        seam = self._seam_part
        first_m, last_m = seam.arc_length_m[0] + _END_MARGIN_M, seam.arc_length_m[-1] - _END_MARGIN_M
        at_m = first_m + plan.place_ratio * (last_m - first_m) + np.array([-1e-4, 0.0, 1e-4])
        before, place, after = self._T_base_part.apply((seam.at("left", at_m) + seam.at("right", at_m)) / 2)
        heading_rad = float(np.arctan2(*(after - before)[[1, 0]]))
        left = np.array([-np.sin(heading_rad), np.cos(heading_rad), 0.0])
        crossing_base = place + 1e-3 * (plan.lateral_mm * left + np.array([0.0, 0.0, plan.height_mm]))
        rotation = tilt(plan, heading_rad) * T_FLANGE_TORCH.rotation.inv()
        return flange_at(crossing_base, rotation, self._head.crossing_flange)

    def _motion(self, exposure_s: float) -> RigidTransform:
        """How the camera moves along the torch's direction of travel meanwhile, in its own frame."""
        travel_torch = np.array([1e-3 * self._speed_mm_s * exposure_s, 0.0, 0.0])
        R_camera_torch = self._head.T_flange_camera.rotation.inv() * T_FLANGE_TORCH.rotation
        return rigid_from(Rotation.identity(), R_camera_torch.apply(travel_torch))

    def _place_torch(self, T_base_flange: RigidTransform) -> None:
        tool = int(self._model.body(_TOOL).mocapid[0])
        self._data.mocap_pos[tool] = T_base_flange.translation
        self._data.mocap_quat[tool] = T_base_flange.rotation.as_quat(scalar_first=True)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)


def build_plate(config: CellConfig, plan: PlatePlan) -> Workpiece:
    """The plate of a plan; raises BadInput if there is no such plate."""
    seam = config.seam
    try:
        return v_groove_plate(
            length_m=1e-3 * seam.length_mm,
            width_m=1e-3 * seam.width_mm,
            thickness_m=1e-3 * (plan.groove_depth_mm + seam.root_face_mm),
            groove_angle_rad=float(np.radians(plan.groove_angle_deg)),
            root_gap_m=1e-3 * plan.root_gap_mm,
            root_face_m=1e-3 * seam.root_face_mm,
            amplitude_m=1e-3 * plan.amplitude_mm,
        )
    except BadGeometry as error:
        raise BadInput(f"dataset.groove_angle_deg, groove_depth_mm, root_gap_mm, amplitude_mm: {error}") from error


def _compiled(plate: Workpiece, T_base_part: RigidTransform, tip_radius_m: float) -> mujoco.MjModel:
    spec = build_room()
    plate.add_to(spec, T_base_part)
    tool = spec.worldbody.add_body(name=_TOOL, mocap=True)
    spec.attach(build_torch(tip_radius_m=tip_radius_m), prefix="torch/", frame=tool.add_frame())
    return spec.compile()

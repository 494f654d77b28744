"""The laser-line sensor: from the scene and the camera's actual pose to the picture that it takes.

A frame is made in two steps: `light` follows the laser (stripe, ghosts) and renders the cell's light, with all that
disturbs it; `picture` lets the speckle and the camera's chip make numbers of it. `capture` does both. `profile` skips
the picture: the stripe's exact centres with the scatter that the same physics gives them.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from types import TracebackType

import mujoco
import numpy as np
from jaxtyping import Float, Int, Shaped
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import Disturbance, SensorConfig
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import Stripe
from weldcell.sensor_sim.ambient import AmbientRenderer
from weldcell.sensor_sim.centre_noise import centre_noise
from weldcell.sensor_sim.chip import camera_chip, expose
from weldcell.sensor_sim.disturbances import Disturbances
from weldcell.sensor_sim.drawing import LaserLight, draw_stripe
from weldcell.sensor_sim.ghosts import GhostTracer
from weldcell.sensor_sim.laser import RAYS_PER_PIXEL, LaserFan, laser_fan
from weldcell.sensor_sim.light_section import LightSection, light_section
from weldcell.sensor_sim.mirrors import Mirrors
from weldcell.sensor_sim.profile_only import found_centres
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.reflectance import brightness, light_reference
from weldcell.sensor_sim.speckle import nominal_speckle, speckle_contrast, with_speckle
from weldcell.sensor_sim.stripe import StripePieces, joined_pieces, stripe_optics, stripe_pieces
from weldcell.sensor_sim.weld.weld_light import WeldLight

_BLUR_STEPS = 5  # poses that stand for a motion during the exposure, which is a pixel or so long
STANDING = RigidTransform.identity()


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """When a picture is taken, and what moves meanwhile."""

    time_s: float = 0.0
    """Time of the job: disturbances go by it."""
    T_base_torch: RigidTransform | None = None
    """Where the torch actually is; None without a torch (there is no weld then)."""
    T_begin_end: RigidTransform = STANDING
    """The camera at the exposure's end in its own frame at the beginning; blurs the picture."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Exposure:
    """What may differ from one picture to the next."""

    exposure_ms: float
    """Exposure time."""
    gain_db: float
    """Gain."""
    ambient_grey: float
    """Level of a white surface in the cell's light, after 1 ms at 0 dB."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameLight:
    """All light of one frame before the chip sees it, and where it comes from."""

    T_base_camera: RigidTransform
    """Where the camera actually was, knocks included."""
    section: LightSection
    """What the laser lights."""
    stripe: StripePieces
    """The stripe, as bright as disturbances leave it."""
    ghosts: tuple[tuple[LightSection, StripePieces], ...]
    """Ghost stripes: what mirrors throw on other surfaces, and the stripe as it shows in mirrors."""
    laser: LaserLight
    """Stripe and ghosts drawn, blurred by motion if there is any, without speckle (levels of 255 at 1 ms, 0 dB)."""
    ambient_grey: Float[np.ndarray, "height width"]
    """All other light."""
    exposure_ratio: float
    """Exposure over what was asked for: a stuck one differs."""
    laser_on: bool
    """Whether the laser gives any light at all."""


class LineSensor:
    """A laser-line sensor in a scene; use it in a `with` block, or call `close`. One sensor for each thread."""

    def __init__(
        self,
        config: SensorConfig,
        camera: CameraModel,
        plane: LaserPlane,
        laser_source_camera: Float[np.ndarray, "3"],
        model: mujoco.MjModel,
        *,
        script: tuple[Disturbance, ...] = (),
        seed: int = 0,
    ) -> None:
        """`camera`, `plane` and `laser_source_camera` (m, camera frame) are the actual ones of this sensor.

        `script` says what disturbs it, `seed` how it happens and which chip of its series it has.
        """
        self.camera, self.fan = camera, laser_fan(config, plane, laser_source_camera)
        self._sparse_fan = self.fan.thinned(RAYS_PER_PIXEL)
        self.caster = RayCaster(model)
        self._config, self._model, self._seed = config, model, seed
        self._optics, self._reference = stripe_optics(config, camera, self.fan), light_reference(self.fan)
        self._mirrors = Mirrors(model, self.caster)
        self._ghosts = GhostTracer(self._mirrors, camera, self.fan, self._reference)
        self._speckle = nominal_speckle(config)
        surfaces = self._mirrors.surfaces
        contrast = speckle_contrast(config, surfaces.depolarises, surfaces.height_sigma_m)
        self._contrast = contrast * float(config.noise)
        self._chip = camera_chip(config, seed)
        self._centre_noise = centre_noise(self._chip, self._speckle)
        self._nominal = Exposure(
            exposure_ms=config.exposure_ms, gain_db=config.gain_db, ambient_grey=config.ambient_grey
        )
        self._script = self.scripted(script, seed)
        self._ambient = AmbientRenderer(model, camera, 1.0, self._optics.lens.sharpest_sigma_px)

    def __enter__(self) -> "LineSensor":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Free the graphics memory."""
        self._ambient.close()

    def scripted(self, script: tuple[Disturbance, ...], seed: int, exposure_ms: float | None = None) -> Disturbances:
        """Disturbances of this sensor in its scene, for `light`; what moves is blurred over the exposure."""
        return Disturbances(script, seed, 1e-3 * (exposure_ms or self._config.exposure_ms), lambda: self._weld)

    @cached_property
    def _weld(self) -> WeldLight:
        """What a weld does to the pictures; made when there is one."""
        return WeldLight(self._config, self.camera, self.fan, self._optics, self._model, self.caster)

    def capture(
        self, data: mujoco.MjData, T_base_camera: RigidTransform, rng: np.random.Generator, moment: Moment | None = None
    ) -> Shaped[np.ndarray, "height width"]:
        """The picture (uint8, or uint16 for 12 bits) taken with the camera at `T_base_camera`.

        `data` needs up-to-date kinematics (mj_kinematics, and mj_camlight for the model's own lights).
        """
        return self.picture(self.light(data, T_base_camera, moment), rng)

    def profile(
        self,
        data: mujoco.MjData,
        T_base_camera: RigidTransform,
        rng: np.random.Generator,
        moment: Moment | None = None,
        script: Disturbances | None = None,
    ) -> Stripe:
        """The stripe that would be found in the picture, without making one: exact centres, scattered as pictures do.

        Ghosts, motion blur and the weld's light play no part; what dims, stops or knocks the sensor does. One ray for
        each cut follows the light: the stripe's ends are right to a cut, as in the picture's blur.
        """
        moment = moment or Moment()
        frame = (script or self._script).frame(moment.time_s, data, T_base_camera, moment.T_base_torch)
        section = light_section(self.caster, data, frame.T_base_camera, self.camera, self._sparse_fan)
        pieces = frame.dim_laser(self._stripe(data, frame.T_base_camera, section, self._sparse_fan))
        geom_id = _geoms(section, pieces)
        noise = self._centre_noise
        chip = replace(noise.chip, electrons_per_light=noise.chip.electrons_per_light * frame.exposure_ratio)
        return found_centres(
            pieces,
            self._mirrors.surfaces.diffuse_albedo[geom_id] * self._nominal.ambient_grey,
            self._contrast[geom_id],
            self.camera,
            replace(noise, chip=chip),
            rng,
        )

    def light(
        self,
        data: mujoco.MjData,
        T_base_camera: RigidTransform,
        moment: Moment | None = None,
        *,
        exposure: Exposure | None = None,
        script: Disturbances | None = None,
    ) -> FrameLight:
        """All light of a frame; `exposure` and `script` are the sensor's own unless given."""
        moment, exposure = moment or Moment(), exposure or self._nominal
        frame = (script or self._script).frame(moment.time_s, data, T_base_camera, moment.T_base_torch)
        middle = frame.T_base_camera
        section = light_section(self.caster, data, middle, self.camera, self.fan)
        if frame.laser_ratio <= 0:
            section = _unlit(section)
        stripe = frame.dim_laser(self._stripe(data, middle, section))
        ghosts = [(own, frame.dim_laser(ghost)) for own, ghost in self._ghost_pieces(data, middle, section)]
        pieces = [stripe, *(ghost for _, ghost in ghosts)]
        if self._config.motion_blur and moment.T_begin_end is not STANDING:
            poses = _poses(middle, moment.T_begin_end)
            pieces = [one for pose in poses for one in self._pieces_at(data, pose)]
            pieces = [_dimmed(frame.dim_laser(one), 1 / _BLUR_STEPS) for one in pieces]
            ambient_grey = np.mean([self._ambient.render(data, pose) for pose in poses], axis=0)
        else:
            ambient_grey = self._ambient.render(data, middle)
        return FrameLight(
            T_base_camera=middle,
            section=section,
            stripe=stripe,
            ghosts=tuple(ghosts),
            laser=draw_stripe(joined_pieces(pieces), self.camera.width_px, self.camera.height_px),
            ambient_grey=frame.disturb_ambient(ambient_grey * np.float32(exposure.ambient_grey)),
            exposure_ratio=frame.exposure_ratio,
            laser_on=frame.laser_ratio > 0,
        )

    def picture(
        self, light: FrameLight, rng: np.random.Generator, exposure: Exposure | None = None
    ) -> Shaped[np.ndarray, "height width"]:
        """What the chip makes of a frame's light; the same `rng` gives the same bytes."""
        contrast = self._contrast_map(light)
        laser = with_speckle(light.laser, self._speckle, rng, contrast)
        ratio, gain = light.exposure_ratio, 1.0
        if exposure is not None:
            ratio *= exposure.exposure_ms / self._config.exposure_ms
            gain = 10 ** ((exposure.gain_db - self._config.gain_db) / 20)
        chip = replace(
            self._chip,
            electrons_per_light=self._chip.electrons_per_light * ratio,
            levels_per_electron=self._chip.levels_per_electron * gain,
        )
        return expose(light.ambient_grey, laser, chip, rng)

    def truth(self, data: mujoco.MjData, T_base_camera: RigidTransform) -> tuple[LightSection, StripePieces]:
        """What is lit and seen, and the exact stripe, undisturbed: for labels and checks, never for a pipeline."""
        section = light_section(self.caster, data, T_base_camera, self.camera, self.fan)
        return section, self._stripe(data, T_base_camera, section)

    def pieces(self, section: LightSection) -> StripePieces:
        """The pieces of any section as if it were lit evenly: where a stripe would be."""
        return stripe_pieces(section, np.ones(len(section.lit)), self.camera, self._optics)

    def _stripe(
        self, data: mujoco.MjData, T_base_camera: RigidTransform, section: LightSection, fan: LaserFan | None = None
    ) -> StripePieces:
        """The stripe of a section by the fan, the sensor's own unless given."""
        texture = self._mirrors.textures.factor(
            data,
            T_base_camera.apply(section.points_camera),
            T_base_camera.rotation.apply(section.normals_camera),
            section.geom_id,
        )
        surfaces = self._mirrors.surfaces.at(section.geom_id)
        relative = brightness(section, (fan or self.fan).power_ratio, surfaces, self._reference, texture)
        return stripe_pieces(section, relative, self.camera, self._optics)

    def _ghost_pieces(
        self, data: mujoco.MjData, T_base_camera: RigidTransform, section: LightSection
    ) -> list[tuple[LightSection, StripePieces]]:
        if not self._config.second_bounce:
            return []
        return [
            (ghost.section, stripe_pieces(ghost.section, ghost.brightness, self.camera, self._optics))
            for ghost in self._ghosts.ghosts(data, T_base_camera, section)
        ]

    def _pieces_at(self, data: mujoco.MjData, T_base_camera: RigidTransform) -> list[StripePieces]:
        """Stripe and ghosts with the camera somewhere else."""
        section = light_section(self.caster, data, T_base_camera, self.camera, self.fan)
        ghosts = self._ghost_pieces(data, T_base_camera, section)
        return [self._stripe(data, T_base_camera, section), *(ghost for _, ghost in ghosts)]

    def _contrast_map(self, light: FrameLight) -> Float[np.ndarray, "..."] | None:
        """Speckle contrast for each cut of the stripe, by the surface lit there; one number if all are alike."""
        pieces = light.stripe
        if len(pieces.ray) == 0:
            return None
        lit = self._contrast[_geoms(light.section, pieces)]
        if np.ptp(lit) == 0:
            return np.asarray(lit[:1])
        rows = pieces.along == "rows"
        by_cut = np.full(self.camera.width_px if rows else self.camera.height_px, lit.mean())
        by_cut[pieces.cut_px] = lit
        return by_cut[None, :] if rows else by_cut[:, None]


def _unlit(section: LightSection) -> LightSection:
    """The section of a laser that is off."""
    none = np.zeros(len(section.lit), bool)
    return replace(section, lit=none, visible=none, seen=none)


def _geoms(section: LightSection, pieces: StripePieces) -> Int[np.ndarray, "k"]:
    """The geom that each piece lies on."""
    return section.geom_id[np.clip(np.rint(pieces.ray).astype(np.int64), 0, len(section.geom_id) - 1)]


def _dimmed(pieces: StripePieces, share: float) -> StripePieces:
    return replace(pieces, amplitude_grey=share * pieces.amplitude_grey)


def _poses(T_base_middle: RigidTransform, T_begin_end: RigidTransform) -> list[RigidTransform]:
    """Poses of a camera that moves evenly through the middle of its exposure.

    They are spaced so that their variance, n^2 - 1 over 12 for n steps of one, is the even motion's: 1/12.
    """
    turn, shift = T_begin_end.rotation.as_rotvec(), T_begin_end.translation
    shares = (np.arange(_BLUR_STEPS) - (_BLUR_STEPS - 1) / 2) / np.sqrt(_BLUR_STEPS**2 - 1)
    return [T_base_middle * rigid_from(Rotation.from_rotvec(share * turn), share * shift) for share in shares]

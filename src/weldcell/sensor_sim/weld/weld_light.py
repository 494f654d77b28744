"""All light of the weld in one picture: what is added to the cell's light and what is taken from it and from the laser.

Light is counted in levels of 255 at an exposure of 1 ms: the mean over the exposure, which the camera then multiplies
by its length.
"""

from dataclasses import dataclass, replace

import cv2
import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.focus import lens
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.rays import RayCaster
from weldcell.sensor_sim.stripe import StripeOptics, StripePieces
from weldcell.sensor_sim.weld.arc import (
    ArcLight,
    Patch,
    arc_core,
    arc_light,
    arc_seen,
    free_ways_m,
    glare_radiance,
    unit,
)
from weldcell.sensor_sim.weld.coarse_view import CoarseView, SeenCells
from weldcell.sensor_sim.weld.fume import FumeCloud, light_sheet, pieces_of, scattered_arc
from weldcell.sensor_sim.weld.lit_surfaces import LitSurfaces
from weldcell.sensor_sim.weld.photometry import photometry
from weldcell.sensor_sim.weld.spatter import Droplets, glowing, landing_age_s
from weldcell.sensor_sim.weld.spatter_streaks import spatter_streaks
from weldcell.sensor_sim.weld.streaks import Streaks, draw_streaks

_WORKPIECES = (0,)
"""Geom groups that stop the arc's light and spatter: parts and room. The arc burns within the torch's own wire."""
_FUME_CELL_PX = 80.0  # over a whole way all but the largest wisps average out
_HIDDEN_M = 0.004  # droplets this far behind the surface that a cell's middle shows are hidden


@dataclass(frozen=True, kw_only=True)
class WeldState:
    """How strongly the weld goes on during a picture."""

    arc: float
    """Strength of the arc, its flicker included."""
    fume: float
    """Strength of the fume."""
    cloud: FumeCloud
    """Where the fume is."""
    droplets: Droplets
    """The spatter that is about."""
    laser: float
    """Share of the laser's power that is on."""
    window_s: tuple[float, float]
    """Start and end of the exposure."""


@dataclass(frozen=True, kw_only=True)
class WeldPicture:
    """What the weld makes of one picture's light; fields are by the cells of a coarse view, None for no change."""

    view: CoarseView
    """The cells."""
    left: Float[np.ndarray, "n"] | None = None
    """What fume leaves of light from the surfaces to the camera."""
    lit_grey: Float[np.ndarray, "height width"] | None = None
    """Surfaces in the arc's light, pixel by pixel (float32), levels of 255 at 1 ms."""
    veil_grey: Float[np.ndarray, "n"] | None = None
    """Glare and light scattered by fume, levels of 255 at 1 ms."""
    laser_left: Float[np.ndarray, "n"] | None = None
    """What fume leaves of the stripe, from the laser by way of the work to the camera."""
    streaks: Streaks | None = None
    """Spatter."""
    core: Patch | None = None
    """The arc itself where it is in view, levels of 255 at 1 ms."""

    def disturb_ambient(self, ambient_grey: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
        """A picture of the cell's light with the weld's light and fume (float32)."""
        grey = self._lit(np.array(ambient_grey, dtype=np.float32))
        if self.veil_grey is not None:
            cv2.add(grey, self.view.whole(self.veil_grey), dst=grey)
        if self.streaks is not None:
            draw_streaks(grey, self.streaks)
        if self.core is not None:
            grey[self.core.rows, self.core.columns] += self.core.values.astype(np.float32)
        return grey

    def dim_laser(self, pieces: StripePieces) -> StripePieces:
        """The stripe, or a ghost of it, after the fume."""
        if self.laser_left is None:
            return pieces
        left = self.view.at(self.laser_left, np.column_stack([pieces.u_px, pieces.v_px]))
        return replace(pieces, amplitude_grey=pieces.amplitude_grey * left)

    def _lit(self, grey: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
        """The cell's and the arc's light on the surfaces, less what fume takes."""
        if self.lit_grey is not None:
            cv2.add(grey, self.lit_grey, dst=grey)
        if self.left is not None:
            cv2.multiply(grey, self.view.whole(self.left), dst=grey)
        return grey


class WeldLight:
    """What any weld does to the pictures of one sensor in a scene; one for each thread."""

    def __init__(
        self,
        config: SensorConfig,
        camera: CameraModel,
        fan: LaserFan,
        optics: StripeOptics,
        model: mujoco.MjModel,
        caster: RayCaster,
    ) -> None:
        """`camera`, `fan` and `optics` are the actual ones of this sensor, `caster` has all that it sees."""
        self._response, self._glass, self._camera = photometry(config), lens(config), camera
        self._view, self._fume_view = CoarseView(camera), CoarseView(camera, cell_px=_FUME_CELL_PX)
        self._sheet = light_sheet(fan, optics, self._fume_view.directions_camera)
        self._source_camera = fan.source_camera
        self._caster, self._opaque = caster, np.isin(model.geom_group, _WORKPIECES)
        self._surfaces = LitSurfaces(camera, model, caster, self._opaque)

    def picture(
        self, state: WeldState, data: mujoco.MjData, T_base_camera: RigidTransform, T_base_torch: RigidTransform
    ) -> WeldPicture:
        """What the weld makes of a picture with camera and torch actually there.

        `data` needs up-to-date kinematics.
        """
        moment = self._moment(state, arc_light(T_base_torch, state.arc), data, T_base_camera, T_base_torch)
        picture = WeldPicture(view=self._view)
        if state.fume > 0:
            picture = self._with_fume(picture, moment)
        if state.arc > 0:
            picture = self._with_arc(picture, moment)
        if len(state.droplets.birth_s):
            picture = self._with_spatter(picture, moment)
        return picture

    def _moment(
        self,
        state: WeldState,
        arc: ArcLight,
        data: mujoco.MjData,
        T_base_camera: RigidTransform,
        T_base_torch: RigidTransform,
    ) -> "_Moment":
        """What stands where: one set of rays from the camera, one from the arc."""
        seen = self._view.look(self._caster, data, T_base_camera)
        droplets = state.droplets.chosen(glowing(state.droplets, state.window_s[0]))
        to_camera = seen.centre_base - arc.position_base
        free_m = free_ways_m(
            arc, unit(np.vstack([to_camera, droplets.velocity_base])), self._caster, data, self._opaque
        )
        return _Moment(
            state=replace(state, droplets=droplets),
            arc=arc,
            T_base_camera=T_base_camera,
            seen=seen,
            data=data,
            tip_below_m=float(arc.position_base[2] - T_base_torch.translation[2]),
            free_to_camera_m=float(free_m[0]),
            free_to_droplets_m=free_m[1:],
        )

    def _with_fume(self, picture: WeldPicture, moment: "_Moment") -> WeldPicture:
        """Beer and Lambert's law on the ways to the camera and from the laser, and what the cloud scatters."""
        arc, time_s, strength = moment.arc, sum(moment.state.window_s) / 2, moment.state.fume
        range_m = self._view.at(moment.seen.range_m, self._fume_view.pixels)
        surface_camera = range_m[:, None] * self._fume_view.directions_camera
        centre, source, at_sheet, stops = (
            moment.T_base_camera.apply(points) - arc.position_base
            for points in (np.zeros(3), self._source_camera, self._sheet.points_camera, surface_camera)
        )
        places, piece_m = pieces_of(centre, stops)
        extinction = strength * moment.state.cloud.extinction_per_m(places, time_s)
        left = np.exp(-extinction.sum(axis=1) * piece_m)
        laser_places, laser_piece_m = pieces_of(source, at_sheet)
        laser_extinction = strength * moment.state.cloud.extinction_per_m(laser_places, time_s)
        laser_left = np.exp(-laser_extinction.sum(axis=1) * laser_piece_m)
        haze = laser_extinction[:, -1] * laser_left * self._sheet.haze_grey_m * (self._sheet.range_m < range_m)
        lit = self._response.grey_per_radiance * scattered_arc(extinction, centre, stops, arc.intensity)
        fields = left, moment.state.laser * haze + lit, laser_left * left
        left, veil, laser_left = (self._fume_view.at(field, self._view.pixels) for field in fields)
        return replace(picture, left=left, veil_grey=veil, laser_left=laser_left)

    def _with_arc(self, picture: WeldPicture, moment: "_Moment") -> WeldPicture:
        """What the arc lights; its glare and the arc itself, if the camera sees it."""
        arc, seen, grey = moment.arc, moment.seen, self._response.grey_per_radiance
        lit = self._surfaces.radiance(arc, moment.data, moment.T_base_camera) * np.float32(grey)
        cv2.GaussianBlur(lit, (0, 0), self._glass.sharpest_sigma_px, dst=lit)
        picture = replace(picture, lit_grey=lit)
        if not arc_seen(arc, seen.centre_base, moment.free_to_camera_m):
            return picture
        veil = grey * glare_radiance(arc, self._view, moment.T_base_camera)
        core = arc_core(arc, self._camera, moment.T_base_camera)
        return replace(
            picture,
            veil_grey=veil if picture.veil_grey is None else picture.veil_grey + veil,
            core=None if core is None else replace(core, values=grey * core.values),
        )

    def _with_spatter(self, picture: WeldPicture, moment: "_Moment") -> WeldPicture:
        """Streaks of droplets that no surface hides."""
        droplets = moment.state.droplets
        landing_s = landing_age_s(droplets, moment.free_to_droplets_m, moment.tip_below_m)
        origin_camera = moment.T_base_camera.inv().apply(moment.arc.position_base)
        streaks, distance_m = spatter_streaks(
            droplets, landing_s, moment.state.window_s, origin_camera, self._camera, moment.T_base_camera,
            self._glass, self._response,
        )  # fmt: skip
        middle_px = (streaks.start_px + streaks.stop_px) / 2
        free = distance_m < self._view.at(moment.seen.range_m, middle_px) + _HIDDEN_M
        if picture.left is not None:
            streaks = replace(streaks, light_grey=streaks.light_grey * self._view.at(picture.left, middle_px))
        return replace(picture, streaks=streaks.chosen(free))


@dataclass(frozen=True, kw_only=True)
class _Moment:
    """What stands where while a picture is taken."""

    state: WeldState
    arc: ArcLight
    T_base_camera: RigidTransform
    seen: SeenCells
    data: mujoco.MjData
    tip_below_m: float
    """Height of the arc over the torch's tip."""
    free_to_camera_m: float
    """How far the way from the arc to the camera is free."""
    free_to_droplets_m: Float[np.ndarray, "k"]
    """The same where each droplet flies."""

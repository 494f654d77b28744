"""Scripted disturbances: what the weld's light, a knock or a fault does to the sensor at a given time.

Each entry of the script acts from `start_s` up to before `end_s`; entries of one kind add up. What `strength` means:
- arc: multiples of 10 W in the filter's band (`weld.arc`);
- spatter: multiples of 800 droplets a second (`weld.spatter`);
- fume: multiples of an extinction of 1/m at the arc (`weld.fume`);
- stripe-lost: the share of the laser's power that is missing; 1 and more is all of it;
- sensor-knocked: the head stands off by 1 mm and 0.5 deg times the strength, in a direction drawn from the seed;
- stuck-exposure: the exposure is 8 times the strength of what it should be: 1 is far too long, 0.02 far too short.

What happens depends on the seed, the entry's place in the script and the time, not on what was asked before. An
exposure lies evenly about its picture's time.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import Disturbance, DisturbanceKind
from weldcell.cell.frames import rigid_from
from weldcell.cell.randomness import generator
from weldcell.sensor_sim.stripe import StripePieces
from weldcell.sensor_sim.weld.arc import ArcFlicker
from weldcell.sensor_sim.weld.fume import FumeCloud
from weldcell.sensor_sim.weld.spatter import DROPLETS_PER_S, LIFE_S, Droplets, born, joined
from weldcell.sensor_sim.weld.weld_light import WeldLight, WeldPicture, WeldState

_KNOCK_M, _KNOCK_RAD = 1e-3, np.deg2rad(0.5)
_STUCK_RATIO = 8.0
_SHORTEST_RATIO = 1e-6  # the camera takes no exposure of zero
_WELD: tuple[DisturbanceKind, ...] = ("arc", "spatter", "fume")


@dataclass(frozen=True, kw_only=True)
class DisturbedFrame:
    """One picture under its disturbances; without any, everything is as it was given."""

    T_base_camera: RigidTransform
    """Where the camera actually stands: rays and labels start from here."""
    exposure_ratio: float = 1.0
    """Actual exposure by what it should be."""
    laser_ratio: float = 1.0
    """Share of the laser's power that is on."""
    weld: WeldPicture | None = None
    """The weld's light and fume."""

    def disturb_ambient(self, ambient_grey: Float[np.ndarray, "height width"]) -> Float[np.ndarray, "height width"]:
        """The picture of all light but the laser's: levels of 255 at 1 ms and 0 dB, as the cell's light comes in."""
        return ambient_grey if self.weld is None else self.weld.disturb_ambient(ambient_grey)

    def dim_laser(self, pieces: StripePieces) -> StripePieces:
        """The stripe (or a ghost of it) as bright as fume and a failing laser leave it."""
        if self.laser_ratio < 1:
            pieces = replace(pieces, amplitude_grey=self.laser_ratio * pieces.amplitude_grey)
        return pieces if self.weld is None else self.weld.dim_laser(pieces)


class Disturbances:
    """The script of one job for one sensor in a scene; one for each thread."""

    def __init__(
        self,
        script: tuple[Disturbance, ...],
        seed: int,
        exposure_s: float,
        weld: Callable[[], WeldLight],
    ) -> None:
        """`exposure_s` is what the exposure should be; `weld` gives the sensor's, and is asked only for a weld."""
        self._script, self._seed, self._exposure_s = script, seed, exposure_s
        self._weld = weld() if any(entry.kind in _WELD for entry in script) else None
        self._flicker, self._cloud = ArcFlicker(seed), FumeCloud(seed)

    def frame(
        self, time_s: float, data: mujoco.MjData, T_base_camera: RigidTransform, T_base_torch: RigidTransform | None
    ) -> DisturbedFrame:
        """The picture taken at `time_s`, were the camera at `T_base_camera`, with the torch actually at `T_base_torch`.

        Without a torch there is no weld. `data` needs up-to-date kinematics.
        """
        if not any(True for _ in self._active(time_s)):
            return DisturbedFrame(T_base_camera=T_base_camera)
        for index, entry in self._active(time_s, "sensor-knocked"):
            T_base_camera = T_base_camera * knock(generator(self._seed, "sensor-knocked", index), entry.strength)
        stuck = [_STUCK_RATIO * entry.strength for _, entry in self._active(time_s, "stuck-exposure")]
        exposure_ratio = max(float(np.prod(stuck)), _SHORTEST_RATIO)
        laser_ratio = max(1 - self._strength(time_s, "stripe-lost"), 0.0)
        state = self._state(time_s, exposure_ratio, laser_ratio)
        weld = None
        if (
            self._weld is not None
            and T_base_torch is not None
            and (state.arc > 0 or state.fume > 0 or len(state.droplets.birth_s))
        ):
            weld = self._weld.picture(state, data, T_base_camera, T_base_torch)
        return DisturbedFrame(
            T_base_camera=T_base_camera, exposure_ratio=exposure_ratio, laser_ratio=laser_ratio, weld=weld
        )

    def _state(self, time_s: float, exposure_ratio: float, laser_ratio: float) -> WeldState:
        """How strongly the weld goes on."""
        half_s = exposure_ratio * self._exposure_s / 2
        window_s, arc = (time_s - half_s, time_s + half_s), self._strength(time_s, "arc")
        return WeldState(
            arc=arc * self._flicker.mean(*window_s) if arc > 0 else 0.0,
            fume=self._strength(time_s, "fume"),
            cloud=self._cloud,
            droplets=joined([self._droplets(*spatter, time_s + half_s) for spatter in self._active(time_s, "spatter")]),
            laser=laser_ratio,
            window_s=window_s,
        )

    def _droplets(self, index: int, entry: Disturbance, until_s: float) -> Droplets:
        """What an entry has thrown out and is still about at the end of an exposure."""
        start_s, end_s = max(entry.start_s, until_s - LIFE_S), min(entry.end_s, until_s)
        return born(self._seed, f"spatter/{index}", start_s, end_s, DROPLETS_PER_S * entry.strength)

    def _strength(self, time_s: float, kind: DisturbanceKind) -> float:
        return float(sum(entry.strength for _, entry in self._active(time_s, kind)))

    def _active(self, time_s: float, kind: DisturbanceKind | None = None) -> Iterator[tuple[int, Disturbance]]:
        """Entries that act at a time, with their places in the script."""
        for index, entry in enumerate(self._script):
            if entry.start_s <= time_s < entry.end_s and kind in (None, entry.kind):
                yield index, entry


def knock(rng: np.random.Generator, strength: float) -> RigidTransform:
    """Where a knocked camera stands in the frame of the camera as it was: a shift and a turn of drawn directions."""
    shift, axis = rng.normal(size=(2, 3))
    rotation = Rotation.from_rotvec(strength * _KNOCK_RAD * axis / np.linalg.norm(axis))
    return rigid_from(rotation, strength * _KNOCK_M * shift / np.linalg.norm(shift))

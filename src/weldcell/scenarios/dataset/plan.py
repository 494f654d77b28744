"""What each plate and each frame of a data set is: drawn from the seed and its own number alone.

So frame 17 is the same in a set of 20 and of 20 000, whichever worker makes it, and whenever.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from weldcell.cell.configuration import (
    DatasetConfig,
    Disturbance,
    DisturbanceKind,
    MaterialName,
    SensorConfig,
    TextureName,
)
from weldcell.cell.errors import BadInput
from weldcell.cell.randomness import generator
from weldcell.scenarios.torch_poses import torch_rotation

_TORCH_CLEARANCE_M = 0.003  # of the wire's tip over the plate
_TRIES = 100


@dataclass(frozen=True, kw_only=True)
class PlatePlan:
    """One plate; fields as in `SeamConfig`."""

    number: int
    groove_angle_deg: float
    groove_depth_mm: float
    root_gap_mm: float
    amplitude_mm: float
    material: MaterialName
    texture: TextureName
    tack_spots: int
    texture_seed: int
    """Where the pattern comes from."""


@dataclass(frozen=True, kw_only=True)
class FramePlan:
    """One frame; fields as in `DatasetConfig`."""

    number: int
    place_ratio: float
    """Where along the seam, 0 to 1."""
    lateral_mm: float
    height_mm: float
    lean_deg: float
    roll_deg: float
    yaw_deg: float
    exposure_ms: float
    gain_db: float
    ambient_grey: float
    disturbances: tuple[Disturbance, ...]


def plate_of(config: DatasetConfig, frame: int) -> int:
    """Number of the plate that a frame shows."""
    return frame // config.frames_per_plate


def plan_plate(config: DatasetConfig, seed: int, number: int) -> PlatePlan:
    """The plate with this number."""
    rng = generator(seed, "dataset/plate", number)
    gap_mm = rng.uniform(*config.root_gap_mm)
    return PlatePlan(
        number=number,
        groove_angle_deg=rng.uniform(*config.groove_angle_deg),
        groove_depth_mm=rng.uniform(*config.groove_depth_mm),
        root_gap_mm=gap_mm if rng.random() < config.root_gap_ratio else 0.0,
        amplitude_mm=rng.uniform(*config.amplitude_mm),
        material=config.materials[rng.integers(len(config.materials))],
        texture=config.textures[rng.integers(len(config.textures))],
        tack_spots=int(rng.integers(*config.tack_spots, endpoint=True)),
        texture_seed=int(rng.integers(2**31)),
    )


def plan_frame(config: DatasetConfig, sensor: SensorConfig, seed: int, number: int) -> FramePlan:
    """The frame with this number; raises BadInput if the ranges leave the torch no place above the plate."""
    rng = generator(seed, "dataset/frame", number)
    tip_from_crossing_torch = -1e-3 * np.array([sensor.look_ahead_mm, 0.0, sensor.below_tip_mm])
    for _ in range(_TRIES):
        plan = _draw(config, rng, number)
        tip_above_crossing_m = tilt(plan).apply(tip_from_crossing_torch)[2]
        if 1e-3 * plan.height_mm + tip_above_crossing_m > _TORCH_CLEARANCE_M:
            return plan
    raise BadInput(
        f"dataset.height_mm, dataset.lean_deg: the torch would stand in the plate in {_TRIES} of {_TRIES} tries, "
        "expected a larger height or a smaller lean"
    )


def tilt(plan: FramePlan, heading_rad: float = 0.0) -> Rotation:
    """R_base_torch of a frame whose direction of travel is `heading_rad`, before its yaw."""
    heading_rad = heading_rad + np.radians(plan.yaw_deg)
    # As the torch points down, leaning forwards turns about its right, and leaning to the right about backwards.
    lean, roll = np.radians([plan.lean_deg, plan.roll_deg])
    size, towards = np.hypot(lean, roll), np.arctan2(-lean, -roll)
    return torch_rotation(heading_rad, size, heading_rad + towards)


def _draw(config: DatasetConfig, rng: np.random.Generator, number: int) -> FramePlan:
    return FramePlan(
        number=number,
        place_ratio=rng.uniform(),
        lateral_mm=rng.uniform(*config.lateral_mm),
        height_mm=rng.uniform(*config.height_mm),
        lean_deg=rng.uniform(*config.lean_deg),
        roll_deg=rng.uniform(*config.roll_deg),
        yaw_deg=rng.uniform(*config.yaw_deg),
        exposure_ms=_log_uniform(config.exposure_ms, rng),
        gain_db=rng.uniform(*config.gain_db),
        ambient_grey=_log_uniform(config.ambient_grey, rng),
        disturbances=_disturbances(config, rng),
    )


def _log_uniform(ends: tuple[float, float], rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(*np.log(ends))))


def _disturbances(config: DatasetConfig, rng: np.random.Generator) -> tuple[Disturbance, ...]:
    """Each kind by its own chance; every kind takes its numbers whether it happens or not."""
    shares: dict[DisturbanceKind, float] = {
        "arc": config.arc_ratio,
        "spatter": config.spatter_ratio,
        "fume": config.fume_ratio,
        "stripe-lost": config.stripe_lost_ratio,
        "sensor-knocked": config.sensor_knocked_ratio,
        "stuck-exposure": config.stuck_exposure_ratio,
    }
    ends = config.disturbance_strength
    drawn = [(kind, share, rng.random(), _log_uniform(ends, rng)) for kind, share in shares.items()]
    return tuple(Disturbance(kind=kind, strength=strength) for kind, share, chance, strength in drawn if chance < share)

"""What the joint estimate is given: sights, touches, known distances, and what is believed beforehand.

Everything is in terms of joint readings, for the arm's own errors are among the unknowns.
"""

from dataclasses import dataclass, field, fields
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.arm import NominalArm
from weldcell.cell.errors import BadInput

Group = Literal["tip", "offsets", "twists", "zeros", "compliances", "sensor"]
"""Unknowns that can be switched off; camera and targets are always estimated."""
ALL_GROUPS: frozenset[Group] = frozenset(get_args(Group))
ARM_GROUPS: frozenset[Group] = frozenset({"offsets", "twists", "zeros", "compliances"})
SENSOR_SIZE = 6

_NEAREST_SHARE = 0.02  # of the radius: a section's height over the sphere's centre, for derivatives


@dataclass(frozen=True, kw_only=True, eq=False)
class PointSights:
    """Targets whose place in the camera was measured."""

    joints_rad: Float[np.ndarray, "n k"]
    """Joint readings at each sight."""
    centres_camera: Float[np.ndarray, "n 3"]
    """The target (m)."""
    covariances_camera: Float[np.ndarray, "n 3 3"]
    """Of the target (m^2): the sensor's own noise."""
    targets: Int[np.ndarray, "n"]
    """Which target each sight shows."""
    by_sensor: Float[np.ndarray, "n 3 6"] | None = None
    """How the measured place would move if the sensor's parameters were larger (see `sensor_errors`)."""

    def __post_init__(self) -> None:
        _check_rows("point sights", self, len(self.joints_rad))

    @property
    def observed(self) -> Float[np.ndarray, "n 3"]:
        """What is compared with `predicted`."""
        return self.centres_camera

    @property
    def covariances(self) -> Float[np.ndarray, "n 3 3"]:
        """Of `observed`."""
        return self.covariances_camera

    def predicted(
        self, targets_camera: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
        """What would be observed of targets there, with derivatives."""
        return targets_camera, np.broadcast_to(np.eye(3), (len(targets_camera), 3, 3))

    def lifted(self) -> Float[np.ndarray, "n 3"]:
        """The targets in the camera as each sight alone shows them (m)."""
        return self.centres_camera


@dataclass(frozen=True, kw_only=True, eq=False)
class SphereSights:
    """Sections of spheres with the light plane, as circles: the sphere's centre follows, but not linearly.

    A centre at (x, y, z) of the laser frame shows the circle (x, z, sqrt(R^2 - y^2)).
    """

    joints_rad: Float[np.ndarray, "n k"]
    """Joint readings at each sight."""
    circles_laser: Float[np.ndarray, "n 3"]
    """x and z of the circle's centre in the laser frame, and its radius (m)."""
    covariances_laser: Float[np.ndarray, "n 3 3"]
    """Of the circles (m^2): the sensor's own noise."""
    targets: Int[np.ndarray, "n"]
    """Which sphere each sight shows."""
    radii_m: Float[np.ndarray, "n"]
    """Radius of the sphere that each sight shows."""
    sides: Int[np.ndarray, "n"]
    """+1 where the sphere's centre lies beyond the plane along its normal, -1 on the camera's side."""
    T_camera_laser: RigidTransform
    """The believed light plane."""
    by_sensor: Float[np.ndarray, "n 3 6"] | None = None
    """How the measured circle, less the predicted one, would move if the sensor's parameters were larger."""

    def __post_init__(self) -> None:
        _check_rows("sphere sights", self, len(self.joints_rad))
        if not np.isin(self.sides, (-1, 1)).all() or not np.all(self.radii_m > 0):
            raise BadInput("sphere sights: expected sides of +1 or -1 and radii above 0")

    @property
    def observed(self) -> Float[np.ndarray, "n 3"]:
        """What is compared with `predicted`."""
        return self.circles_laser

    @property
    def covariances(self) -> Float[np.ndarray, "n 3 3"]:
        """Of `observed`."""
        return self.covariances_laser

    def predicted(
        self, targets_camera: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
        """What would be observed of spheres there, with derivatives."""
        R_laser_camera = self.T_camera_laser.rotation.as_matrix().T
        targets_laser = (targets_camera - self.T_camera_laser.translation) @ R_laser_camera.T
        x, y, z = targets_laser.T
        radii_m = np.sqrt(np.maximum(self.radii_m**2 - y**2, (_NEAREST_SHARE * self.radii_m) ** 2))
        by_targets = np.zeros((len(y), 3, 3))
        by_targets[:, 0, 0] = by_targets[:, 1, 2] = 1.0
        by_targets[:, 2, 1] = -y / radii_m
        return np.column_stack([x, z, radii_m]), by_targets @ R_laser_camera

    def lifted(self) -> Float[np.ndarray, "n 3"]:
        """The spheres' centres in the camera as each sight alone shows them (m)."""
        x, z, radii_m = self.circles_laser.T
        heights_m = np.sqrt(np.maximum(self.radii_m**2 - radii_m**2, 0.0))
        return self.T_camera_laser.apply(np.column_stack([x, -self.sides * heights_m, z]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Touches:
    """Touches of the torch tip on the spheres."""

    joints_rad: Float[np.ndarray, "m k"]
    """Joint readings at each touch."""
    targets: Int[np.ndarray, "m"]
    """Which sphere each touch met."""
    sums_m: Float[np.ndarray, "m"]
    """Radius of the sphere and of the tip together."""
    sigma_m: float = 1e-6
    """The touch switch, one sigma; the robot's own noise comes on top."""

    def __post_init__(self) -> None:
        _check_rows("touches", self, len(self.joints_rad))
        if not (np.isfinite(self.sigma_m) and self.sigma_m > 0):
            raise BadInput(f"touches: sigma_m is {self.sigma_m}, expected a length above 0")


@dataclass(frozen=True, kw_only=True)
class TargetDistance:
    """A known distance between two targets (Cao et al.: it fixes the scale)."""

    first: int
    second: int
    distance_m: float
    sigma_m: float = 2e-6
    """How well it is known, one sigma."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """How large errors are believed to be, one sigma; of the ordinary industrial arm and a calibrated sensor.

    They are where the search for the actual sizes begins; see `evidence`.
    """

    offset_m: float = 3e-4
    """Each coordinate of a link's origin in the one before."""
    twist_rad: float = float(np.radians(0.03))
    """A link's axes, about each of three."""
    zero_rad: float = float(np.radians(0.03))
    """A joint's zero."""
    compliance_rad_per_nm: float = 2e-6
    """Deflection of a main joint for each newton-metre that it holds; wrist joints: four times as much."""
    sensor_ratio: float = 1.0
    """Errors of the sensor over those of `SENSOR_SIGMA`."""
    joint_noise_rad: float = 1.5e-5
    """Of each joint at each new approach: the robot's repeatability."""
    sight_noise_m: float = 5e-6
    """Of each coordinate of a sight beyond its own covariance."""

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not (np.isfinite(value) and value > 0):
                raise BadInput(f"sizes: {each.name} is {value}, expected a number above 0")


MAIN_JOINTS = 3
WRIST_RATIO = 4.0
"""Wrist joints have small gears: their compliance over that of the main joints."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointProblem:
    """Sights and touches of fixed targets, for one estimate of everything."""

    arm: NominalArm
    sights: PointSights | SphereSights
    touches: Touches | None = None
    distances: tuple[TargetDistance, ...] = ()
    tip_flange: Float[np.ndarray, "3"]
    """Nominal centre of the tip's rounding (m)."""
    tip_sigma_m: float = 5e-3
    """How far off it may be, one sigma an axis."""
    T_flange_camera: RigidTransform
    """Where to start: the first hand-eye solution."""
    estimate: frozenset[Group] = ALL_GROUPS
    """What is estimated besides camera and targets."""
    sizes: Sizes = field(default_factory=Sizes)
    """How large errors are believed to be."""
    adapt: bool = True
    """Find the sizes that make the data most likely (empirical Bayes), starting from `sizes`."""
    robust: bool = True
    """Leave sights and touches out that don't fit with the others."""

    def __post_init__(self) -> None:
        if unknown := self.estimate - ALL_GROUPS:
            raise BadInput(f"joint estimate: cannot estimate {sorted(unknown)}; there are {sorted(ALL_GROUPS)}")
        if np.shape(self.tip_flange) != (3,) or not np.all(np.isfinite(self.tip_flange)):
            raise BadInput(f"joint estimate: tip_flange is {self.tip_flange}, expected 3 finite numbers")
        for name, rows in (("sights", self.sights), ("touches", self.touches)):
            if rows is not None and rows.joints_rad.shape[1] != self.arm.joints:
                raise BadInput(
                    f"joint estimate: {name} have {rows.joints_rad.shape[1]} joints, the arm {self.arm.joints}"
                )
        seen = set(np.unique(self.sights.targets).tolist())
        if seen != set(range(len(seen))):
            raise BadInput(f"joint estimate: sights show targets {sorted(seen)}, expected 0, 1, ... without a gap")
        used = set() if self.touches is None else set(np.unique(self.touches.targets).tolist())
        used |= {index for each in self.distances for index in (each.first, each.second)}
        if used - seen:
            raise BadInput(f"joint estimate: targets {sorted(used - seen)} are touched or measured, but never seen")

    @property
    def targets(self) -> int:
        """How many targets there are."""
        return int(self.sights.targets.max()) + 1


def _check_rows(what: str, rows: PointSights | SphereSights | Touches, count: int) -> None:
    """Raises BadInput unless all arrays are finite and as many as there are joint readings."""
    if not count:
        raise BadInput(f"{what}: expected at least one")
    for each in fields(rows):
        value = getattr(rows, each.name)
        if not isinstance(value, np.ndarray):
            continue
        if len(value) != count:
            raise BadInput(f"{what}: {len(value)} {each.name} for {count} joint readings")
        if not np.isfinite(value).all():
            raise BadInput(f"{what}: expected finite {each.name}, found NaN or infinity")

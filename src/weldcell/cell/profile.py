"""What the sensor's picture turns into: stripe, profile and the features of a joint."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, UInt8, UInt16
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry


@dataclass(frozen=True, kw_only=True)
class Shot:
    """One picture, with the pose that the robot's controller reported for it."""

    image: UInt8[np.ndarray, "height width"] | UInt16[np.ndarray, "height width"] | None
    """Levels: 8 bits, or 12 bits as 16-bit numbers; None where a profile was measured without a picture."""
    T_base_flange: RigidTransform
    """Flange in the robot base, by the controller's nominal model."""
    time_s: float
    """Time of the exposure."""


@dataclass(frozen=True, kw_only=True)
class Stripe:
    """Centre of the laser stripe: one entry for each picture column where it was found, or for each row.

    A stripe along the picture's rows has whole `u_px` and sub-pixel `v_px`, one along its columns the reverse. Pixel
    (0, 0) is the centre of the top-left pixel.
    """

    u_px: Float[np.ndarray, "n"]
    """Column of the stripe's centre."""
    v_px: Float[np.ndarray, "n"]
    """Row of the stripe's centre."""
    sigma_px: Float[np.ndarray, "n"]
    """Predicted standard deviation of the sub-pixel one of the two: across the rows or columns it runs along."""
    amplitude_grey: Float[np.ndarray, "n"] | None = None
    """Height of the stripe above the background, grey levels; it fades at an edge. None where nobody measured it."""

    def __post_init__(self) -> None:
        if not self.u_px.shape == self.v_px.shape == self.sigma_px.shape:
            raise BadGeometry("stripe: u_px, v_px and sigma_px must have the same length")
        if self.amplitude_grey is not None and self.amplitude_grey.shape != self.u_px.shape:
            raise BadGeometry("stripe: amplitude_grey must have the length of u_px")


@dataclass(frozen=True, kw_only=True)
class Profile:
    """Points of one light section, in the camera frame."""

    points_camera: Float[np.ndarray, "n 3"]
    """Metres; NaN where not valid."""
    sigma_m: Float[np.ndarray, "n"]
    """Standard deviation of each point along the light (depth)."""
    valid: Bool[np.ndarray, "n"]
    """False where the point is out of the sensor's range."""
    reason: str = ""
    """Why the profile holds no valid point, if it holds none."""
    amplitude_grey: Float[np.ndarray, "n"] | None = None
    """Height of the stripe at each point, grey levels; None where nobody measured it."""

    def __post_init__(self) -> None:
        if not len(self.points_camera) == len(self.sigma_m) == len(self.valid):
            raise BadGeometry("profile: points_camera, sigma_m and valid must have the same length")
        if self.amplitude_grey is not None and len(self.amplitude_grey) != len(self.valid):
            raise BadGeometry("profile: amplitude_grey must have the length of valid")


@dataclass(frozen=True, kw_only=True)
class JointFeatures:
    """The named points of a joint in one profile, e.g. left edge, root and right edge of a V-groove."""

    names: tuple[str, ...]
    points_camera: Float[np.ndarray, "k 3"]
    """One row a name, metres; NaN where not valid."""
    sigma_m: Float[np.ndarray, "k"]
    """Predicted standard deviation of each feature within the light plane."""
    valid: bool
    reason: str = ""
    """Why the joint was not found, if it was not."""
    measures: Mapping[str, float] = field(default_factory=dict)
    """Derived values with units in their names, such as gap_m, mismatch_m or groove_angle_rad."""
    confidence: Float[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0))
    """Probability for each feature that it is the right one and within 0.15 mm; empty where nobody judged."""

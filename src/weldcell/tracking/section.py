"""A profile seen in its own plane (x across, z along the light), and straight lines fitted in it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import Profile
from weldcell.tracking.triangulation import noise_slopes

_TUKEY = 4.685  # 95 % efficiency with normal noise (Huber and Ronchetti, Robust Statistics, 2009)
_EFFICIENCY = 0.95
_MAD_TO_SIGMA = 1.4826
_LEAST_SCALE = 0.3  # of the predicted sigma: keeps noise-free points from all being outliers of each other
_START_GATE_M = 3e-4  # how far from a start line a point of the line may lie
_LEAST_SIGMA_M = 1e-9  # a sigma of zero would be an infinite weight


@dataclass(frozen=True, kw_only=True)
class Section:
    """The valid points of a profile in the laser frame, sorted by x."""

    x_m: Float[np.ndarray, "n"]
    """Across the light, along the camera's x."""
    z_m: Float[np.ndarray, "n"]
    """Along the light: larger is deeper."""
    sigma_m: Float[np.ndarray, "n"]
    """Standard deviation along z."""
    noise_slope: Float[np.ndarray, "n"]
    """dx/dz of a point's noise: a stripe centre moves along the picture's column, not quite along z."""

    def only(self, keep: Bool[np.ndarray, "n"]) -> "Section":
        """The section of these points."""
        return Section(
            x_m=self.x_m[keep],
            z_m=self.z_m[keep],
            sigma_m=self.sigma_m[keep],
            noise_slope=self.noise_slope[keep],
        )


def section_of(profile: Profile, plane: LaserPlane) -> Section:
    """The profile's valid points in the frame of the light plane."""
    points_laser = plane.T_camera_laser.inv().apply(profile.points_camera[profile.valid])
    order = np.argsort(points_laser[:, 0], kind="stable")
    points_laser = points_laser[order]
    return Section(
        x_m=points_laser[:, 0],
        z_m=points_laser[:, 2],
        sigma_m=np.maximum(profile.sigma_m[profile.valid][order], _LEAST_SIGMA_M),
        noise_slope=noise_slopes(points_laser, plane) if len(order) else np.zeros(0),
    )


@dataclass(frozen=True, kw_only=True)
class Line:
    """The line z = height_m + slope (x - origin_m) in the laser frame."""

    origin_m: float
    height_m: float
    slope: float
    covariance: Float[np.ndarray, "2 2"]
    """Of (height_m, slope)."""
    count: int
    """Points that take part in it."""
    inlier_share: float
    """Of the points offered."""

    def z_at(self, x_m: float) -> float:
        """z of the line (m)."""
        return self.height_m + self.slope * (x_m - self.origin_m)

    def variance_at(self, x_m: float) -> float:
        """Variance of `z_at` (m^2)."""
        lever = np.array([1.0, x_m - self.origin_m])
        return float(lever @ self.covariance @ lever)

    @property
    def angle_rad(self) -> float:
        """Inclination against x, positive where the line gets deeper with x."""
        return float(np.arctan(self.slope))


def fit_line(section: Section, *, start: Line | None = None, rounds: int = 6) -> Line | None:
    """The robust line through a section's points (Tukey's biweight); None if they do not determine one.

    The noise lies along a direction that is known for every point, so the line is a regression along it: the
    residual in z has sigma |1 - slope dx/dz| sigma_z. Total least squares, which takes the noise as equal in all
    directions, would turn steep lines.
    """
    x, z = section.x_m, section.z_m
    if len(x) < 3:
        return None
    slope, intercept = (start.slope, start.z_at(0.0)) if start else _plain_line(x, z)
    first_gate_m = _START_GATE_M if start else np.inf
    scale = 1.0
    for turn in range(rounds):
        sigma = section.sigma_m * np.maximum(np.abs(1 - slope * section.noise_slope), 0.05)
        residual = np.abs(z - intercept - slope * x) / sigma
        # Strays must not widen the scale: from a start, only what lies near it counts.
        near = residual <= (3 * scale if turn else np.hypot(1, slope) * first_gate_m / sigma)
        scale = max(_MAD_TO_SIGMA * float(np.median(residual[near])) if near.any() else scale, _LEAST_SCALE)
        robust = np.maximum(1 - (residual / (_TUKEY * scale)) ** 2, 0) ** 2
        weight = robust / sigma**2
        total = float(weight.sum())
        if not total > 0:
            return None
        origin = float(weight @ x / total)
        offset = x - origin
        spread = float(weight @ (offset * offset))
        if not spread > 0:
            return None
        slope = float(weight @ (offset * z) / spread)
        intercept = float(weight @ z / total) - slope * origin
    inflation = max(scale, 1.0) ** 2 / _EFFICIENCY  # never better than the stripe's own sigma claims
    covariance = inflation * np.diag([1 / total, 1 / spread])
    inliers = int((robust > 0).sum())
    return Line(
        origin_m=origin,
        height_m=intercept + slope * origin,
        slope=slope,
        covariance=covariance,
        count=inliers,
        inlier_share=inliers / len(x),
    )


def _plain_line(x: Float[np.ndarray, "n"], z: Float[np.ndarray, "n"]) -> tuple[float, float]:
    offset = x - x.mean()
    slope = float(offset @ z / max(float(offset @ offset), 1e-30))
    return slope, float(z.mean() - slope * x.mean())


@dataclass(frozen=True, kw_only=True)
class Corner:
    """Where two lines cross, in the laser frame."""

    x_m: float
    z_m: float
    sigma_m: float
    """Root mean square distance of the corner from where it should be."""


def crossing(first: Line, second: Line) -> Corner | None:
    """Where the lines cross, with the variance that both pass on; None if they are parallel.

    dx = (dz2 - dz1) / (b1 - b2) and dz = (b1 dz2 - b2 dz1) / (b1 - b2), with dz1 and dz2 the lines' own errors there.
    """
    opening = first.slope - second.slope
    if abs(opening) < 1e-6:
        return None
    x_m = float((second.z_at(0.0) - first.z_at(0.0)) / opening)
    first_variance, second_variance = first.variance_at(x_m), second.variance_at(x_m)
    variance = (1 + second.slope**2) * first_variance + (1 + first.slope**2) * second_variance
    return Corner(x_m=x_m, z_m=float(first.z_at(x_m)), sigma_m=float(np.sqrt(variance) / abs(opening)))

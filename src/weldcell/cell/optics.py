"""The camera (OpenCV's model: pinhole, 12 distortion coefficients, tilted sensor) and the light plane."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry
from weldcell.cell.frames import axes_rotation, rigid_from

_NEWTON_STEPS = 20
_NEWTON_TOLERANCE = 1e-14  # normalised image units: 1e-10 px at a focal length of 1e4 px
_CONVERGED = 1e-13  # 1e-9 px: where rounding stops Newton's method short of its tolerance
_Values = Float[np.ndarray, "*batch"]
_Slopes = tuple[tuple[_Values, _Values], tuple[_Values, _Values]]


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraModel:
    """Pinhole camera with OpenCV's distortion; x right, y down, z forward; pixel (0, 0) is a pixel's centre."""

    width_px: int
    height_px: int
    focal_px: Float[np.ndarray, "2"]
    """Focal length along u and v."""
    principal_px: Float[np.ndarray, "2"]
    """Principal point (u, v)."""
    distortion: Float[np.ndarray, "14"] = field(default_factory=lambda: np.zeros(14))
    """k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y, in OpenCV's order (tau in rad)."""

    def __post_init__(self) -> None:
        for name, size in (("focal_px", 2), ("principal_px", 2), ("distortion", 14)):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (size,) or not np.all(np.isfinite(value)):
                raise BadGeometry(f"camera: {name} must be {size} finite numbers, found {value.tolist()}")
            object.__setattr__(self, name, value)
        if self.width_px < 1 or self.height_px < 1:
            raise BadGeometry(f"camera: picture of {self.width_px}x{self.height_px} pixels has no pixel")
        if np.any(self.focal_px <= 10):
            raise BadGeometry(
                f"camera: focal_px is {self.focal_px.tolist()}, expected more than 10 pixels (not metres or mm)"
            )

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """OpenCV's camera matrix."""
        (fx, fy), (cx, cy) = self.focal_px, self.principal_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def project(self, points_camera: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 2"]:
        """Pixels of points (m); NaN for points not in front of the camera."""
        points_camera = np.asarray(points_camera, dtype=float)
        depth = points_camera[..., 2:]
        with np.errstate(divide="ignore", invalid="ignore"):
            normalised = np.where(depth > 0, points_camera[..., :2] / depth, np.nan)
        return self.distort(normalised) * self.focal_px + self.principal_px

    def unproject(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 3"]:
        """Rays (x, y, 1) of pixels; NaN where the distortion cannot be inverted."""
        return self._unprojected(pixels)[0]

    def unproject_with_slopes(
        self, pixels: Float[np.ndarray, "*batch 2"]
    ) -> tuple[Float[np.ndarray, "*batch 3"], Float[np.ndarray, "*batch 2 2"]]:
        """Rays as from `unproject`, and `distortion_jacobian` there (without meaning where a ray is NaN)."""
        rays, slopes = self._unprojected(pixels)
        return rays, _matrices(slopes)

    def in_picture(self, pixels: Float[np.ndarray, "*batch 2"]) -> Bool[np.ndarray, "*batch"]:
        """Whether pixels lie within the picture."""
        u, v = pixels[..., 0], pixels[..., 1]
        return (u >= -0.5) & (v >= -0.5) & (u < self.width_px - 0.5) & (v < self.height_px - 0.5)

    def distort(self, normalised: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """Distorted normalised image coordinates (OpenCV's calib3d documentation, rational and tilted model)."""
        x, y = normalised[..., 0], normalised[..., 1]
        r2 = x * x + y * y
        bent = np.stack(self._bent(x, y, r2, self._radial(r2)), axis=-1)
        return _mapped(bent, self._tilt) if self._is_tilted else bent

    def undistort(self, distorted: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2"]:
        """The inverse of `distort` by Newton's method; NaN where it does not converge, or beyond the lens's fold.

        There the distortion turns its orientation: a second ray hits the same pixel.
        """
        return self._undistorted(distorted)[0]

    def distortion_jacobian(self, normalised: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 2 2"]:
        """Derivatives of `distort`: rows are the distorted x and y, columns the undistorted ones."""
        return _matrices(self._distorted(normalised[..., 0], normalised[..., 1])[1])

    def picture_depth(self, pixels: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch"]:
        """Distance along the camera's axis from the lens to a pixel, in principal distances: 1 without tilt.

        OpenCV's tilt stands for a picture plane through (0, 0, 1) whose axes are the first two rows of the rotation
        R = R_y(tau_y) R_x(tau_x) (see `_tilt`): a ray d meets it at d R_33 / (R d)_3, and (R d R_33 / (R d)_3 -
        R e_z)_xy are OpenCV's tilted coordinates x, y. So a pixel lies at x R_1 + y R_2 + e_z, at the depth
        1 + x R_13 + y R_23. (The picture is turned to the front of the lens, as usual.)
        """
        right, down = self._tilt_rotation[:2, 2] / self.focal_px
        offset = np.asarray(pixels, dtype=float) - self.principal_px
        return np.asarray(1 + offset[..., 0] * right + offset[..., 1] * down)

    @cached_property
    def _tilt_rotation(self) -> Float[np.ndarray, "3 3"]:
        """Rows are the axes of the tilted picture plane in the camera frame."""
        tau_x, tau_y = self.distortion[12:]
        cos_x, sin_x, cos_y, sin_y = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
        about_x = np.array([[1, 0, 0], [0, cos_x, sin_x], [0, -sin_x, cos_x]])
        about_y = np.array([[cos_y, 0, -sin_y], [0, 1, 0], [sin_y, 0, cos_y]])
        return np.asarray(about_y @ about_x)

    @cached_property
    def _tilt(self) -> Float[np.ndarray, "3 3"]:
        """OpenCV's projective tilt matrix of (tau_x, tau_y)."""
        rotation = self._tilt_rotation
        onto_sensor = np.array([[rotation[2, 2], 0, -rotation[0, 2]], [0, rotation[2, 2], -rotation[1, 2]], [0, 0, 1]])
        return onto_sensor @ rotation

    @cached_property
    def _is_tilted(self) -> bool:
        return bool(self.distortion[12:].any())

    @cached_property
    def _has_prism(self) -> bool:
        return bool(self.distortion[8:12].any())

    @cached_property
    def _radial_series(self) -> tuple[tuple[float, ...], ...]:
        """The radial factor's numerator and denominator as series of r^2, and their derivatives by it."""
        k1, k2, _, _, k3, k4, k5, k6 = self.distortion[:8].tolist()
        return (
            _trimmed(1.0, k1, k2, k3),
            _trimmed(1.0, k4, k5, k6),
            _trimmed(k1, 2 * k2, 3 * k3),
            _trimmed(k4, 2 * k5, 3 * k6),
        )

    def _unprojected(self, pixels: Float[np.ndarray, "*batch 2"]) -> tuple[Float[np.ndarray, "*batch 3"], _Slopes]:
        distorted = (np.asarray(pixels, dtype=float) - self.principal_px) / self.focal_px
        normalised, slopes = self._undistorted(distorted)
        rays = np.empty((*normalised.shape[:-1], 3))
        rays[..., :2] = normalised
        rays[..., 2] = np.where(np.isnan(normalised[..., 0]), np.nan, 1.0)
        return rays, slopes

    def _undistorted(self, distorted: Float[np.ndarray, "*batch 2"]) -> tuple[Float[np.ndarray, "*batch 2"], _Slopes]:
        """What `undistort` returns, and the derivatives of `distort` there."""
        target = np.array(distorted, dtype=float)
        if not self.distortion.any():
            one, none = (np.broadcast_to(slope, target.shape[:-1]) for slope in (1.0, 0.0))
            return target, ((one, none), (none, one))
        start = _mapped(target, np.linalg.inv(self._tilt)) if self._is_tilted else target
        (x, y), (target_x, target_y) = _coordinates(start), _coordinates(target)
        with np.errstate(divide="ignore", invalid="ignore"):
            for step in range(_NEWTON_STEPS + 1):
                (at_x, at_y), slopes = self._distorted(x, y)
                (xx, xy), (yx, yy) = slopes
                off_x, off_y, turn = at_x - target_x, at_y - target_y, xx * yy - xy * yx
                off = np.maximum(np.abs(off_x), np.abs(off_y))
                if step == _NEWTON_STEPS or not np.any(off > _NEWTON_TOLERANCE):
                    break
                x, y = x - (yy * off_x - xy * off_y) / turn, y - (xx * off_y - yx * off_x) / turn
            found = (off < _CONVERGED) & (turn > 0)
        return np.where(found[..., None], np.stack([x, y], axis=-1), np.nan), slopes

    def _distorted(self, x: _Values, y: _Values) -> tuple[tuple[_Values, _Values], _Slopes]:
        """x and y distorted, and their derivatives: of x by x and y, of y by x and y."""
        r2 = x * x + y * y
        radial = self._radial(r2)
        (bent_x, bent_y), slopes = self._bent(x, y, r2, radial), self._bent_slopes(x, y, r2, radial)
        if not self._is_tilted:
            return (bent_x, bent_y), slopes
        tilted = _mapped(np.stack([bent_x, bent_y], axis=-1), self._tilt)
        flat = np.linalg.inv(self._tilt)  # 1 / the tilt's divisor is linear in the tilted coordinates
        nearness = tilted @ flat[2, :2] + flat[2, 2]
        by_bent = (self._tilt[:2, :2] - tilted[..., None] * self._tilt[2, :2]) * nearness[..., None, None]
        (xx, xy), (yx, yy) = np.moveaxis(by_bent @ _matrices(slopes), (-2, -1), (0, 1))
        return (tilted[..., 0], tilted[..., 1]), ((xx, xy), (yx, yy))

    def _radial(self, r2: _Values) -> _Values:
        """What the radial distortion stretches by."""
        above, below, _, _ = self._radial_series
        return np.asarray(_series(above, r2) / _series(below, r2))

    def _bent(self, x: _Values, y: _Values, r2: _Values, radial: _Values) -> tuple[_Values, _Values]:
        """x and y distorted, without the tilt."""
        p1, p2 = self.distortion[2:4].tolist()
        bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        if not self._has_prism:
            return bent_x, bent_y
        s1, s2, s3, s4 = self.distortion[8:12].tolist()
        return bent_x + r2 * (s1 + r2 * s2), bent_y + r2 * (s3 + r2 * s4)

    def _bent_slopes(self, x: _Values, y: _Values, r2: _Values, radial: _Values) -> _Slopes:
        """Derivatives of `_bent`: of x by x and y, of y by x and y."""
        p1, p2 = self.distortion[2:4].tolist()
        _, below, above_slope, below_slope = self._radial_series
        by_r2 = (_series(above_slope, r2) - radial * _series(below_slope, r2)) / _series(below, r2)
        mixed = 2 * (x * y * by_r2 + p1 * x + p2 * y)
        xx = radial + 2 * x * x * by_r2 + 2 * p1 * y + 6 * p2 * x
        yy = radial + 2 * y * y * by_r2 + 6 * p1 * y + 2 * p2 * x
        if not self._has_prism:
            return (xx, mixed), (mixed, yy)
        s1, s2, s3, s4 = self.distortion[8:12].tolist()
        prism_x, prism_y = 2 * (s1 + 2 * r2 * s2), 2 * (s3 + 2 * r2 * s4)
        return (xx + prism_x * x, mixed + prism_x * y), (mixed + prism_y * x, yy + prism_y * y)


@dataclass(frozen=True, kw_only=True, eq=False)
class LaserPlane:
    """Light plane n.p = d in the camera frame."""

    normal_camera: Float[np.ndarray, "3"]
    """Unit normal, pointing away from the camera's centre."""
    offset_m: float
    """Distance of the plane from the camera's centre."""

    def __post_init__(self) -> None:
        normal = np.asarray(self.normal_camera, dtype=float)
        if normal.shape != (3,) or not np.all(np.isfinite(normal)) or not np.isfinite(self.offset_m):
            raise BadGeometry(f"laser plane: expected a normal of 3 finite numbers, found {normal.tolist()}")
        if abs(np.linalg.norm(normal) - 1) > 1e-9:
            raise BadGeometry(f"laser plane: expected a unit normal, found length {np.linalg.norm(normal):.6g}")
        if self.offset_m < 0:
            raise BadGeometry(f"laser plane: offset_m is {self.offset_m:.6g}, expected >= 0 (turn the normal round)")
        object.__setattr__(self, "normal_camera", normal)

    @cached_property
    def T_camera_laser(self) -> RigidTransform:
        """The light plane's own frame: z along the light (deeper is larger), y = -normal (to the camera), x = y x z.

        z is the direction of the plane that goes most along the camera's axis. The origin is the plane's nearest point
        to the camera's centre; points of the plane have y = 0. A plane across the axis has no such direction: refused.
        """
        axis = np.array([0.0, 0.0, 1.0])
        if np.linalg.norm(np.cross(self.normal_camera, axis)) < 1e-9:
            raise BadGeometry("laser plane: it lies across the camera's axis, where no depth can be seen")
        x = np.cross(axis, self.normal_camera)
        z = np.cross(x, -self.normal_camera)
        return rigid_from(axes_rotation(x, z), self.offset_m * self.normal_camera)

    def distance_m(self, points_camera: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch"]:
        """Signed distance of points from the plane, positive on the normal's side."""
        return np.asarray(points_camera @ self.normal_camera - self.offset_m)

    def intersect(self, rays: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3"]:
        """Where rays from the camera's centre meet the plane; NaN for rays that never do."""
        slope = rays @ self.normal_camera
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(slope > 0, self.offset_m / slope, np.nan)
        return rays * scale[..., None]


def _mapped(
    points: Float[np.ndarray, "*batch 2"], homography: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "*batch 2"]:
    """Points of the plane z = 1 after a homography."""
    moved = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(moved[..., :2] / moved[..., 2:])


def _coordinates(points: Float[np.ndarray, "*batch 2"]) -> tuple[_Values, _Values]:
    """x and y, each in one piece of memory."""
    return points[..., 0].copy(), points[..., 1].copy()


def _matrices(slopes: _Slopes) -> Float[np.ndarray, "*batch 2 2"]:
    (xx, xy), (yx, yy) = slopes
    matrices = np.empty((*np.shape(xx), 2, 2))
    matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 0], matrices[..., 1, 1] = xx, xy, yx, yy
    return matrices


def _trimmed(*coefficients: float) -> tuple[float, ...]:
    """The coefficients up to the last one that is not zero; the first one in any case."""
    return coefficients[: max((n for n, value in enumerate(coefficients, 1) if value), default=1)]


def _series(coefficients: tuple[float, ...], r2: _Values) -> _Values | float:
    """c_0 + c_1 r2 + c_2 r2^2 + ..., by Horner's rule."""
    value: _Values | float = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        value = coefficient + r2 * value
    return value

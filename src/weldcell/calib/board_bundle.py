"""Camera, board poses and light plane together, from corners and stripe points in pixels (a bundle adjustment).

Corners: the camera model's projection of the board's points. Stripe points: a pixel's ray meets the board's plane at a
point that should lie in the light plane; its distance from it, over the distance that one pixel across the stripe
makes, is the residual in pixels (Sampson's approximation of the distance between pixel and stripe).

Each board's pose concerns only its own pictures, so that one difference step serves all boards at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.calib.least_squares import Fit, fit
from weldcell.cell.frames import rigid_from
from weldcell.cell.optics import CameraModel, LaserPlane

INTRINSICS = (
    "fx",
    "fy",
    "cx",
    "cy",
    "k1",
    "k2",
    "p1",
    "p2",
    "k3",
    "k4",
    "k5",
    "k6",
    "s1",
    "s2",
    "s3",
    "s4",
    "tau_x",
    "tau_y",
)
"""Names of the camera's parameters in the order of their values: OpenCV's matrix, then its distortion."""

_POSE = 6
_PLANE = 3
_POSE_STEPS = 6
_STEP = 1e-6  # of a parameter's unit, for differences
_PIXEL_STEP = 0.5  # px, for the direction across the stripe


@dataclass(frozen=True, kw_only=True, eq=False)
class Corners:
    """Board points seen in pictures."""

    points_board: Float[np.ndarray, "n 3"]
    """Where each is on the board (m)."""
    pixels: Float[np.ndarray, "n 2"]
    """Where it was found."""
    picture: Int[np.ndarray, "n"]
    """In which picture, counted from 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StripePoints:
    """Stripe centres that lie on the boards."""

    pixels: Float[np.ndarray, "n 2"]
    picture: Int[np.ndarray, "n"]
    sigma_px: Float[np.ndarray, "n"]
    """Standard deviation across the stripe."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Arrangement:
    """What the adjustment estimates."""

    camera: CameraModel
    T_camera_board: RigidTransform
    """One a picture."""
    plane: LaserPlane | None
    """None where no stripe is seen."""


_State = tuple[CameraModel, LaserPlane | None, Float[np.ndarray, "k 3 3"], Float[np.ndarray, "k 3"]]
"""Camera, plane, and the boards' rotations and origins in the camera frame."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """The arrangement that explains corners and stripe best."""

    arrangement: Arrangement
    fit: Fit
    """Parameters: the free intrinsics (px and plain numbers), then the plane (two tilts in rad, offset in m), then six
    a board (turn in rad, then shift in m, in the camera frame)."""
    free: tuple[str, ...]
    """Names of the free intrinsics."""
    corner_residuals_px: Float[np.ndarray, "n 2"]
    """Found minus expected."""
    stripe_residuals_px: Float[np.ndarray, "m"]
    """Across the stripe."""


def adjust(
    start: Arrangement,
    corners: Corners,
    stripe: StripePoints | None,
    *,
    free: Sequence[str],
    corner_sigma_px: float,
    square_pixels: bool = True,
    robust: bool = True,
) -> Adjusted:
    """The best arrangement near `start`; `free` names the intrinsics to estimate (none: they are known).

    With square pixels fy follows fx.
    """
    problem = _Bundle(start, corners, stripe, tuple(free), corner_sigma_px, square_pixels)
    found = fit(problem.model, np.zeros(problem.size), robust=robust)
    arrangement = problem.arrangement(found.parameters)
    corner_px, stripe_px = problem.residuals_px(found.parameters)
    return Adjusted(
        arrangement=arrangement,
        fit=found,
        free=tuple(free),
        corner_residuals_px=corner_px,
        stripe_residuals_px=stripe_px,
    )


def stripe_points_camera(
    pixels: Float[np.ndarray, "n 2"], picture: Int[np.ndarray, "n"], camera: CameraModel, T_camera_board: RigidTransform
) -> Float[np.ndarray, "n 3"]:
    """Where the rays of pixels meet the board of their picture (m); NaN where they never do."""
    T = T_camera_board.as_matrix()
    return _on_board(camera.unproject(pixels), picture, T[:, :3, 2], T[:, :3, 3])


def with_intrinsics(camera: CameraModel, names: Sequence[str], values: Float[np.ndarray, "p"]) -> CameraModel:
    """The camera with some intrinsics replaced."""
    all_values = intrinsics_of(camera)
    all_values[[INTRINSICS.index(name) for name in names]] = values
    return replace(camera, focal_px=all_values[:2], principal_px=all_values[2:4], distortion=all_values[4:])


def intrinsics_of(camera: CameraModel) -> Float[np.ndarray, "18"]:
    """All intrinsics, in the order of INTRINSICS."""
    return np.concatenate([camera.focal_px, camera.principal_px, camera.distortion])


def plane_axes(plane: LaserPlane) -> Float[np.ndarray, "2 3"]:
    """Two unit vectors in the light plane about which its tilts are counted: the laser frame's x and z."""
    return plane.T_camera_laser.rotation.as_matrix()[:, [0, 2]].T


def tilted(plane: LaserPlane, tilts_rad: Float[np.ndarray, "2"], offset_m: float) -> LaserPlane:
    """The plane whose normal moved by two small angles along `plane_axes`, and its offset by `offset_m`."""
    normal = plane.normal_camera + tilts_rad @ plane_axes(plane)
    return LaserPlane(normal_camera=normal / np.linalg.norm(normal), offset_m=abs(plane.offset_m + offset_m))


def across(pixels: Float[np.ndarray, "n 2"], camera: CameraModel, plane: LaserPlane) -> Float[np.ndarray, "2"]:
    """Unit vector of the picture's axis that crosses the stripe: the one that depth moves it along."""
    middle = plane.intersect(camera.unproject(pixels.mean(axis=0)))
    near, far = camera.project(middle + np.outer([-1e-3, 1e-3], plane_axes(plane)[1]))
    return np.eye(2)[int(np.argmax(np.abs(far - near)))]


def refined_poses(camera: CameraModel, T_camera_board: RigidTransform, corners: Corners) -> RigidTransform:
    """T_camera_board of all pictures, least squares of the corners in pixels, by Gauss-Newton from a near start."""
    for _ in range(_POSE_STEPS):
        residuals, slopes = pose_slopes(camera, T_camera_board, corners)
        information, pull = np.zeros((len(T_camera_board), _POSE, _POSE)), np.zeros((len(T_camera_board), _POSE))
        np.add.at(information, corners.picture, np.einsum("nci,ncj->nij", slopes, slopes))
        np.add.at(pull, corners.picture, np.einsum("nci,nc->ni", slopes, residuals))
        moves = np.linalg.solve(information, pull[..., None])[..., 0]
        T_camera_board = rigid_from(
            Rotation.from_rotvec(moves[:, :3]) * T_camera_board.rotation, T_camera_board.translation + moves[:, 3:]
        )
    return T_camera_board


def pose_slopes(
    camera: CameraModel, T_camera_board: RigidTransform, corners: Corners
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 6"]]:
    """Corners found minus expected (px), and how the expected ones move with their board's turn (rad) and shift (m)."""
    own = T_camera_board.as_matrix()[corners.picture]
    arms = np.einsum("nij,nj->ni", own[:, :3, :3], corners.points_board)
    points = arms + own[:, :3, 3]
    by_point = np.stack(
        [(camera.project(points + step) - camera.project(points - step)) / (2 * _STEP) for step in _STEP * np.eye(3)],
        axis=-1,
    )
    turned = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)  # column j: unit vector j x arm
    return corners.pixels - camera.project(points), np.concatenate([by_point @ turned, by_point], axis=2)


class _Bundle:
    """Residuals and their derivatives about a start."""

    def __init__(
        self,
        start: Arrangement,
        corners: Corners,
        stripe: StripePoints | None,
        free: tuple[str, ...],
        corner_sigma_px: float,
        square_pixels: bool,
    ) -> None:
        self._start, self._corners, self._free, self._square = start, corners, free, square_pixels
        self._stripe = stripe if start.plane is not None else None
        self._corner_sigma_px = corner_sigma_px
        self._boards = len(start.T_camera_board)
        self._scales = _intrinsic_scales(start.camera, free)
        self._globals = len(free) + (_PLANE if self._stripe is not None else 0)
        self.size = self._globals + _POSE * self._boards
        pictures = corners.picture if self._stripe is None else np.concatenate([corners.picture, self._stripe.picture])
        self._picture = pictures
        self._rotations = start.T_camera_board.rotation.as_matrix()
        self._origins = start.T_camera_board.translation
        self._kept_rays: tuple[bytes, np.ndarray] = (b"", np.empty(0))
        if self._stripe is not None and start.plane is not None:
            self._across = across(self._stripe.pixels, start.camera, start.plane)

    def arrangement(self, parameters: Float[np.ndarray, "p"]) -> Arrangement:
        """What parameters, counted from the start, stand for."""
        camera, plane, rotations, origins = self._state(parameters)
        return Arrangement(
            camera=camera, T_camera_board=rigid_from(Rotation.from_matrix(rotations), origins), plane=plane
        )

    def _state(self, parameters: Float[np.ndarray, "p"]) -> _State:
        """The same as plain arrays: a rigid transform takes longer to build than the residuals take to compute."""
        start, count = self._start, len(self._free)
        values = intrinsics_of(start.camera)[[INTRINSICS.index(name) for name in self._free]] + parameters[:count]
        camera = with_intrinsics(start.camera, self._free, values)
        if self._square and "fx" in self._free:
            ratio = start.camera.focal_px[1] / start.camera.focal_px[0]
            camera = replace(camera, focal_px=camera.focal_px[0] * np.array([1.0, ratio]))
        plane = start.plane
        if self._stripe is not None and plane is not None:
            plane = tilted(plane, parameters[count : count + 2], float(parameters[count + 2]))
        moves = parameters[self._globals :].reshape(-1, _POSE)
        rotations = Rotation.from_rotvec(moves[:, :3]).as_matrix() @ self._rotations
        return camera, plane, rotations, self._origins + moves[:, 3:]

    def residuals_px(
        self, parameters: Float[np.ndarray, "p"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "m"]]:
        """Found minus expected corners, and stripe points' distances across the stripe."""
        return self._residuals_px(*self._state(parameters))

    def _residuals_px(
        self, camera: CameraModel, plane: LaserPlane | None, rotations: np.ndarray, origins: np.ndarray
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "m"]]:
        board = self._corners.picture
        points_camera = np.einsum("nij,nj->ni", rotations[board], self._corners.points_board) + origins[board]
        corner_px = self._corners.pixels - camera.project(points_camera)
        if self._stripe is None or plane is None:
            return corner_px, np.zeros(0)
        pixels, picture = self._stripe.pixels, self._stripe.picture
        shifted = np.stack([pixels, pixels - _PIXEL_STEP * self._across, pixels + _PIXEL_STEP * self._across])
        rays = self._rays(camera, shifted)
        here, before, after = (plane.distance_m(_on_board(ray, picture, rotations[:, :, 2], origins)) for ray in rays)
        return corner_px, here / (after - before) * (2 * _PIXEL_STEP)

    def _rays(self, camera: CameraModel, pixels: Float[np.ndarray, "3 m 2"]) -> Float[np.ndarray, "3 m 3"]:
        """The pixels' rays, kept as long as the intrinsics stay: most difference steps move boards only."""
        key = intrinsics_of(camera).tobytes()
        if self._kept_rays[0] != key:
            self._kept_rays = (key, camera.unproject(pixels))
        return self._kept_rays[1]

    def model(self, parameters: Float[np.ndarray, "p"]) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals, two components each (a stripe point has one, the other is 0), and derivatives."""
        here = self._whitened(parameters)
        jacobian = np.zeros((len(self._picture), 2, self.size))
        for k in range(self._globals):
            step = np.zeros(self.size)
            step[k] = _STEP * self._scales[k] if k < len(self._free) else _STEP
            jacobian[:, :, k] = (self._whitened(parameters + step) - here) / step[k]
        columns = self._globals + _POSE * self._picture
        for k in range(_POSE):
            step = np.zeros(self.size)
            step[self._globals + k :: _POSE] = _STEP
            jacobian[np.arange(len(columns)), :, columns + k] = (self._whitened(parameters + step) - here) / _STEP
        return here, jacobian

    def _whitened(self, parameters: Float[np.ndarray, "p"]) -> Float[np.ndarray, "n 2"]:
        corner_px, stripe_px = self._residuals_px(*self._state(parameters))
        rows = corner_px / self._corner_sigma_px
        if self._stripe is not None:
            single = np.column_stack([stripe_px / self._stripe.sigma_px, np.zeros(len(stripe_px))])
            rows = np.vstack([rows, single])
        return np.nan_to_num(rows, nan=1e6)  # a pixel that cannot be reached: far off, not absent


def _intrinsic_scales(camera: CameraModel, names: Sequence[str]) -> Float[np.ndarray, "p"]:
    """A natural size of each intrinsic, for difference steps: pixels for the matrix, plain numbers for the rest."""
    return np.array([float(camera.focal_px[0]) if name in ("fx", "fy", "cx", "cy") else 1.0 for name in names])


def _on_board(
    rays: Float[np.ndarray, "n 3"],
    picture: Int[np.ndarray, "n"],
    normals: Float[np.ndarray, "k 3"],
    origins: Float[np.ndarray, "k 3"],
) -> Float[np.ndarray, "n 3"]:
    offsets = np.einsum("ki,ki->k", normals, origins)
    slope = np.einsum("ni,ni->n", rays, normals[picture])
    with np.errstate(divide="ignore", invalid="ignore"):
        return rays * np.where(slope != 0, offsets[picture] / slope, np.nan)[:, None]


def outlying_pictures(
    residuals_px: Float[np.ndarray, "n"], picture: Int[np.ndarray, "n"], ratio: float
) -> Bool[np.ndarray, "k"]:
    """Pictures whose root mean square residual is more than `ratio` times the median picture's."""
    count = np.bincount(picture)
    rms = np.sqrt(np.bincount(picture, residuals_px**2) / np.maximum(count, 1))
    return rms > ratio * np.median(rms[count > 0])

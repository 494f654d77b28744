"""P1's calibration of the light plane: a board of parallel lines moved along the camera's axis.

The board faces the camera; its lines run along the direction in which depth moves the stripe. Each line cuts the light
plane in points that lie on one 3-D line, and all these 3-D lines are parallel: their images meet in the vanishing point
m of the plane's depth direction (P1, Eq. 4: cot(theta) = x_inf / f). The stripe on a board that faces the camera has
the plane's other direction e, the same in space as in the picture. The known distance of the lines gives the scale, and
with it the plane's offset (P1, Eq. 7).

That closed form starts a maximum likelihood fit of the very same arrangement in pixels (plane, board distances, place
of the first line), which weighs near and far boards rightly and gives the covariance.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.calib.board_bundle import plane_axes, tilted
from weldcell.calib.laser_plane import facing_away, plane_blocks
from weldcell.calib.least_squares import fit, without_others
from weldcell.calib.verdict import (
    Finding,
    Judged,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
)
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import CameraModel, LaserPlane

_PLANE = 3
_STEP = 1e-7
_DOUBTFUL_RMS_PX = 2.0


@dataclass(frozen=True, kw_only=True, eq=False)
class VanishingPointProblem:
    """Where the stripe crosses the board's lines."""

    camera: CameraModel
    pixels: Float[np.ndarray, "boards lines 2"]
    """Crossing of the stripe with each line in each picture; the lines in their order on the board."""
    spacing_m: float
    """Distance between neighbouring lines."""
    sigma_px: float = 0.1
    """Standard deviation of a crossing along each axis."""

    def __post_init__(self) -> None:
        pixels = np.asarray(self.pixels, dtype=float)
        if pixels.ndim != 3 or pixels.shape[2] != 2 or pixels.shape[0] < 2 or pixels.shape[1] < 2:
            raise BadInput(f"vanishing point: crossings of shape {pixels.shape}, expected 2 boards and 2 lines or more")
        if not np.all(np.isfinite(pixels)):
            raise BadInput("vanishing point: expected finite crossings")
        if not (np.isfinite(self.spacing_m) and self.spacing_m > 0 and self.sigma_px > 0):
            raise BadInput(f"vanishing point: spacing {self.spacing_m} m, sigma {self.sigma_px} px: expected above 0")


@dataclass(frozen=True, kw_only=True, eq=False)
class VanishingPointResult(Judged):
    """The light plane, and the vanishing point of its depth direction."""

    plane: LaserPlane
    closed_form: LaserPlane
    """P1's own answer, the start of the fit."""
    vanishing_px: Float[np.ndarray, "2"]
    """Undistorted pixel coordinates; far away where the light is nearly parallel to the picture."""
    covariance: Float[np.ndarray, "3 3"]
    """Of the normal's two tilts along the laser frame's x and z (rad) and the offset (m)."""
    residuals_px: Float[np.ndarray, "boards lines 2"]
    rms_px: float


def solve(problem: VanishingPointProblem) -> VanishingPointResult:
    """The light plane."""
    rays = problem.camera.unproject(problem.pixels)
    axis, sign = _lines_axis(rays)
    depth, across = depth_direction(rays), _across(rays)
    distances_m = problem.spacing_m / _spacings(rays, axis, sign)
    normal = np.cross(depth, across)
    closed = facing_away(normal, np.mean(distances_m[:, None] * rays.mean(axis=1), axis=0))
    start = _Arrangement(problem, closed, axis, sign)
    found = fit(start.model, start.first(distances_m, rays))
    plane = tilted(closed, found.parameters[:2], float(found.parameters[2]))
    residuals = found.residuals.reshape(problem.pixels.shape) * problem.sigma_px
    rms_px = float(np.sqrt(np.mean(np.sum(residuals**2, axis=2))))
    seen = observe(without_others(found.jacobian, _PLANE), plane_blocks(float(np.median(distances_m))))
    findings = [*weigh_convergence(found.converged, found.message), *weigh_condition(seen, "light plane")]
    if not rms_px <= _DOUBTFUL_RMS_PX:
        findings.append(
            Finding(
                verdict="doubtful", reason=f"crossings miss by {rms_px:.3g} px rms; does the board face the camera?"
            )
        )
    verdict, reasons = judge(findings)
    direction = plane_axes(plane)[1]
    return VanishingPointResult(
        plane=plane,
        closed_form=closed,
        vanishing_px=direction[:2] / direction[2] * problem.camera.focal_px + problem.camera.principal_px,
        covariance=found.covariance[:_PLANE, :_PLANE],
        residuals_px=residuals,
        rms_px=rms_px,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        verdict=verdict,
        reasons=reasons,
    )


def depth_direction(rays: Float[np.ndarray, "boards lines 3"]) -> Float[np.ndarray, "3"]:
    """Unit direction whose vanishing point the images of all lines share (P1, Eq. 4).

    The rays to one line's crossings lie in a plane through the camera's centre; the direction is common to all these
    planes, so it is perpendicular to their normals.
    """
    normals = np.array([np.linalg.svd(_unit(line), full_matrices=True)[2][2] for line in rays.transpose(1, 0, 2)])
    direction = np.linalg.svd(normals, full_matrices=True)[2][2]
    return np.copysign(1.0, direction[2]) * direction


def _across(rays: Float[np.ndarray, "boards lines 3"]) -> Float[np.ndarray, "3"]:
    """Unit direction of the stripe on a board that faces the camera: as in the picture, long chords counting more."""
    chords = rays[:, -1] - rays[:, 0]
    total = np.sum(chords, axis=0)
    return total / np.linalg.norm(total)


def _lines_axis(rays: Float[np.ndarray, "boards lines 3"]) -> tuple[int, float]:
    """Which image axis the lines are spaced along (0: x, 1: y), and the sign in which their order runs."""
    chord = np.sum(rays[:, -1] - rays[:, 0], axis=0)[:2]
    axis = int(np.argmax(np.abs(chord)))
    return axis, float(np.sign(chord[axis]))


def _spacings(rays: Float[np.ndarray, "boards lines 3"], axis: int, sign: float) -> Float[np.ndarray, "boards"]:
    """Spacing of the lines in each picture at a distance of 1, by least squares over all lines."""
    order = np.arange(rays.shape[1]) - (rays.shape[1] - 1) / 2
    return sign * (rays[:, :, axis] @ order) / np.sum(order**2)


class _Arrangement:
    """Crossings that a plane, board distances and the first line's place make."""

    def __init__(self, problem: VanishingPointProblem, plane: LaserPlane, axis: int, sign: float) -> None:
        self._problem, self._plane, self._axis = problem, plane, axis
        self._places_m = sign * problem.spacing_m * np.arange(problem.pixels.shape[1])

    def first(self, distances_m: Float[np.ndarray, "boards"], rays: Float[np.ndarray, "boards lines 3"]) -> np.ndarray:
        place_m = float(np.mean(distances_m * rays[:, 0, self._axis]))
        return np.concatenate([np.zeros(_PLANE), [place_m], distances_m])

    def model(self, parameters: Float[np.ndarray, "p"]) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals of all crossings and their derivatives; a board's distance concerns its own row only."""
        boards, lines, _ = self._problem.pixels.shape
        jacobian = np.zeros((boards, lines, 2, len(parameters)))
        for k in range(_PLANE + 1):
            step = np.zeros(len(parameters))
            step[k] = _STEP
            jacobian[..., k] = self._difference(parameters, step)
        every = np.zeros(len(parameters))
        every[_PLANE + 1 :] = _STEP
        own = self._difference(parameters, every)
        rows = np.arange(boards)
        jacobian[rows, :, :, _PLANE + 1 + rows] = own
        return self._whitened(parameters).reshape(-1, 2), jacobian.reshape(boards * lines, 2, -1)

    def _difference(self, parameters: np.ndarray, step: np.ndarray) -> Float[np.ndarray, "boards lines 2"]:
        return (self._whitened(parameters + step) - self._whitened(parameters - step)) / (2 * _STEP)

    def _whitened(self, parameters: Float[np.ndarray, "p"]) -> Float[np.ndarray, "boards lines 2"]:
        plane = tilted(self._plane, parameters[:2], float(parameters[2]))
        places, distances = parameters[_PLANE] + self._places_m, parameters[_PLANE + 1 :]
        points = np.empty((len(distances), len(places), 3))
        points[..., self._axis], points[..., 2] = places, distances[:, None]
        other = 1 - self._axis
        rest = plane.offset_m - points[..., self._axis] * plane.normal_camera[self._axis]
        points[..., other] = (rest - points[..., 2] * plane.normal_camera[2]) / plane.normal_camera[other]
        expected = self._problem.camera.project(points)
        return np.nan_to_num((self._problem.pixels - expected) / self._problem.sigma_px, nan=1e6)


def _unit(rays: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)

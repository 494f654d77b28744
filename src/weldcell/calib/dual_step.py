"""The light plane from a target of parallel levels with known steps between them, the camera known.

The light cuts the levels in parallel lines, whose images are straight pieces of the stripe; the step edges, at known
places across the levels, end them. In the target frame (z up from the lowest level, x across the step edges, y along
them)

- a stripe point on level j, found where its ray meets the light plane, has z = h_j;
- a piece's end at edge e has x = x_e as well.

Each target's pose has five degrees of freedom that matter (a shift along the edges changes nothing). One target already
overdetermines the plane; several, at different distances, make it precise. No board, and no pose from elsewhere.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from weldcell.calib.board_bundle import across, plane_axes, tilted
from weldcell.calib.laser_plane import plane_blocks
from weldcell.calib.least_squares import fit, without_others
from weldcell.calib.verdict import (
    Finding,
    Judged,
    judge,
    observe,
    weigh_condition,
    weigh_convergence,
    weigh_residual,
)
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import CameraModel, LaserPlane

DOUBTFUL_RMS_M = 0.2e-3
REFUSED_RMS_M = 2e-3
_PLANE, _POSE = 3, 5
_STEP = 1e-7
_LEANS_RAD = ((0.0, 0.0), (0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2))
_ROUGHLY = 1e-3  # relative: a start need not be better
_FEWEST_ENDS = 2  # of a picture: they place the target across its edges
_REWEIGHTED = 1  # the first fit's sensitivities belong to the plane as designed


@dataclass(frozen=True, kw_only=True, eq=False)
class StepTargets:
    """Stripe points on the levels of targets, and their ends at the edges."""

    pixels: Float[np.ndarray, "n 2"]
    picture: Int[np.ndarray, "n"]
    """In which picture, counted from 0; one target a picture."""
    height_m: Float[np.ndarray, "n"]
    """Height of the level that the point lies on."""
    edge_m: Float[np.ndarray, "n"]
    """Place x of the edge for the end of a piece; NaN for points within a level."""
    sigma_px: Float[np.ndarray, "n"]
    """Standard deviation across the stripe."""
    edge_sigma_px: float = 0.5
    """Standard deviation of a piece's end along the stripe."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DualStepProblem:
    """Step targets before a known camera, and a rough light plane to start from."""

    camera: CameraModel
    targets: StepTargets
    start: LaserPlane
    """The plane as designed; a few degrees and millimetres off do no harm."""

    def __post_init__(self) -> None:
        targets = self.targets
        levels = len(np.unique(targets.height_m))
        ends = np.bincount(targets.picture, np.isfinite(targets.edge_m))
        if levels < 2:
            raise BadInput(f"dual step: points on {levels} level, expected at least 2 levels")
        if ends.min() < _FEWEST_ENDS:
            raise BadInput(
                f"dual step: picture {int(ends.argmin())} (counted from 0) has {ends.min():.0f} ends at edges, "
                f"expected {_FEWEST_ENDS} or more"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class DualStepResult(Judged):
    """The light plane, and how well it is known."""

    plane: LaserPlane
    covariance: Float[np.ndarray, "3 3"]
    """Of the normal's two tilts along the laser frame's x and z (rad) and the offset (m)."""
    residuals_px: Float[np.ndarray, "n"]
    """Distance from the level across the stripe."""
    rms_m: float
    """Root mean square height of points above or below their levels."""


def solve(problem: DualStepProblem) -> DualStepResult:
    """The light plane that lets all targets have their steps."""
    arrangement = _Arrangement(problem)
    found = fit(arrangement.model, arrangement.first())
    for _ in range(_REWEIGHTED):
        arrangement.weigh(found.parameters)
        found = fit(arrangement.model, found.parameters)
    plane = tilted(problem.start, found.parameters[:2], float(found.parameters[2]))
    heights = arrangement.heights_m(found.parameters)
    distances_m = problem.start.intersect(problem.camera.unproject(problem.targets.pixels))[:, 2]
    seen = observe(without_others(found.jacobian, _PLANE), plane_blocks(float(np.median(distances_m))))
    rms_m = float(np.sqrt(np.mean(heights**2)))
    findings: list[Finding] = [
        *weigh_convergence(found.converged, found.message),
        *weigh_condition(seen, "light plane"),
        *weigh_residual(rms_m, "heights", doubtful_m=DOUBTFUL_RMS_M, refused_m=REFUSED_RMS_M),
    ]
    verdict, reasons = judge(findings)
    return DualStepResult(
        plane=plane,
        covariance=found.covariance[:_PLANE, :_PLANE],
        residuals_px=found.residuals[:, 0] * problem.targets.sigma_px,
        rms_m=rms_m,
        condition_number=seen.condition_number,
        observability=seen.weak_directions,
        verdict=verdict,
        reasons=reasons,
    )


class _Arrangement:
    """Heights and edge places that a plane and the targets' poses make of the pixels."""

    def __init__(self, problem: DualStepProblem) -> None:
        self._problem, targets = problem, problem.targets
        self._count = int(targets.picture.max()) + 1
        self._at_edge = np.isfinite(targets.edge_m)
        self._rays = problem.camera.unproject(targets.pixels)
        shift = across(targets.pixels, problem.camera, problem.start) / 2
        self._shifted = [problem.camera.unproject(targets.pixels + sign * shift) for sign in (-1, 1)]
        self._along = [problem.camera.unproject(targets.pixels + sign * shift[::-1]) for sign in (-1, 1)]
        self._turns = np.array([self._first_turn(k) for k in range(self._count)])
        self.weigh(self._upright())

    def first(self) -> Float[np.ndarray, "p"]:
        """The plane as given, and the poses that suit it best.

        A target that leans along its edges looks nearly the same when it leans the other way: several leanings are
        tried, and each target keeps its best.
        """
        tried = [self._posed(lean) for lean in _LEANS_RAD]
        misses = np.array([np.bincount(self._problem.targets.picture, missed) for _, missed in tried])
        best = misses.argmin(axis=0)
        poses = np.array([parameters[_PLANE:].reshape(-1, _POSE) for parameters, _ in tried])
        return np.concatenate([np.zeros(_PLANE), poses[best, np.arange(self._count)].ravel()])

    def _posed(self, lean_rad: tuple[float, float]) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "n"]]:
        """Poses that fit the plane as given, from targets that lean about x and z, and each point's squared miss."""
        start = self._upright()
        start[_PLANE:].reshape(-1, _POSE)[:, [0, 2]] = lean_rad
        plane = start[:_PLANE]

        def misses(poses: Float[np.ndarray, "p"]) -> Float[np.ndarray, "rows"]:
            return self._whitened(np.concatenate([plane, poses])).ravel()

        def slopes(poses: Float[np.ndarray, "p"]) -> Float[np.ndarray, "rows p"]:
            return self.model(np.concatenate([plane, poses]))[1][..., _PLANE:].reshape(-1, len(poses))

        found = least_squares(misses, start[_PLANE:], slopes, method="lm", ftol=_ROUGHLY, xtol=_ROUGHLY)
        return np.concatenate([plane, found.x]), np.sum(found.fun.reshape(-1, 2) ** 2, axis=1)

    def _upright(self) -> Float[np.ndarray, "p"]:
        """The plane as given, each target square to it where its points then lie."""
        poses = np.zeros((self._count, _POSE))
        plane = self._problem.start
        points = plane.intersect(self._rays)
        for k in range(self._count):
            own = self._problem.targets.picture == k
            in_target = points[own] @ self._turns[k]
            edges = self._problem.targets.edge_m[own]
            poses[k, 3] = np.nanmean(in_target[:, 0] - edges)
            poses[k, 4] = np.mean(in_target[:, 2] - self._problem.targets.height_m[own])
        return np.concatenate([np.zeros(_PLANE), poses.ravel()])

    def model(self, parameters: Float[np.ndarray, "p"]) -> tuple[np.ndarray, np.ndarray]:
        """Whitened residuals (height; edge place or 0) and derivatives."""
        here, picture = self._whitened(parameters), self._problem.targets.picture
        jacobian = np.zeros((len(picture), 2, len(parameters)))
        for k in range(_PLANE):
            step = np.zeros(len(parameters))
            step[k] = _STEP
            jacobian[:, :, k] = (self._whitened(parameters + step) - here) / _STEP
        columns = _PLANE + _POSE * picture
        for k in range(_POSE):
            step = np.zeros(len(parameters))
            step[_PLANE + k :: _POSE] = _STEP
            jacobian[np.arange(len(columns)), :, columns + k] = (self._whitened(parameters + step) - here) / _STEP
        return here, jacobian

    def heights_m(self, parameters: Float[np.ndarray, "p"]) -> Float[np.ndarray, "n"]:
        """Height of each point above its level."""
        return self._in_target(parameters, self._rays)[:, 2] - self._problem.targets.height_m

    def weigh(self, parameters: Float[np.ndarray, "p"]) -> None:
        """Take the sensitivities (metres of height and of edge place for a pixel) from these parameters on."""
        before, after = (self._in_target(parameters, rays)[:, 2] for rays in self._shifted)
        left, right = (self._in_target(parameters, rays)[:, 0] for rays in self._along)
        targets = self._problem.targets
        self._height_sigma_m = np.abs(after - before) * targets.sigma_px
        self._edge_sigma_m = np.abs(right - left) * targets.edge_sigma_px

    def _whitened(self, parameters: Float[np.ndarray, "p"]) -> Float[np.ndarray, "n 2"]:
        targets = self._problem.targets
        here = self._in_target(parameters, self._rays)
        height = (here[:, 2] - targets.height_m) / self._height_sigma_m
        edge = np.where(self._at_edge, (here[:, 0] - targets.edge_m) / self._edge_sigma_m, 0.0)
        return np.column_stack([height, edge])

    def _in_target(
        self, parameters: Float[np.ndarray, "p"], rays: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Points of the light plane in their targets' frames (y without meaning)."""
        plane = tilted(self._problem.start, parameters[:2], float(parameters[2]))
        poses = parameters[_PLANE:].reshape(-1, _POSE)
        turns = Rotation.from_rotvec(poses[:, :3]).as_matrix() @ self._turns
        picture = self._problem.targets.picture
        points = np.einsum("ni,nij->nj", plane.intersect(rays), turns[picture])
        points[:, 0] -= poses[picture, 3]
        points[:, 2] -= poses[picture, 4]
        return points

    def _first_turn(self, k: int) -> Float[np.ndarray, "3 3"]:
        """Columns x, y, z of a target in the camera frame, if its section were square to the light.

        Within the light plane, z goes with the height and x with the edge's place: the rotation that fits both best.
        """
        targets, plane = self._problem.targets, self._problem.start
        own = targets.picture == k
        points = plane.intersect(self._rays[own]) @ plane_axes(plane).T
        at_edge = np.isfinite(targets.edge_m[own])
        known = np.column_stack([targets.edge_m[own], targets.height_m[own]])[at_edge]
        seen = points[at_edge]
        U, _, V = np.linalg.svd((known - known.mean(axis=0)).T @ (seen - seen.mean(axis=0)))
        x_plane, z_plane = U @ V  # rows: x and z of the target in the light plane's axes
        axes = plane_axes(plane)
        x, z = x_plane @ axes, z_plane @ axes
        return np.column_stack([x, np.cross(z, x), z])

"""The centre of a standard sphere from one light section: an arc among other things in the profile.

The light plane cuts the sphere (radius R) in a circle (radius r). Its centre and radius in the plane come
from a geometric fit; the sphere's centre lies sqrt(R^2 - r^2) off the plane, on the side that is known
from how the sensor stands (paper P2). An error of r there counts r/sqrt(R^2 - r^2) times.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.calib.circle import (
    agreeing_points,
    algebraic_circle,
    circle_residuals,
    circles_through,
    radial_distance,
)
from weldcell.calib.least_squares import Fit, fit, robust_spread
from weldcell.cell.errors import BadInput
from weldcell.cell.optics import LaserPlane

_FEWEST_POINTS = 15
_SHORTEST_ARC_RAD = np.deg2rad(40)  # below, noise along the arc's normal moves the centre more than ten times
_LIT_RAD = np.deg2rad(110)  # light at 20 deg to z, the edge of the fan, still meets this
_ARC_BINS = 20
_END_SHARE = 0.01  # outliers that happen to lie on the circle
_ARC_FILL = 0.75  # share of bins along the arc that must hold points: two tangent lines are no arc
_SMALLEST_SHARE = 0.25  # of the sphere's radius: smaller circles are rounded edges, and no place to measure from
_GATE_SIGMAS = 4.0
_SEARCH_GATE_M = 1e-4  # a circle through three noisy points misses the others by about this
_ROUGH_M = 6e-5  # twice what speckle does to a point
_ROUGH_SIGMAS = 2.0
_RADIUS_SLACK_M = 2e-5  # systematic errors of stripe centres on a steep flank
_SIGMA_FLOOR_M = 1e-6  # no triangulation sensor knows a single point better
_ACROSS_SHARE = 0.3  # error of a point across the light, as a share of its error along the light
_OFF_PLANE_M = 1e-4
_SEARCH_STARTS = 80
_SEARCH_SPANS = (60, 30, 15, 8, 4)  # points between a triple's neighbours: the profile's length over these
_SCORED_POINTS = 200
_IMPROVED = 5  # circles of the search that are improved on their own points before one is chosen
_HALF_LIT_SHARE = 0.02  # of the arc's points, at either end: nine columns of 450
_ROUNDS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class SphereSightProblem:
    """One profile that holds an arc of the sphere."""

    points_camera: Float[np.ndarray, "n 3"]
    """Points of the light section (m); rows with NaN are left out."""
    sigma_m: Float[np.ndarray, "n"]
    """Standard deviation of each point along the light."""
    plane: LaserPlane
    """The light plane in which the points lie."""
    radius_m: float
    """Radius of the sphere."""
    side: int
    """+1 if the sphere's centre lies beyond the plane along its normal, -1 if on the camera's side."""

    def __post_init__(self) -> None:
        if self.points_camera.ndim != 2 or self.points_camera.shape != (len(self.sigma_m), 3):
            raise BadInput(
                f"sphere sight: points_camera has shape {self.points_camera.shape} and sigma_m "
                f"{self.sigma_m.shape}, expected (n, 3) and (n,)"
            )
        if not (np.isfinite(self.radius_m) and self.radius_m > 0):
            raise BadInput(f"sphere sight: radius_m is {self.radius_m}, expected a length above 0")
        if self.side not in (-1, 1):
            raise BadInput(f"sphere sight: side is {self.side}, expected -1 or 1")


@dataclass(frozen=True, kw_only=True, eq=False)
class SphereSightResult:
    """The sphere's centre as this profile shows it."""

    centre_camera: Float[np.ndarray, "3"]
    """Metres; NaN if not valid."""
    covariance_camera: Float[np.ndarray, "3 3"]
    """Of the centre (m^2): points' noise alone, with its correlation between neighbours; NaN if not valid."""
    circle_laser: Float[np.ndarray, "3"]
    """The section in the laser frame: x and z of its centre, and its radius (m); NaN if not valid."""
    circle_covariance_laser: Float[np.ndarray, "3 3"]
    """Of the section (m^2): points' noise alone, with its correlation between neighbours; NaN if not valid."""
    circle_radius_m: float
    """Radius of the section."""
    circle_radius_sigma_m: float
    arc_rad: float
    """How much of the circle was seen."""
    rms_m: float
    """Root mean square distance of the arc's points from the circle."""
    inliers: Bool[np.ndarray, "n"]
    """The points taken as the sphere's."""
    valid: bool
    reason: str = ""
    """Why there is no centre, if there is none."""


def solve(problem: SphereSightProblem) -> SphereSightResult:
    """The centre from the largest arc that this sphere can show; deterministic."""
    points_laser = problem.plane.T_camera_laser.inv().apply(problem.points_camera)
    usable = np.flatnonzero(np.isfinite(points_laser).all(axis=1) & np.isfinite(problem.sigma_m))
    usable = usable[np.argsort(points_laser[usable, 0], kind="stable")]
    if len(usable) < _FEWEST_POINTS:
        return _invalid(problem, f"{len(usable)} points in the profile, expected at least {_FEWEST_POINTS}")
    off_plane_m = float(np.abs(points_laser[usable, 1]).max())
    if off_plane_m > _OFF_PLANE_M:
        return _invalid(problem, f"points lie up to {off_plane_m * 1e3:.3g} mm off the light plane")
    section = points_laser[usable][:, [0, 2]]
    sigma_m = np.maximum(problem.sigma_m[usable], _SIGMA_FLOOR_M)
    found = _find_arc(section, sigma_m, problem.radius_m)
    if found is None:
        return _invalid(problem, f"no arc of a circle up to {problem.radius_m * 1e3:.3g} mm radius in the profile")
    circle, inliers = _fit_arc(section, sigma_m, found)
    if circle is None:
        return _invalid(problem, f"{np.sum(inliers)} points on the arc, expected at least {_FEWEST_POINTS}")
    return _raise_centre(problem, circle, usable[inliers], section[inliers])


def _find_arc(
    section: Float[np.ndarray, "n 2"], sigma_m: Float[np.ndarray, "n"], radius_m: float
) -> Float[np.ndarray, "3"] | None:
    """Centre and radius of the circle through three points that most others agree with.

    The triples lie on a fixed grid over the profile (neighbours in it are likely from one thing), close
    and wide ones, so the search needs no chance.
    """
    circles = circles_through(section, *_triples(len(section)))
    low_m, high_m = _SMALLEST_SHARE * radius_m, 1.05 * radius_m
    circles = circles[(circles[:, 2] > low_m) & (circles[:, 2] < high_m)]
    if not len(circles):
        return None
    gates_m = np.maximum(_GATE_SIGMAS * sigma_m, _SEARCH_GATE_M)
    scored = slice(None, None, max(1, len(section) // _SCORED_POINTS))
    ranking = np.argsort(-agreeing_points(section[scored], gates_m[scored], circles), kind="stable")
    improved = np.array([_improved(section, gates_m, circle, high_m) for circle in circles[ranking[:_IMPROVED]]])
    return improved[np.argmax(agreeing_points(section, gates_m, improved))]


def _improved(
    section: Float[np.ndarray, "n 2"], gates_m: Float[np.ndarray, "n"], circle: Float[np.ndarray, "3"], high_m: float
) -> Float[np.ndarray, "3"]:
    """The circle through all points near it, twice; as it was where that is no circle of the sphere's size."""
    for _ in range(_ROUNDS):
        near = np.abs(radial_distance(section, circle)) < gates_m
        if np.sum(near) < _FEWEST_POINTS:
            break
        better = algebraic_circle(section[near])
        if not 0 < better[2] < high_m:
            break
        circle = better
    return circle


def _fit_arc(
    section: Float[np.ndarray, "n 2"], sigma_m: Float[np.ndarray, "n"], circle: Float[np.ndarray, "3"]
) -> tuple[Fit | None, Bool[np.ndarray, "n"]]:
    """Geometric fit of the circle to the points near it, twice gated by what the residuals' spread is."""
    gates = np.maximum(_GATE_SIGMAS, _SEARCH_GATE_M / sigma_m)
    found: Fit | None = None
    for _ in range(2):
        sigma_radial_m = _sigma_radial_m(section, sigma_m, circle)
        whitened = radial_distance(section, circle) / sigma_radial_m
        inliers = (np.abs(whitened) < gates) & (np.abs(_from_light(section - circle[:2])) < _LIT_RAD)
        if np.sum(inliers) < _FEWEST_POINTS:
            return None, inliers
        inner = _without_ends(np.flatnonzero(inliers))
        arc, arc_sigma_m = section[inner], sigma_radial_m[inner]
        found = fit(lambda guess: circle_residuals(arc, arc_sigma_m, guess), circle)  # noqa: B023 (used at once)
        circle = found.parameters
        gates = np.full(len(section), _GATE_SIGMAS * max(1.0, robust_spread(found.residuals, unknowns=3)))
    return found, inliers


def _without_ends(places: Int[np.ndarray, "k"]) -> Int[np.ndarray, "m"]:
    """The arc but for its outermost points: where the stripe ends half lit, its centre is no longer the line's."""
    count = int(_HALF_LIT_SHARE * len(places))
    return places[count : len(places) - count]


def _raise_centre(
    problem: SphereSightProblem, circle: Fit, inliers: Int[np.ndarray, "k"], arc: Float[np.ndarray, "k 2"]
) -> SphereSightResult:
    """The sphere's centre above its section, or why there is none."""
    centre, radius_m = circle.parameters[:2], float(circle.parameters[2])
    covariance = circle.covariance * _correlation_inflation(circle.residuals[:, 0])
    sigma_radius_m = float(np.sqrt(covariance[2, 2]))
    arc_rad, fill = _arc_seen(arc - centre)
    rms_m = float(np.sqrt(np.mean(radial_distance(arc, circle.parameters) ** 2)))
    rough_m = max(_ROUGH_M, _ROUGH_SIGMAS * float(np.median(problem.sigma_m[inliers])))
    largest_m = problem.radius_m + _GATE_SIGMAS * sigma_radius_m + _RADIUS_SLACK_M
    reason = ""
    if not (circle.converged and np.isfinite(sigma_radius_m)):
        reason = f"the circle's fit did not converge: {circle.message}"
    elif arc_rad < _SHORTEST_ARC_RAD or fill < _ARC_FILL:
        expected = f"{np.rad2deg(_SHORTEST_ARC_RAD):.0f} deg, {_ARC_FILL:.0%} or more"
        reason = f"an arc of {np.rad2deg(arc_rad):.0f} deg, {fill:.0%} of it filled; expected {expected}"
    elif rms_m > rough_m:
        reason = f"points lie {rms_m * 1e3:.3g} mm rms off the best circle: not a sphere's arc"
    elif radius_m > largest_m:
        reason = f"the arc's radius is {radius_m * 1e3:.3f} mm, more than the sphere's {problem.radius_m * 1e3:.3f} mm"
    if reason:
        return _invalid(problem, reason)
    centre_camera, spread = _lift(problem, centre, radius_m, sigma_radius_m)
    mask = np.zeros(len(problem.points_camera), dtype=bool)
    mask[inliers] = True
    return SphereSightResult(
        centre_camera=centre_camera,
        covariance_camera=spread @ covariance @ spread.T,
        circle_laser=circle.parameters,
        circle_covariance_laser=covariance,
        circle_radius_m=radius_m,
        circle_radius_sigma_m=sigma_radius_m,
        arc_rad=arc_rad,
        rms_m=rms_m,
        inliers=mask,
        valid=True,
    )


def _lift(
    problem: SphereSightProblem, centre: Float[np.ndarray, "2"], radius_m: float, sigma_radius_m: float
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """The sphere's centre in the camera, and its derivatives by the circle's centre and radius."""
    height_m = np.sqrt(max(problem.radius_m**2 - radius_m**2, 0.0))
    # near a great circle the height's error is that of a square root, not its (infinite) slope
    slope = radius_m / max(height_m, np.sqrt(radius_m * sigma_radius_m))
    T_camera_laser = problem.plane.T_camera_laser
    centre_laser = np.array([centre[0], -problem.side * height_m, centre[1]])  # y points against the normal
    spread = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, problem.side * slope], [0.0, 1.0, 0.0]])
    return T_camera_laser.apply(centre_laser), T_camera_laser.rotation.as_matrix() @ spread


def _invalid(problem: SphereSightProblem, reason: str) -> SphereSightResult:
    return SphereSightResult(
        centre_camera=np.full(3, np.nan),
        covariance_camera=np.full((3, 3), np.nan),
        circle_laser=np.full(3, np.nan),
        circle_covariance_laser=np.full((3, 3), np.nan),
        circle_radius_m=np.nan,
        circle_radius_sigma_m=np.nan,
        arc_rad=0.0,
        rms_m=np.nan,
        inliers=np.zeros(len(problem.points_camera), dtype=bool),
        valid=False,
        reason=reason,
    )


def _sigma_radial_m(
    section: Float[np.ndarray, "n 2"], sigma_m: Float[np.ndarray, "n"], circle: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "n"]:
    """Standard deviation of a point's distance from the circle: its error lies along the light (z) for the most."""
    offsets = section - circle[:2]
    along_light = offsets[:, 1] / np.maximum(np.hypot(offsets[:, 0], offsets[:, 1]), 1e-12)
    return sigma_m * np.sqrt(along_light**2 + _ACROSS_SHARE**2)


def _correlation_inflation(residuals: Float[np.ndarray, "k"]) -> float:
    """Variance of a mean of neighbours that agree with each other (first-order autoregression), at least 1."""
    power = float(np.sum(residuals**2))
    shared = float(np.sum(residuals[1:] * residuals[:-1])) / power if power > 0 else 0.0
    shared = min(max(shared, 0.0), 0.9)
    return (1 + shared) / (1 - shared)


def _arc_seen(offsets: Float[np.ndarray, "k 2"]) -> tuple[float, float]:
    """Angle between the arc's ends (1 % of the points at each left out), and the share of it that holds points."""
    angles = _from_light(offsets)
    low, high = np.quantile(angles, [_END_SHARE, 1 - _END_SHARE])
    counts, _ = np.histogram(angles, bins=_ARC_BINS, range=(low, max(high, low + 1e-12)))
    return float(high - low), float(np.mean(counts > 0))


def _from_light(offsets: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch"]:
    """Angle of places on the circle from the one that the light meets head-on (rad)."""
    return np.arctan2(offsets[..., 0], -offsets[..., 1])


def _triples(count: int) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Indices of the search's triples."""
    steps = np.unique(np.maximum(count // np.array(_SEARCH_SPANS), 2))
    shares = np.linspace(0, 1, _SEARCH_STARTS)
    first = np.rint(shares * (count - 1 - 2 * steps[:, None])).astype(int).ravel()
    step = np.repeat(steps, _SEARCH_STARTS)
    return first, first + step, first + 2 * step

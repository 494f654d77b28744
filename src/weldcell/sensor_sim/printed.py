"""Printed boards in the sensor's pictures: exact edges, blurred by the lens, in the cell's light and in the laser's.

A texture drawn by a graphics card is sampled, and its edges are off by a tenth of a pixel and more. Here the board is
drawn white, and each pixel is multiplied by the reflectance that the pattern has for it.

Cell's light. The lens blurs the picture by a Gaussian (`focus`, pixel box included), so a pixel sees the pattern's mean
under a Gaussian about the point q where its ray meets the board. With M the derivatives of q by the pixel, that
Gaussian has the covariance C = sigma^2 M M^T on the board. The pattern is a sum of products f(x) g(y) of steps. Under a
Gaussian with correlation r between x and y (Mehler's expansion, from exp(r sigma_x sigma_y d/dx d/dy)),

    E[f g] = sum over n of r^n / n! (sigma_x^n F^(n)) (sigma_y^n G^(n)),

with F, G the steps smoothed by sigma_x, sigma_y: an edge of height h becomes h Phi(z), z = (x - edge) / sigma, and
sigma^n F^(n) = h He_(n-1)(-z) phi(z). Off the corners only n = 0 counts, and it is exact.

Laser's light. The stripe before blur is a Gaussian ridge of width p across itself, the blur a Gaussian of width s.
What a pixel at the distance e from the ridge sees of the board's laser light lies, across the stripe, about
e p^2 / (p^2 + s^2) with the variance p^2 s^2 / (p^2 + s^2) (the product of two Gaussians), and along the stripe about
the pixel with s^2. So the stripe's pixels are multiplied by the pattern's mean there: edges that cross the stripe askew
move its centre, as they do in reality.

Nothing may stand between camera and print; light that passes the board onto what lies behind is not touched by it.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import RigidTransform
from scipy.special import ndtr

from weldcell.cell.optics import CameraModel
from weldcell.models.board import Pattern, Steps
from weldcell.sensor_sim.drawing import LaserLight
from weldcell.sensor_sim.focus import Lens
from weldcell.sensor_sim.line_sensor import FrameLight
from weldcell.sensor_sim.stripe import StripePieces

_KNOT_SPACING_PX = 16  # of the rays' map; cubic splines between are right to 1e-6 px
_REACH_SIGMAS = 6.0  # beyond, an edge changes the mean by less than 1e-9
_ORDERS = 4  # of Mehler's expansion: its rest is below 1e-3 of the contrast at a correlation of 0.5
_FAINTEST_GREY = 1e-3


class PrintedBoards:
    """What one sensor sees of printed boards."""

    def __init__(self, camera: CameraModel, lens: Lens) -> None:
        self._camera, self._lens = camera, lens
        self._rays, self._rays_u, self._rays_v = _pixel_rays(camera)

    def printed(self, light: FrameLight, pattern: Pattern, T_base_board: RigidTransform) -> FrameLight:
        """The light of a frame in which the board was drawn white, now with the pattern on it."""
        T_camera_board = light.T_base_camera.inv() * T_base_board
        if T_camera_board.rotation.as_matrix()[:, 2] @ T_camera_board.translation <= 0:
            return light  # the board turns its back
        return replace(
            light,
            ambient_grey=self._on_ambient(light.ambient_grey, pattern, T_camera_board),
            laser=self._on_laser(light.laser, light.stripe, pattern, T_camera_board),
        )

    def _on_ambient(
        self, ambient_grey: Float[np.ndarray, "height width"], pattern: Pattern, T_camera_board: RigidTransform
    ) -> Float[np.ndarray, "height width"]:
        rows, columns = self._window(pattern, T_camera_board)
        v, u = (grid.ravel() for grid in np.mgrid[rows, columns])
        if len(u) == 0:
            return ambient_grey
        point, by_u, by_v, sigma_px = self._board_points(u, v, T_camera_board)
        spread = np.einsum("ni,nj->nij", by_u, by_u) + np.einsum("ni,nj->nij", by_v, by_v)
        factor = reflectance(pattern, point, spread * (sigma_px**2)[:, None, None])
        grey = ambient_grey.copy()
        grey[rows, columns] *= factor.reshape(grey[rows, columns].shape).astype(grey.dtype)
        return grey

    def _on_laser(
        self, laser: LaserLight, stripe: StripePieces, pattern: Pattern, T_camera_board: RigidTransform
    ) -> LaserLight:
        v, u = np.nonzero(laser.grey > _FAINTEST_GREY)
        if len(u) == 0:
            return laser
        ridge = self._ridge(stripe, pattern, T_camera_board)
        here = np.isfinite(
            ridge.centre_px[(u + laser.first_column) if stripe.along == "rows" else (v + laser.first_row)]
        )
        v, u = v[here], u[here]
        pixel_u, pixel_v = u + laser.first_column, v + laser.first_row
        cut, along_cut = (pixel_u, pixel_v) if stripe.along == "rows" else (pixel_v, pixel_u)
        point, by_u, by_v, blur_px = self._board_points(pixel_u, pixel_v, T_camera_board)
        by_cut, by_along = (by_u, by_v) if stripe.along == "rows" else (by_v, by_u)
        slope = ridge.slope[cut]
        length = np.hypot(1, slope)
        on_line = (by_cut + slope[:, None] * by_along) / length[:, None]  # a pixel along the stripe, on the board
        off_line = (by_along - slope[:, None] * by_cut) / length[:, None]  # a pixel across it
        away_px = (along_cut - ridge.centre_px[cut]) / length
        total2 = (ridge.sigma_px[cut] / length) ** 2  # across the stripe, blur included
        sheet2 = np.maximum(total2 - blur_px**2, 1e-12)
        point = point - (away_px * blur_px**2 / total2)[:, None] * off_line
        spread = (blur_px**2)[:, None, None] * np.einsum("ni,nj->nij", on_line, on_line)
        spread += (sheet2 * blur_px**2 / total2)[:, None, None] * np.einsum("ni,nj->nij", off_line, off_line)
        grey = laser.grey.copy()
        grey[v, u] *= reflectance(pattern, point, spread).astype(grey.dtype)
        return replace(laser, grey=grey)

    def _ridge(self, stripe: StripePieces, pattern: Pattern, T_camera_board: RigidTransform) -> "_Ridge":
        """The stripe's centre, width and slope on each cut where it lies on the print; NaN elsewhere."""
        pixels = np.column_stack([stripe.u_px, stripe.v_px]).astype(float)
        low, high = _bounds(pattern)
        points = _on_plane(self._camera.unproject(pixels), T_camera_board)
        own = np.all((points >= low) & (points <= high), axis=1)
        cuts = self._camera.width_px if stripe.along == "rows" else self._camera.height_px
        centre, sigma = np.full((2, cuts), np.nan)
        centre[stripe.cut_px[own]], sigma[stripe.cut_px[own]] = stripe.centre_px[own], stripe.sigma_px[own]
        found = np.flatnonzero(np.isfinite(centre))
        slope = np.zeros(cuts)
        if len(found) > 1:
            slope[found] = np.gradient(centre[found], found)
        return _Ridge(centre_px=centre, sigma_px=sigma, slope=slope)

    def _window(self, pattern: Pattern, T_camera_board: RigidTransform) -> tuple[slice, slice]:
        """Rows and columns of the picture that hold all of the print, with room for the blur."""
        low, high = _bounds(pattern)
        share = np.linspace(0, 1, 30)[:, None]
        ring = np.vstack([low + share * [high[0] - low[0], 0], low + share * [0, high[1] - low[1]]])
        ring = np.vstack([ring, low + high - ring])
        points = T_camera_board.apply(np.column_stack([ring, np.zeros(len(ring))]))
        pixels = self._camera.project(points)
        margin = 1 + _REACH_SIGMAS * float(np.nanmax(self._lens.blur_sigma_px(points, pixels, self._camera)))
        first = np.floor(np.nanmin(pixels, axis=0) - margin)
        last = np.ceil(np.nanmax(pixels, axis=0) + margin) + 1
        size = np.array([self._camera.width_px, self._camera.height_px])
        first, last = (np.clip(side, 0, size).astype(int) for side in (first, last))
        return slice(first[1], last[1]), slice(first[0], last[0])

    def _board_points(
        self, u: Int[np.ndarray, "n"], v: Int[np.ndarray, "n"], T_camera_board: RigidTransform
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """Where pixels' rays meet the board (m), how that moves by a pixel along u and v, and the blur there (px)."""
        axes, origin = T_camera_board.rotation.as_matrix(), T_camera_board.translation
        rays = self._rays[v, u]
        across = rays @ axes[:, 2]
        scale = (axes[:, 2] @ origin) / across
        flat = rays @ axes[:, :2]
        moves = [
            scale[:, None] * (step @ axes[:, :2] - flat * (step @ axes[:, 2] / across)[:, None])
            for step in (self._rays_u[v, u], self._rays_v[v, u])
        ]
        pixels = np.column_stack([u, v]).astype(float)
        sigma_px = self._lens.blur_sigma_px(rays * scale[:, None], pixels, self._camera)
        return flat * scale[:, None] - origin @ axes[:, :2], moves[0], moves[1], sigma_px


def reflectance(
    pattern: Pattern, points_board: Float[np.ndarray, "n 2"], covariance_board: Float[np.ndarray, "n 2 2"]
) -> Float[np.ndarray, "n"]:
    """Mean brightness of the pattern, relative to white, under Gaussians about points of the board (m, m^2)."""
    sigma = np.sqrt(covariance_board[:, [0, 1], [0, 1]])
    correlation = covariance_board[:, 0, 1] / (sigma[:, 0] * sigma[:, 1])
    black = np.zeros(len(points_board))
    for term in pattern.terms:
        near = _near_edge(term.x, points_board[:, 0], sigma[:, 0]) | _near_edge(term.y, points_board[:, 1], sigma[:, 1])
        for chosen, orders in ((np.flatnonzero(~near), 0), (np.flatnonzero(near), _ORDERS)):
            along_x = _smoothed(term.x, points_board[chosen, 0], sigma[chosen, 0], orders)
            along_y = _smoothed(term.y, points_board[chosen, 1], sigma[chosen, 1], orders)
            weight = np.full(len(chosen), term.weight)
            for n in range(orders + 1):
                black[chosen] += weight * along_x[n] * along_y[n]
                weight = weight * correlation[chosen] / (n + 1)
    return 1 - (1 - pattern.black_ratio) * black


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ridge:
    """The stripe on the print, cut by cut."""

    centre_px: Float[np.ndarray, "cuts"]
    sigma_px: Float[np.ndarray, "cuts"]
    slope: Float[np.ndarray, "cuts"]


def _smoothed(
    steps: Steps, place: Float[np.ndarray, "n"], sigma: Float[np.ndarray, "n"], orders: int
) -> list[Float[np.ndarray, "n"]]:
    """The smoothed steps and their derivatives times sigma^n; the edges next to a place count."""
    index = np.searchsorted(steps.edges_m, place)
    total = [steps.levels[index].astype(float), *(np.zeros(len(place)) for _ in range(orders))]
    if orders == 0:
        return total
    last = len(steps.edges_m) - 1
    for edge, beyond in ((index - 1, index - 1), (index, index + 1)):
        there = (edge >= 0) & (edge <= last)
        edge, beyond = np.clip(edge, 0, last), np.clip(beyond, 0, last + 1)
        change = np.where(there, steps.levels[beyond] - steps.levels[index], 0.0)
        z = (place - steps.edges_m[edge]) / sigma
        sign = np.where(beyond > index, 1.0, -1.0)
        total[0] = total[0] + change * ndtr(sign * z)
        slope = change * sign * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi)
        before, hermite = np.zeros(len(z)), np.ones(len(z))
        for n in range(1, orders + 1):
            total[n] = total[n] + (-1) ** (n - 1) * hermite * slope
            before, hermite = hermite, z * hermite - (n - 1) * before
    return total


def _near_edge(steps: Steps, place: Float[np.ndarray, "n"], sigma: Float[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    after = np.clip(np.searchsorted(steps.edges_m, place), 1, len(steps.edges_m) - 1)
    away = np.minimum(np.abs(place - steps.edges_m[after - 1]), np.abs(place - steps.edges_m[after]))
    return away < _REACH_SIGMAS * sigma


def _bounds(pattern: Pattern) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Lower and upper corner of what is printed (m)."""
    edges = [np.concatenate([getattr(term, axis).edges_m for term in pattern.terms]) for axis in "xy"]
    return np.array([e.min() for e in edges]), np.array([e.max() for e in edges])


def _on_plane(rays: Float[np.ndarray, "n 3"], T_camera_board: RigidTransform) -> Float[np.ndarray, "n 2"]:
    axes, origin = T_camera_board.rotation.as_matrix(), T_camera_board.translation
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = (axes[:, 2] @ origin) / (rays @ axes[:, 2])
    return rays @ axes[:, :2] * scale[:, None] - origin @ axes[:, :2]


def _pixel_rays(
    camera: CameraModel,
) -> tuple[
    Float[np.ndarray, "height width 3"], Float[np.ndarray, "height width 3"], Float[np.ndarray, "height width 3"]
]:
    """Every pixel's ray (x, y, 1), and its derivatives by u and by v."""
    u_knots, v_knots = (
        np.linspace(-0.5, n - 0.5, n // _KNOT_SPACING_PX + 4) for n in (camera.width_px, camera.height_px)
    )
    knots = camera.unproject(np.stack(np.meshgrid(u_knots, v_knots), axis=-1))
    u, v = np.arange(camera.width_px), np.arange(camera.height_px)
    rays, by_u, by_v = np.zeros((3, len(v), len(u), 3))
    rays[..., 2] = 1
    for axis in (0, 1):
        spline = RectBivariateSpline(v_knots, u_knots, knots[..., axis])
        rays[..., axis], by_u[..., axis], by_v[..., axis] = spline(v, u), spline(v, u, dy=1), spline(v, u, dx=1)
    return rays, by_u, by_v

"""The stripe that a light section makes in the picture: its centre, width and brightness in every column (or row).

A stripe that runs along the picture's rows is cut by columns, one that runs along columns by rows. The words below are
those of the first: u runs along the stripe, v across it.

Centre. A piece's centre is where its column sees the centre surface of the light sheet on the workpiece. The light
about it is taken as an even Gaussian: perspective and the change of thickness and blur within the sheet make it skew,
which moves its centroid by up to 0.3 % of its sigma and is left out.

Across the stripe. The light sheet is Gaussian along its normal n, I(e) = exp(-e^2 / 2 s^2) with e = n.q - d. A pixel of
column u, row v looks along r(u, v) at the surface's tangent plane through the lit point p (normal N), at
q(v) = r (N.p) / (N.r). At p, where r z = p, and with r' = dr/dv,

    dq/dv = z (r' - r (N.r') / (N.r)),     de/dv = n.dq/dv,     sigma_v = s / |de/dv|.

r' holds the lens's distortion: (dx/dv, dy/dv) solves J (dx, dy) = (0, 1) with J the Jacobian of pixels by
undistorted image coordinates. The stripe's slope v' is that of the tangent t = N x n, whose image coordinates change
by (t - t_z r) / z.

Blur. Lens and pixel blur the picture about each point isotropically with sigma_psf (`focus`). A locally straight line
of slope v' has the width sigma_v cos(a) across itself, tan(a) = v'; blurred, sqrt(sigma_v^2 cos^2(a) + sigma_psf^2);
cut by a column again,

    sigma = sqrt(sigma_v^2 + sigma_psf^2 (1 + v'^2)),    amplitude = amplitude_unblurred * sigma_v / sigma,

since blur keeps the light of each column. The end of a line fades like the integral of the blur, Phi(s / sigma_psf).

Brightness comes in as the amplitude before blur, relative to that of a matt white surface hit head-on where the light
plane meets the camera's axis; such a surface peaks at `peak_grey` in the picture. The lens's own fall-off (cos^4:
12 % in P2's corner, half in P1's) is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.special import ndtr

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.focus import Lens, lens
from weldcell.sensor_sim.laser import LaserFan
from weldcell.sensor_sim.light_section import LightSection
from weldcell.sensor_sim.surface_runs import surface_runs

StripeAlong = Literal["rows", "columns"]

_STEEPEST = 6.0  # slope up to which the line is taken as straight over the blur; beyond, the light only grazes
_WIDEST_PX = 30.0  # a sheet that lies in the surface would be lit without end, at no brightness
_FADE_SIGMAS = 3.0
_FAINTEST_GREY = 0.02
_CORNER_PX = 0.15  # tangents that miss the next point by more belong to two faces
_ALONG, _ACROSS, _SHEET, _BLUR, _BRIGHTNESS, _RAY, _SLOPE, _FROM_HEAD, _FROM_TAIL = range(9)
"""What a knot of a line holds: coordinates and widths (px), brightness, ray, slope, ways from both ends (px)."""


@dataclass(frozen=True, kw_only=True)
class StripeOptics:
    """What turns a light section into grey levels."""

    lens: Lens
    """What blurs the picture."""
    unblurred_grey: float
    """Grey level, before blur, of light of brightness 1."""
    along: StripeAlong
    """What the stripe runs along in the picture."""


@dataclass(frozen=True, kw_only=True)
class StripePieces:
    """The stripe cut by picture columns (or rows): an entry for each crossing, several where the profile folds."""

    along: StripeAlong
    """What the stripe runs along; it is cut by the other."""
    cut_px: Int[np.ndarray, "k"]
    """The column that cuts a stripe along rows; the row that cuts one along columns."""
    centre_px: Float[np.ndarray, "k"]
    """Exact place of the stripe's centre on that cut."""
    sigma_px: Float[np.ndarray, "k"]
    """Standard deviation of the stripe's section along the cut, blur included."""
    amplitude_grey: Float[np.ndarray, "k"]
    """Peak of the section."""
    coverage: Float[np.ndarray, "k"]
    """1 within the stripe, 0.5 at its end, less in the blur beyond it; the amplitude holds it already."""
    ray: Float[np.ndarray, "k"]
    """The section's ray that lights it: the ray's index plus the share of the way to the next one."""

    @property
    def u_px(self) -> Int[np.ndarray, "k"] | Float[np.ndarray, "k"]:
        """Column of each centre; whole numbers for a stripe along rows."""
        return self.cut_px if self.along == "rows" else self.centre_px

    @property
    def v_px(self) -> Int[np.ndarray, "k"] | Float[np.ndarray, "k"]:
        """Row of each centre; whole numbers for a stripe along columns."""
        return self.centre_px if self.along == "rows" else self.cut_px


def joined_pieces(parts: Sequence[StripePieces]) -> StripePieces:
    """The pieces of several stripes of one picture; `ray` keeps each one's own meaning."""
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0]) if name != "along"
    }
    return StripePieces(along=parts[0].along, **arrays)


def stripe_optics(config: SensorConfig, camera: CameraModel, fan: LaserFan) -> StripeOptics:
    """Blur and brightness of a sensor; `camera` and `fan` are the actual ones."""
    glass, along = lens(config), config.stripe_along
    point_camera = fan.plane.intersect(np.array([[0.0, 0.0, 1.0]]))
    share = 1.0
    if np.all(np.isfinite(point_camera)):  # else the camera's axis never meets the light: any scale will do
        to_source = fan.source_camera - point_camera
        range_m = np.linalg.norm(to_source, axis=1)
        jacobian, sheet_normal = _pixel_jacobian(point_camera, camera, along), fan.plane.normal_camera[None]
        thickness_m, head_on = fan.sheet.sigma_m(range_m), to_source / range_m[:, None]
        sheet_px = _sheet_sigma_px(point_camera, head_on, sheet_normal, thickness_m, jacobian)
        blur_px = glass.blur_sigma_px(point_camera, camera.project(point_camera), camera)
        share = float((sheet_px / np.hypot(sheet_px, blur_px))[0])
    return StripeOptics(lens=glass, unblurred_grey=config.peak_grey / share, along=along)


def stripe_pieces(
    section: LightSection, brightness: Float[np.ndarray, "n"], camera: CameraModel, optics: StripeOptics
) -> StripePieces:
    """The stripe of a light section, cut by cut; `brightness` is each ray's amplitude before blur (see above)."""
    rays = np.flatnonzero(section.visible)
    runs = surface_runs(section, rays)
    if not runs:
        return _no_pieces(optics.along)
    knots = _knots(section, rays, brightness, camera, optics)
    lines = np.vstack([_with_ends(knots[run]) for run in runs])
    last = np.cumsum([run.stop - run.start + 2 for run in runs]) - 1
    starts, stops = np.delete(lines, last, axis=0), np.delete(lines, np.append(0, last[:-1] + 1), axis=0)
    cuts_px = camera.width_px if optics.along == "rows" else camera.height_px
    return _cut(starts, stops, cuts_px, optics)


def _pixel_jacobian(
    points_camera: Float[np.ndarray, "n 3"], camera: CameraModel, along: StripeAlong
) -> Float[np.ndarray, "n 2 2"]:
    """Derivatives of the pixel, along and across the stripe, by the undistorted image coordinates (x, y) of points."""
    jacobian = camera.distortion_jacobian(points_camera[:, :2] / points_camera[:, 2:]) * camera.focal_px[:, None]
    return jacobian if along == "rows" else jacobian[:, ::-1]


def _sheet_sigma_px(
    points_camera: Float[np.ndarray, "n 3"],
    normals_camera: Float[np.ndarray, "n 3"],
    sheet_normals_camera: Float[np.ndarray, "n 3"],
    sheet_sigma_m: Float[np.ndarray, "n"],
    jacobian: Float[np.ndarray, "n 2 2"],
) -> Float[np.ndarray, "n"]:
    """Width (one sigma) of the sheet's section along the cuts, before blur."""
    (by_x, by_y), (across_by_x, across_by_y) = jacobian.transpose(1, 2, 0)
    step = np.column_stack([-by_y, by_x]) / (by_x * across_by_y - by_y * across_by_x)[:, None]  # of (x, y) for a pixel
    rays = points_camera / points_camera[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ray = _dot(normals_camera[:, :2], step) / _dot(normals_camera, rays)
        through_sheet = _dot(sheet_normals_camera[:, :2], step) - along_ray * _dot(sheet_normals_camera, rays)
        return np.minimum(sheet_sigma_m / np.abs(points_camera[:, 2] * through_sheet), _WIDEST_PX)


def _slopes(
    points_camera: Float[np.ndarray, "n 3"],
    normals_camera: Float[np.ndarray, "n 3"],
    sheet_normals_camera: Float[np.ndarray, "n 3"],
    jacobian: Float[np.ndarray, "n 2 2"],
) -> Float[np.ndarray, "n"]:
    """Slope of the stripe (pixels across for a pixel along) at each point, from the surface's tangent in the sheet."""
    tangents = np.cross(normals_camera, sheet_normals_camera)
    steps = tangents[:, :2] - tangents[:, 2:] * points_camera[:, :2] / points_camera[:, 2:]
    along, across = np.einsum("nij,nj->in", jacobian, steps)
    with np.errstate(divide="ignore", invalid="ignore"):
        return across / along


def _dot(a: Float[np.ndarray, "n k"], b: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n"]:
    return np.einsum("ni,ni->n", a, b)


def _knots(
    section: LightSection,
    rays: Int[np.ndarray, "n"],
    brightness: Float[np.ndarray, "m"],
    camera: CameraModel,
    optics: StripeOptics,
) -> Float[np.ndarray, "n 7"]:
    """What the stripe is at each of these rays' points, in the order of the column names."""
    points_camera, pixels = section.points_camera[rays], section.pixels[rays]
    surface, sheet = section.normals_camera[rays], section.sheet_normals_camera[rays]
    jacobian = _pixel_jacobian(points_camera, camera, optics.along)
    knots = np.empty((len(rays), _SLOPE + 1))
    knots[:, [_ALONG, _ACROSS]] = pixels if optics.along == "rows" else pixels[:, ::-1]
    knots[:, _SHEET] = _sheet_sigma_px(points_camera, surface, sheet, section.sheet_sigma_m[rays], jacobian)
    knots[:, _BLUR] = optics.lens.blur_sigma_px(points_camera, pixels, camera)
    knots[:, _BRIGHTNESS], knots[:, _RAY] = brightness[rays], rays
    knots[:, _SLOPE] = _slopes(points_camera, surface, sheet, jacobian)
    return knots


def _with_ends(knots: Float[np.ndarray, "n 7"]) -> Float[np.ndarray, "n+2 9"]:
    """Knots of a line with both ends drawn out, and the ways from both ends (px).

    The surface's end lies somewhere between the last ray that met it and the next: half a spacing beyond is taken,
    which is right on average.
    """
    steps = np.diff(knots[:, :2], axis=0)
    lengths = np.maximum(np.linalg.norm(steps, axis=1), 1e-9)
    head_fade_px, tail_fade_px = _FADE_SIGMAS * knots[[0, -1], _BLUR]
    line = np.empty((len(knots) + 2, _FROM_TAIL + 1))
    line[0, :_FROM_HEAD], line[1:-1, :_FROM_HEAD], line[-1, :_FROM_HEAD] = knots[0], knots, knots[-1]
    line[0, :2] -= steps[0] / lengths[0] * (head_fade_px + lengths[0] / 2)
    line[-1, :2] += steps[-1] / lengths[-1] * (tail_fade_px + lengths[-1] / 2)
    way = np.concatenate([[0], np.cumsum(lengths)]) + lengths[0] / 2
    end = way[-1] + lengths[-1] / 2
    line[:, _FROM_HEAD] = np.concatenate([[-head_fade_px], way, [end + tail_fade_px]])
    line[:, _FROM_TAIL] = end - line[:, _FROM_HEAD]
    return line


def _cut(
    starts: Float[np.ndarray, "n 9"], stops: Float[np.ndarray, "n 9"], cuts_px: int, optics: StripeOptics
) -> StripePieces:
    """The pieces where segments cross cuts; a segment owns the cuts from its smaller end up to before its larger."""
    ends = np.clip(np.ceil(np.sort([starts[:, _ALONG], stops[:, _ALONG]], axis=0)), 0, cuts_px).astype(np.int64)
    low, count = ends[0], ends[1] - ends[0]
    segment = np.repeat(np.arange(len(starts)), count)
    cut_px = low[segment] + np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    a, b = starts[segment], stops[segment]
    share = (cut_px - a[:, _ALONG]) / (b[:, _ALONG] - a[:, _ALONG])
    _, centre_px, sheet_px, point_blur_px, brightness, ray, _, from_head, from_tail = (a + share[:, None] * (b - a)).T
    slope = (b[:, _ACROSS] - a[:, _ACROSS]) / (b[:, _ALONG] - a[:, _ALONG])
    sigma_px = np.hypot(sheet_px, point_blur_px * np.sqrt(1 + np.minimum(slope**2, _STEEPEST**2)))
    coverage = ndtr(from_head / point_blur_px) * ndtr(from_tail / point_blur_px)
    amplitude_grey = optics.unblurred_grey * brightness * sheet_px / sigma_px * coverage
    kept = amplitude_grey > _FAINTEST_GREY
    return StripePieces(
        along=optics.along,
        cut_px=cut_px[kept],
        centre_px=(centre_px + _sagitta_px(a, b, share))[kept],
        sigma_px=sigma_px[kept],
        amplitude_grey=amplitude_grey[kept],
        coverage=coverage[kept],
        ray=ray[kept],
    )


def _sagitta_px(
    a: Float[np.ndarray, "k 9"], b: Float[np.ndarray, "k 9"], share: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "k"]:
    """How far the curve between two knots leaves its chord (Hermite's cubic); nothing at a corner."""
    along, across = (b - a)[:, :2].T
    bend_a, bend_b = along * a[:, _SLOPE] - across, across - along * b[:, _SLOPE]
    smooth = np.maximum(np.abs(bend_a), np.abs(bend_b)) < _CORNER_PX
    return np.where(smooth, share * (1 - share) * ((1 - share) * bend_a + share * bend_b), 0.0)


def _no_pieces(along: StripeAlong) -> StripePieces:
    none = np.empty(0)
    return StripePieces(
        along=along,
        cut_px=np.empty(0, np.int64),
        centre_px=none,
        sigma_px=none,
        amplitude_grey=none,
        coverage=none,
        ray=none,
    )

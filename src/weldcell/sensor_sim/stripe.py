"""The stripe that a light section makes in the picture: its centre, width and brightness in every column.

Across the stripe. The light sheet is Gaussian along its normal n, I(e) = exp(-e^2 / 2 s^2) with e = n.q - d and
s = w/4 for a full width w at 1/e^2. A pixel of column u, row v looks along r(u, v) at the surface's tangent plane
through the lit point p (normal N), at q(v) = r (N.p) / (N.r). At p, where r z = p, and with r' = dr/dv,

    dq/dv = z (r' - r (N.r') / (N.r)),     de/dv = n.dq/dv,     sigma_v = s / |de/dv|.

r' holds the lens's distortion: (dx/dv, dy/dv) solves J (dx, dy) = (0, 1) with J the Jacobian of pixels by
undistorted image coordinates.

Blur. The lens and the pixel blur the picture isotropically with sigma_psf. A locally straight line of slope v' has the
width sigma_v cos(a) across itself, tan(a) = v'; blurred, sqrt(sigma_v^2 cos^2(a) + sigma_psf^2); cut by a column again,

    sigma = sqrt(sigma_v^2 + sigma_psf^2 (1 + v'^2)),    amplitude = amplitude_unblurred * sigma_v / sigma,

since blur keeps the light of each column. The end of a line fades like the integral of the blur, Phi(s / sigma_psf).

Brightness. A matt (Lambert) surface sends the light it gets evenly, so the unblurred amplitude goes with the cosine of
incidence; a fan thins out with 1/range. Scaled so that a white surface hit head-on where the light plane meets the
camera's axis peaks at `peak_grey` in the picture. The lens's own fall-off (cos^4, 5 % in the corner) is left out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import ndtr

from weldcell.cell.configuration import SensorConfig
from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.sensor_sim.light_section import LaserFan, LightSection

WAVELENGTH_UM = 0.658
"""The laser of P2 (658 nm, red)."""

_SMOOTH_M = 20e-6  # neighbours closer than this to each other's tangents are one surface (0.2 px)
_CORNER_MARGIN = 1.0  # spacings of rays by which the crossing of two tangents may miss the gap between their rays
_STEEPEST = 6.0  # slope up to which the line is taken as straight over the blur; beyond, the light only grazes
_WIDEST_PX = 30.0  # a sheet that lies in the surface would be lit without end, at no brightness
_FADE_SIGMAS = 3.0
_FAINTEST_GREY = 0.02
_TANGENT_M = 1e-5  # step along a tangent: a fifth of a pixel
_CORNER_PX = 0.15  # tangents that miss the next point by more belong to two faces
_DIFFERENCE_STEP = 1e-5  # normalised image units, central difference


@dataclass(frozen=True, kw_only=True)
class StripeOptics:
    """What turns a light section into grey levels."""

    sheet_sigma_m: float
    """Standard deviation of the light sheet's Gaussian section."""
    psf_sigma_px: float
    """Standard deviation of the blur by diffraction and pixel."""
    peak_grey: float
    """Grey level of the stripe's peak on a matt white surface hit head-on at the reference point."""


@dataclass(frozen=True, kw_only=True)
class StripePieces:
    """The stripe cut by picture columns: one row for each crossing of a column (several where the profile folds)."""

    u_px: Int[np.ndarray, "k"]
    """Column."""
    v_px: Float[np.ndarray, "k"]
    """Exact row of the stripe's centre."""
    sigma_px: Float[np.ndarray, "k"]
    """Standard deviation of the stripe's section along the column, blur included."""
    amplitude_grey: Float[np.ndarray, "k"]
    """Peak of the section."""
    coverage: Float[np.ndarray, "k"]
    """1 within the stripe, 0.5 at its end, less in the blur beyond it; the amplitude holds it already."""


def stripe_optics(config: SensorConfig) -> StripeOptics:
    """Sheet, blur and brightness of a sensor.

    The Airy disc is taken as a Gaussian of sigma 0.42 lambda N (Zhang, Zerubia, Olivo-Marin, Applied Optics 46, 2007),
    with the working f-number N (1 + m) of a close object; a pixel of width 1 has the variance 1/12.
    """
    magnification = config.focal_mm / (config.working_distance_mm - config.focal_mm)
    airy_px = 0.42 * WAVELENGTH_UM * config.f_number * (1 + magnification) / config.pixel_um
    return StripeOptics(
        sheet_sigma_m=config.laser_line_um * 1e-6 / 4,
        psf_sigma_px=float(np.hypot(airy_px, np.sqrt(1 / 12))),
        peak_grey=config.peak_grey,
    )


def stripe_pieces(section: LightSection, camera: CameraModel, fan: LaserFan, optics: StripeOptics) -> StripePieces:
    """The stripe of a light section, column by column."""
    runs = _runs(section, fan)
    if not runs:
        return _no_pieces()
    sheet_px = np.full(len(section.lit), np.nan)
    visible = section.visible
    sheet_px[visible] = sheet_sigma_px(
        section.points_camera[visible], section.normals_camera[visible], camera, fan.plane, optics.sheet_sigma_m
    )
    reference_range_m, reference_ratio = _reference(camera, fan, optics)
    with np.errstate(invalid="ignore"):
        brightness = section.incidence_cos * reference_range_m / section.range_m / reference_ratio
    knots = np.column_stack([section.pixels, sheet_px, brightness, _slopes(section, camera, fan)])
    lines = [_with_ends(knots[run], _FADE_SIGMAS * optics.psf_sigma_px) for run in runs]
    return _cut_by_columns(lines, camera.width_px, optics)


def _slopes(section: LightSection, camera: CameraModel, fan: LaserFan) -> Float[np.ndarray, "n"]:
    """dv/du of the stripe at each ray's point, from the surface's tangent in the light plane."""
    tangents = np.cross(section.normals_camera, fan.plane.normal_camera)
    before, after = (camera.project(section.points_camera + step * tangents) for step in (-_TANGENT_M, _TANGENT_M))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (after[:, 1] - before[:, 1]) / (after[:, 0] - before[:, 0])


def sheet_sigma_px(
    points_camera: Float[np.ndarray, "n 3"],
    normals_camera: Float[np.ndarray, "n 3"],
    camera: CameraModel,
    plane: LaserPlane,
    sheet_sigma_m: float,
) -> Float[np.ndarray, "n"]:
    """Width (one sigma) of the sheet's section along the picture's columns, before blur."""
    depth_m = points_camera[:, 2]
    rays = points_camera / depth_m[:, None]
    (du_dx, du_dy), (dv_dx, dv_dy) = _pixel_jacobian(camera, rays[:, :2])
    determinant = du_dx * dv_dy - du_dy * dv_dx
    rays_by_row = np.column_stack([-du_dy / determinant, du_dx / determinant, np.zeros(len(rays))])
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ray = np.sum(normals_camera * rays_by_row, axis=1) / np.sum(normals_camera * rays, axis=1)
        sheet_by_row = depth_m * ((rays_by_row - along_ray[:, None] * rays) @ plane.normal_camera)
        return np.minimum(sheet_sigma_m / np.abs(sheet_by_row), _WIDEST_PX)


def _pixel_jacobian(camera: CameraModel, normalised: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 2 n"]:
    """Derivatives of (u, v) by undistorted image coordinates (x, y)."""
    step = _DIFFERENCE_STEP * np.eye(2)
    by_x, by_y = (
        (camera.distort(normalised + shift) - camera.distort(normalised - shift)) / (2 * _DIFFERENCE_STEP)
        for shift in step
    )
    return np.stack([by_x * camera.focal_px, by_y * camera.focal_px]).transpose(2, 0, 1)


def _reference(camera: CameraModel, fan: LaserFan, optics: StripeOptics) -> tuple[float, float]:
    """Range (m) and sigma_v / sigma at the reference: head-on, where the plane meets the camera's axis."""
    point_camera = fan.plane.intersect(np.array([[0.0, 0.0, 1.0]]))
    if not np.all(np.isfinite(point_camera)):  # the camera's axis never meets the light: any scale will do
        return 1.0, 1.0
    to_source = fan.source_camera - point_camera
    range_m = np.linalg.norm(to_source)
    sheet_px = sheet_sigma_px(point_camera, to_source / range_m, camera, fan.plane, optics.sheet_sigma_m)[0]
    return float(range_m), float(sheet_px / np.hypot(sheet_px, optics.psf_sigma_px))


def _runs(section: LightSection, fan: LaserFan) -> list[slice]:
    """Stretches of two or more neighbouring rays whose points are visible and lie on one continuous surface."""
    linked = np.zeros(len(section.lit), dtype=bool)
    linked[:-1] = section.visible[:-1] & section.visible[1:]
    first = np.flatnonzero(linked)
    linked[first] = _continuous(section, fan, first)
    edges = np.diff(np.concatenate([[0], linked.astype(np.int8)]))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [slice(start, end + 1) for start, end in zip(starts, ends, strict=True)]


def _continuous(section: LightSection, fan: LaserFan, first: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Whether the lit points of rays i and i + 1 belong to one surface, smooth or with a corner between.

    Within the light plane, both tangents then either nearly hold both points, or cross between the two rays. At a step
    they cross elsewhere or not at all, however steep the surfaces are.
    """
    axes = fan.plane.T_camera_laser.rotation.as_matrix()[:, [0, 2]]
    points = (section.points_camera - fan.source_camera) @ axes
    normals = section.normals_camera @ axes
    with np.errstate(divide="ignore", invalid="ignore"):
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
        step = points[first + 1] - points[first]
        off_first = np.abs(np.sum(step * normals[first], axis=1))
        off_second = np.sum(step * normals[first + 1], axis=1)
        scale = off_second / np.sum(tangents[first] * normals[first + 1], axis=1)
        crossing = points[first] + scale[:, None] * tangents[first]
        across, across_first, across_second = (p[:, 0] / p[:, 1] for p in (crossing, points[first], points[first + 1]))
        place = (across - across_first) / (across_second - across_first)
    corner = (place > -_CORNER_MARGIN) & (place < 1 + _CORNER_MARGIN) & (crossing[:, 1] > 0)
    return corner | ((off_first < _SMOOTH_M) & (np.abs(off_second) < _SMOOTH_M))


def _with_ends(knots: Float[np.ndarray, "n 5"], fade_px: float) -> Float[np.ndarray, "n+2 7"]:
    """Knots of a line (u, v, sheet_px, brightness, slope) with both ends drawn out, and the ways from both ends (px).

    The surface's end lies somewhere between the last ray that met it and the next: half a spacing beyond is taken,
    which is right on average.
    """
    steps = np.diff(knots[:, :2], axis=0)
    lengths = np.maximum(np.linalg.norm(steps, axis=1), 1e-9)
    head, tail = knots[0].copy(), knots[-1].copy()
    head[:2] -= steps[0] / lengths[0] * (fade_px + lengths[0] / 2)
    tail[:2] += steps[-1] / lengths[-1] * (fade_px + lengths[-1] / 2)
    way = np.concatenate([[-fade_px], lengths[0] / 2 + np.concatenate([[0], np.cumsum(lengths)])])
    end = way[-1] + lengths[-1] / 2
    way = np.append(way, end + fade_px)
    return np.column_stack([np.vstack([head, knots, tail]), way, end - way])


def _cut_by_columns(lines: list[Float[np.ndarray, "_ 7"]], width_px: int, optics: StripeOptics) -> StripePieces:
    """The pieces where lines cross columns: a segment owns the columns from its smaller u up to before its larger."""
    starts = np.vstack([line[:-1] for line in lines])
    stops = np.vstack([line[1:] for line in lines])
    low = np.clip(np.ceil(np.minimum(starts[:, 0], stops[:, 0])), 0, width_px).astype(np.int64)
    high = np.clip(np.ceil(np.maximum(starts[:, 0], stops[:, 0])), 0, width_px).astype(np.int64)
    count = high - low
    segment = np.repeat(np.arange(len(starts)), count)
    u_px = low[segment] + np.arange(len(segment)) - np.repeat(np.cumsum(count) - count, count)
    a, b = starts[segment], stops[segment]
    slope = (b[:, 1] - a[:, 1]) / (b[:, 0] - a[:, 0])
    share = (u_px - a[:, 0]) / (b[:, 0] - a[:, 0])
    _, v_px, sheet_px, brightness, _, from_head, from_tail = (a + share[:, None] * (b - a)).T
    v_px = v_px + _sagitta_px(a, b, share)
    blur_px = optics.psf_sigma_px * np.sqrt(1 + np.minimum(slope**2, _STEEPEST**2))
    sigma_px = np.hypot(sheet_px, blur_px)
    coverage = ndtr(from_head / optics.psf_sigma_px) * ndtr(from_tail / optics.psf_sigma_px)
    amplitude_grey = optics.peak_grey * brightness * sheet_px / sigma_px * coverage
    kept = amplitude_grey > _FAINTEST_GREY
    return StripePieces(
        u_px=u_px[kept],
        v_px=v_px[kept],
        sigma_px=sigma_px[kept],
        amplitude_grey=amplitude_grey[kept],
        coverage=coverage[kept],
    )


def _sagitta_px(
    a: Float[np.ndarray, "k 7"], b: Float[np.ndarray, "k 7"], share: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "k"]:
    """How far the curve between two knots leaves its chord (Hermite's cubic); nothing at a corner."""
    across, along = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    bend_a, bend_b = across * a[:, 4] - along, along - across * b[:, 4]
    smooth = np.maximum(np.abs(bend_a), np.abs(bend_b)) < _CORNER_PX
    return np.where(smooth, share * (1 - share) * ((1 - share) * bend_a + share * bend_b), 0.0)


def _no_pieces() -> StripePieces:
    empty = np.empty(0)
    return StripePieces(u_px=np.empty(0, np.int64), v_px=empty, sigma_px=empty, amplitude_grey=empty, coverage=empty)

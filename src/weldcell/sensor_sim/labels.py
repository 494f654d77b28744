"""The truth of one picture: every stripe point, ghost, mask and seam feature, exact, for data sets and checks.

A camera ray meets the light plane once, so a pixel stands for one point of the plane. Two stretches of a profile may
share a picture column, never a pixel: the table of stripe points has several rows for a column where the profile folds.

Visibility is COCO's for keypoints, of a point and of a feature alike:

    2  lit and seen: the light reaches it, and nothing hides it from the camera;
    1  lit but hidden: the light reaches it, the camera would have it in the picture, but something stands before it;
    0  not lit: a column (or row) of the picture that holds no lit point; a feature in the dark or out of the picture.

Light of less than 0.02 grey levels (a wall that the light only grazes) counts as none.

Exact means: stripe points lie on the light plane and on the camera ray of their pixel; features are where the plane
cuts the seam's own lines, not the mesh's.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.sensor_sim.light_section import LightSection
from weldcell.sensor_sim.seam_labels import FeatureTruth, Visibility
from weldcell.sensor_sim.stripe import StripePieces

_WITHIN = 0.5  # coverage at the stripe's end: beyond, there is blur but no surface
_MASK_SIGMAS = 2.0  # 1/e^2, as beams are measured


@dataclass(frozen=True, kw_only=True)
class StripeTruth:
    """Points where the stripe crosses the picture's columns (its rows, if it runs along columns), one row a point."""

    pixels: Float[np.ndarray, "k 2"]
    """Centre (u, v); where nothing is lit only the column (row) is a number, the rest is NaN."""
    visibility: Int[np.ndarray, "k"]
    """`Visibility`."""
    sigma_px: Float[np.ndarray, "k"]
    """Standard deviation of the section across; NaN where not seen."""
    amplitude_grey: Float[np.ndarray, "k"]
    """Peak of the section, at 1 ms and 0 dB and before disturbances; NaN where not seen."""
    points_camera: Float[np.ndarray, "k 3"]
    """The point on the surface, m."""
    normals_camera: Float[np.ndarray, "k 3"]
    """Outward unit normal of the surface."""
    geom_id: Int[np.ndarray, "k"]
    """The surface's geom; -1 where nothing is lit."""

    @property
    def seen(self) -> Bool[np.ndarray, "k"]:
        """Which points are lit and seen."""
        return self.visibility == Visibility.SEEN


@dataclass(frozen=True, kw_only=True)
class FrameTruth:
    """All that is true of one picture."""

    camera: CameraModel
    """The actual camera."""
    plane: LaserPlane
    """The actual light plane."""
    T_base_flange_actual: RigidTransform
    """Where the flange was."""
    T_base_flange_nominal: RigidTransform
    """Where the controller says it was."""
    T_flange_camera: RigidTransform
    """The actual sensor mount."""
    T_base_part: RigidTransform
    """Where the workpiece stands."""
    stripe: StripeTruth
    """The stripe, first bounce of the light."""
    ghosts: StripeTruth
    """Ghost stripes, second bounce; only what is seen."""
    features: FeatureTruth
    """The seam in this picture."""
    stripe_mask: Bool[np.ndarray, "height width"]
    """Pixels that the stripe covers."""
    ghost_mask: Bool[np.ndarray, "height width"]
    """Pixels that ghost stripes cover."""

    @property
    def T_base_camera(self) -> RigidTransform:
        """Where the camera actually was."""
        return self.T_base_flange_actual * self.T_flange_camera


def hidden_section(section: LightSection, camera: CameraModel) -> LightSection:
    """The section with what is hidden in place of what is visible: its stripe pieces are those that nobody sees."""
    hidden = section.lit & ~section.visible & camera.in_picture(np.nan_to_num(section.pixels, nan=-1e9))
    return replace(section, visible=hidden, seen=hidden)


def stripe_truth(
    section: LightSection, pieces: StripePieces, hidden_pieces: StripePieces, camera: CameraModel, plane: LaserPlane
) -> StripeTruth:
    """Every stripe point: seen, hidden (`hidden_pieces` are of `hidden_section`), and a row for each dark column."""
    seen, hidden = (_surface_points(found, section, camera, plane) for found in (pieces, hidden_pieces))
    nothing = np.full(len(hidden.visibility), np.nan)
    hidden = replace(hidden, visibility=np.minimum(hidden.visibility, 1), sigma_px=nothing, amplitude_grey=nothing)
    lit = _joined(seen, hidden)
    rows = _joined(lit, _dark(lit, pieces.along, camera))
    axis = 0 if pieces.along == "rows" else 1
    return _chosen(rows, np.lexsort((rows.pixels[:, 1 - axis], rows.pixels[:, axis])))


def ghost_truth(ghosts: Sequence[tuple[LightSection, StripePieces]], camera: CameraModel) -> StripeTruth:
    """Every point of ghost stripes that is seen, each given by its own section and pieces."""
    return _joined(_no_points(), *(_surface_points(pieces, section, camera, None) for section, pieces in ghosts))


def stripe_mask(
    pieces: StripePieces, camera: CameraModel, faintest_grey: float = 1.0
) -> Bool[np.ndarray, "height width"]:
    """Pixels within two sigma (1/e^2) of the centre, of all pieces whose peak reaches `faintest_grey`.

    The pixel that holds the centre always counts.
    """
    bright = (pieces.coverage >= _WITHIN) & (pieces.amplitude_grey >= faintest_grey)
    centre, reach_px = pieces.centre_px[bright], _MASK_SIGMAS * pieces.sigma_px[bright]
    nearest = np.floor(centre + 0.5).astype(int)
    low = np.minimum(np.ceil(centre - reach_px).astype(int), nearest)
    high = np.maximum(np.floor(centre + reach_px).astype(int), nearest)
    count = high - low + 1
    across = np.repeat(low, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    lines = np.repeat(pieces.cut_px[bright], count)
    v, u = (across, lines) if pieces.along == "rows" else (lines, across)
    mask = np.zeros((camera.height_px, camera.width_px), bool)
    inside = (v >= 0) & (v < camera.height_px) & (u >= 0) & (u < camera.width_px)
    mask[v[inside], u[inside]] = True
    return mask


def _surface_points(
    pieces: StripePieces, section: LightSection, camera: CameraModel, plane: LaserPlane | None
) -> StripeTruth:
    """Points on the surface for pieces in the picture; on `plane`, or else on the surface's tangent plane."""
    pixels = np.column_stack([pieces.u_px, pieces.v_px]).astype(float)
    kept = (pieces.coverage >= _WITHIN) & camera.in_picture(pixels)
    rays = camera.unproject(pixels[kept])
    ray_id, points = _lighting_rays(pieces.ray[kept], rays, section)
    if plane is not None:
        points = plane.intersect(rays)
    return StripeTruth(
        pixels=pixels[kept],
        visibility=np.full(len(rays), Visibility.SEEN, int),
        sigma_px=pieces.sigma_px[kept],
        amplitude_grey=pieces.amplitude_grey[kept],
        points_camera=points,
        normals_camera=section.normals_camera[ray_id],
        geom_id=section.geom_id[ray_id],
    )


def _lighting_rays(
    ray: Float[np.ndarray, "k"], rays_camera: Float[np.ndarray, "k 3"], section: LightSection
) -> tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k 3"]]:
    """The section's ray that lights each piece, and where the camera's ray meets the tangent plane there.

    Of the two rays that a piece lies between, that counts whose own lit point is nearer to what the camera's ray meets:
    at a corner, the two lie on two faces.
    """
    first = np.clip(np.floor(ray).astype(int), 0, len(section.lit) - 1)
    ray_ids = np.stack([first, np.minimum(first + 1, len(section.lit) - 1)], axis=1)
    lit, normals = section.points_camera[ray_ids], section.normals_camera[ray_ids]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.sum(lit * normals, axis=2) / np.sum(rays_camera[:, None] * normals, axis=2)
    met = depth[..., None] * rays_camera[:, None]
    off_m = np.nan_to_num(np.linalg.norm(met - lit, axis=2), nan=np.inf)
    better = np.argmin(off_m, axis=1)
    each = np.arange(len(ray))
    return ray_ids[each, better], met[each, better]


def _dark(lit: StripeTruth, along: str, camera: CameraModel) -> StripeTruth:
    """A row for each column (row) of the picture that has no point."""
    axis, count = (0, camera.width_px) if along == "rows" else (1, camera.height_px)
    dark = np.setdiff1d(np.arange(count), lit.pixels[:, axis].astype(int))
    pixels = np.full((len(dark), 2), np.nan)
    pixels[:, axis] = dark
    nothing, nowhere = np.full(len(dark), np.nan), np.full((len(dark), 3), np.nan)
    return StripeTruth(
        pixels=pixels,
        visibility=np.full(len(dark), Visibility.NOT_LIT, int),
        sigma_px=nothing,
        amplitude_grey=nothing,
        points_camera=nowhere,
        normals_camera=nowhere,
        geom_id=np.full(len(dark), -1),
    )


def _no_points() -> StripeTruth:
    none, nowhere = np.empty(0), np.empty((0, 3))
    return StripeTruth(
        pixels=np.empty((0, 2)),
        visibility=np.empty(0, int),
        sigma_px=none,
        amplitude_grey=none,
        points_camera=nowhere,
        normals_camera=nowhere,
        geom_id=np.empty(0, int),
    )


def _joined(*parts: StripeTruth) -> StripeTruth:
    return StripeTruth(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _chosen(truth: StripeTruth, rows: Int[np.ndarray, "n"]) -> StripeTruth:
    return StripeTruth(**{name: value[rows] for name, value in vars(truth).items()})

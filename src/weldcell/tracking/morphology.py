"""The seam point by morphology, picture by picture as in Q. Liu et al.'s laser-scanning seam tracker.

The stripe's two pieces are found first: median filter, adaptive threshold, out with isolated points, small regions and
what lies off the stripe's level, such as a deep groove's bottom (`stripe_chain`): "finally, the image only exists two
laser striped light". Dilating the pieces n times joins them, eroding n times brings their shape back, but what the
dilation filled stays filled: a hole narrower than 2 n pixels, or the inside of a dip. Without the pieces themselves
only the filled part is left, and crumbs along the stripe. The crumbs are small or thin; the centroid of the rest is the
seam point: of a gap midway between its edges, on the straight bridge between them. No line is fitted, so plates may be
curved; where they are, the bridge lies a little to the side that the stripe bends to, for it fills every row that the
pieces reach on both sides within n pixels.

Two pieces are joined only where they overlap across the stripe: a square that avoids both would find its way between
them. So where one begins higher than the other ends, both are thickened by half that step first.
"""

from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from weldcell.cell.errors import BadInput
from weldcell.tracking.stripe import Along
from weldcell.tracking.stripe_chain import StripeChain, stripe_chain

_LEAST_CONTRAST = 12.0  # levels of the median picture between stripe and surroundings
_NOISE_CONTRASTS = 6.0
_ABOVE_SHARE = 0.2  # of the contrast: a piece half as bright as the others is still seen, the stripe's foot is not
_STRIPE_LENGTHS = 1.5  # stripe widths: shorter regions are isolated points
_BLOCK_WIDTHS = 10  # so that the stripe hardly lifts its own local mean
_FEWEST_DILATIONS_WIDTHS = 1.5
_WIDEST_SHARE = 0.1  # of the picture's shorter side: what lights more of a column is no stripe, but the arc
_THICKEST_PX = 41  # a stripe is thinner
_GAP_WIDTHS = 2.0  # narrower gaps are the speckle's
_SEAM_WIDTHS_SQUARED = 0.75  # smallest bridge, in squared stripe widths
_OUTLINE_WIDTHS = 0.5  # across the stripe: what is thinner is the stripe's ragged or curved outline
_RIVAL_SHARE = 0.6  # another bridge this large makes the seam ambiguous


@dataclass(frozen=True, kw_only=True)
class MorphologyParameters:
    """The method's numbers, in pixels; `chosen_parameters` takes them from the stripe's own width."""

    median_px: int
    """Side of the median filter (3 or 5): below the stripe's width, or the filter would eat thin stretches."""
    block_px: int
    """Side of the square whose mean the adaptive threshold compares with: ten stripe widths."""
    above_grey: float
    """How far above that mean light belongs to the stripe: a fifth of the stripe's contrast."""
    least_region_px: int
    """Regions with fewer pixels are isolated points: 1.5 widths of the stripe's length."""
    dilations: int
    """n, with a 3 x 3 square: half the gap, and a pixel more; at least 1.5 stripe widths, for dips without a gap."""
    thicken_px: int = 0
    """How much the pieces grow to either side across the stripe first: half the step over the gap, and a pixel more."""
    least_seam_px: int
    """Regions with fewer pixels are crumbs of the subtraction and not the seam: 0.75 squared stripe widths."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MorphologySteps:
    """The picture after each step; masks are 0 and 255."""

    median: UInt8[np.ndarray, "height width"]
    bright: UInt8[np.ndarray, "height width"]
    """After the adaptive threshold."""
    pieces: UInt8[np.ndarray, "height width"]
    """Without isolated points and what is off the stripe's level: the stripe's pieces on the surface."""
    dilated: UInt8[np.ndarray, "height width"]
    eroded: UInt8[np.ndarray, "height width"]
    """The dilated picture eroded as often: the pieces with the gap bridged."""
    difference: UInt8[np.ndarray, "height width"]
    """`eroded` without `pieces`: the bridge and crumbs."""
    seam: UInt8[np.ndarray, "height width"]
    """The bridge alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SeamPoint:
    """The seam point of one picture, and how it came about."""

    point_px: Float[np.ndarray, "2"]
    """(u, v); NaN where not valid."""
    valid: bool
    reason: str = ""
    """Why there is no seam point, if there is none."""
    width_px: float
    """The stripe's width, 0 without a stripe."""
    parameters: MorphologyParameters
    steps: MorphologySteps


def seam_point(
    picture: np.ndarray,
    *,
    along: Along = "rows",
    gap_px: float | None = None,
    parameters: MorphologyParameters | None = None,
    near_px: Float[np.ndarray, "2"] | None = None,
    reach_px: float = 150.0,
) -> SeamPoint:
    """The seam point of a grey picture whose stripe runs along rows or columns.

    All parameters are chosen from the stripe unless given; `gap_px` gives only the width that has to be bridged.
    With `near_px` (the last picture's point) only what lies within `reach_px` of it counts.
    Raises BadInput for a picture that is not grey of 8 or 16 bits.
    """
    grey = _eight_bits(picture)
    if along == "columns":
        grey = cv2.transpose(grey)
        near_px = None if near_px is None else near_px[::-1]
    found = _seam_point_along_rows(grey, gap_px, parameters, near_px, reach_px)
    return found if along == "rows" else _transposed(found)


def _eight_bits(picture: np.ndarray) -> UInt8[np.ndarray, "height width"]:
    if picture.ndim != 2 or picture.dtype not in (np.uint8, np.uint16) or picture.size == 0:
        raise BadInput(
            f"seam point: expected a grey picture of 8 or 16 bits, found shape {picture.shape}, type {picture.dtype}"
        )
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture)
    return cv2.convertScaleAbs(picture, alpha=255 / max(int(picture.max()), 255))


def _seam_point_along_rows(
    grey: UInt8[np.ndarray, "height width"],
    gap_px: float | None,
    given: MorphologyParameters | None,
    near_px: Float[np.ndarray, "2"] | None,
    reach_px: float,
) -> SeamPoint:
    median = cv2.medianBlur(grey, given.median_px if given else 3)
    chosen, contrast, noise = _threshold_parameters(median)
    now = given or chosen
    bright = cv2.adaptiveThreshold(
        median, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, now.block_px, -now.above_grey
    )
    thin = cv2.morphologyEx(bright, cv2.MORPH_TOPHAT, np.ones((_THICKEST_PX, 1), np.uint8))
    width_px = _stripe_width_px(thin)
    mended = cv2.morphologyEx(thin, cv2.MORPH_CLOSE, np.ones((1, 2 * round(width_px / 2) + 1), np.uint8))
    chain = stripe_chain(mended, width_px, least_region_px=now.least_region_px)
    now = given or _for_chain(now, chain, width_px, gap_px)
    pieces = cv2.dilate(chain.pieces, np.ones((2 * now.thicken_px + 1, 1), np.uint8))
    stripe_is_there = contrast >= max(_LEAST_CONTRAST, _NOISE_CONTRASTS * noise)
    stripe_is_there &= width_px <= _WIDEST_SHARE * min(grey.shape)
    dilated, eroded = _closed(pieces, now.dilations) if stripe_is_there and chain.found else (pieces, pieces)
    difference = cv2.subtract(eroded, pieces)
    outline = np.ones((max(round(_OUTLINE_WIDTHS * width_px), 2), 1), np.uint8)
    labels, areas, centroids = _regions(cv2.morphologyEx(difference, cv2.MORPH_OPEN, outline))
    kept = areas >= now.least_seam_px
    if near_px is not None:
        kept &= np.hypot(*(centroids - near_px).T) <= reach_px
    reason = ""
    if not stripe_is_there:
        reason = "no stripe in the picture"
    elif not chain.found:
        reason = "no piece of a stripe in the picture"
    else:
        reason = _complaint(areas, centroids, kept, now, near_px is not None)
    seam = np.zeros_like(pieces)
    point_px = np.full(2, np.nan)
    if not reason:
        best = int(np.where(kept, areas, 0).argmax())
        seam = np.where(labels == best + 1, 255, 0).astype(np.uint8)
        point_px = centroids[best]
    return SeamPoint(
        point_px=point_px,
        valid=not reason,
        reason=reason,
        width_px=width_px,
        parameters=now,
        steps=MorphologySteps(
            median=median,
            bright=bright,
            pieces=pieces,
            dilated=dilated,
            eroded=eroded,
            difference=difference,
            seam=seam,
        ),
    )


def _threshold_parameters(median: UInt8[np.ndarray, "height width"]) -> tuple[MorphologyParameters, float, float]:
    """Parameters from the stripe's contrast and width, that contrast, and the noise, in levels.

    Both are seen best where what is thicker than any stripe is taken off: a weld's glow has neither.
    """
    column = np.ones((_THICKEST_PX, 1), np.uint8)
    lines = cv2.morphologyEx(median, cv2.MORPH_TOPHAT, column)
    ground = float(np.median(lines[::4, ::4]))
    noise = 1.4826 * float(np.median(np.abs(lines[::4, ::4] - ground)))
    contrast = float(np.percentile(lines.max(axis=0), 75)) - ground
    width = _stripe_width_px(cv2.compare(lines, ground + contrast / 2, cv2.CMP_GT)) if contrast > 0 else 1.0
    width = float(np.clip(width, 2.0, _THICKEST_PX))
    parameters = MorphologyParameters(
        median_px=3,
        block_px=2 * round(_BLOCK_WIDTHS * width / 2) + 1,
        above_grey=max(_ABOVE_SHARE * contrast, 2.0),
        least_region_px=round(_STRIPE_LENGTHS * width**2),
        dilations=1,  # what follows waits for the pieces
        least_seam_px=2,
    )
    return parameters, contrast, noise


def _stripe_width_px(mask: UInt8[np.ndarray, "height width"]) -> float:
    """Median length of the runs of lit pixels down the columns that have some."""
    lit = np.count_nonzero(mask, axis=0)
    runs = np.count_nonzero(mask[1:] > mask[:-1], axis=0) + (mask[0] > 0)
    return float(np.median(lit[lit > 0] / runs[lit > 0])) if lit.any() else 0.0


def _regions(
    mask: UInt8[np.ndarray, "height width"],
) -> tuple[Int[np.ndarray, "height width"], Int[np.ndarray, "k"], Float[np.ndarray, "k 2"]]:
    """Labels (0: none), and size and centroid (u, v) of each connected region."""
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8)
    return labels, stats[1:, cv2.CC_STAT_AREA], centroids[1:]


def _for_chain(
    parameters: MorphologyParameters, chain: StripeChain, width_px: float, gap_px: float | None
) -> MorphologyParameters:
    """The parameters with as many dilations as join each piece with the next one."""
    widest = int(chain.gaps_px.argmax()) if len(chain.gaps_px) else None
    found_px, step_px = (0.0, 0.0) if widest is None else (chain.gaps_px[widest], abs(chain.steps_px[widest]))
    gap_px = found_px if gap_px is None else gap_px
    return replace(
        parameters,
        dilations=max(int(np.ceil(_FEWEST_DILATIONS_WIDTHS * width_px)), int(np.ceil(gap_px / 2)) + 1),
        thicken_px=int(np.ceil(step_px / 2)) + 1 if gap_px > _GAP_WIDTHS * width_px else 0,
        least_seam_px=max(round(_SEAM_WIDTHS_SQUARED * width_px**2), 2),
    )


def _closed(
    pieces: UInt8[np.ndarray, "height width"], times: int
) -> tuple[UInt8[np.ndarray, "height width"], UInt8[np.ndarray, "height width"]]:
    """The pieces (there are some) dilated n times, then eroded n times; outside its border the picture is dark.

    n dilations with a 3 x 3 square take in what is within a chessboard distance of n, and that takes the same time for
    every n.
    """
    rows = np.flatnonzero(pieces.any(axis=1))
    margin = times + 1
    top, bottom, below = int(rows[0]), int(rows[-1]) + 1, len(pieces)
    wide = np.pad(pieces[top:bottom], margin)
    dilated = cv2.compare(cv2.distanceTransform(~wide, cv2.DIST_C, 3), times, cv2.CMP_LE)
    eroded = cv2.compare(cv2.distanceTransform(dilated, cv2.DIST_C, 3), times, cv2.CMP_GT)
    whole = [np.zeros((below + 2 * margin, pieces.shape[1]), np.uint8) for _ in range(2)]
    for picture, band in zip(whole, (dilated, eroded), strict=True):
        picture[top : bottom + 2 * margin] = band[:, margin:-margin]
    inner = slice(margin, margin + below)
    return whole[0][inner], whole[1][inner]


def _complaint(
    areas: Int[np.ndarray, "k"],
    centroids: Float[np.ndarray, "k 2"],
    kept: Bool[np.ndarray, "k"],
    parameters: MorphologyParameters,
    gated: bool,
) -> str:
    if not kept.any():
        near = " near the last point" if gated else ""
        return f"no gap{near}: {parameters.dilations} dilations bridge nothing larger than crumbs"
    sizes = np.where(kept, areas, 0)
    best = int(sizes.argmax())
    far = np.hypot(*(centroids - centroids[best]).T) > 2 * parameters.dilations
    rivals = int(np.sum(kept & far & (sizes > _RIVAL_SHARE * sizes[best])))
    return f"{rivals + 1} gaps of nearly the same size: which is the seam is not clear" if rivals else ""


def _transposed(found: SeamPoint) -> SeamPoint:
    steps = {field.name: cv2.transpose(getattr(found.steps, field.name)) for field in fields(found.steps)}
    return SeamPoint(
        point_px=found.point_px[::-1].copy(),
        valid=found.valid,
        reason=found.reason,
        width_px=found.width_px,
        parameters=found.parameters,
        steps=MorphologySteps(**steps),
    )

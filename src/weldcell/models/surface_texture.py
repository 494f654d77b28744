"""Patterns of a part's surface: one picture of how bright each place is, and which pixel of it belongs to which place.

The part is looked at from four sides, each place from the one that its normal points to most: along z (panel of x and
y), along -y (x and z), along x (y and z) or along +y (x and z). The panels lie below one another in one picture.
Rendered pictures and the laser's stripe use this same map, so a scratch is at the same place in both. On a face that
leans by an angle against its panel the pattern is stretched by 1/cos (1.08 on the walls of a 45 deg groove, 1.7 at
most). A wall of a groove shares its panel with the plate's outer side that faces the same way, which so shows its tack
spots too.

Brushed: each line of the surface has its own brightness, with a spectrum of 1/f between 0.2 and 20 mm (grinding belts
and brushes leave lines of all widths), slowly changing along the line. Scratched: straight lines of random place,
direction and depth, bright or dark, most of them faint, that taper off. Tack spots: dark balls about points of the
seam, with the straw and blue rings of heat tint as a lighter and a darker halo, cut by the surface. Nothing is brighter
than the plain material.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from weldcell.cell.configuration import TextureName
from weldcell.cell.errors import BadGeometry
from weldcell.cell.seam import length_along

_MOST_PIXELS = 40_000_000
_BRUSHED_MEAN, _BRUSHED_SPREAD = 0.8, 0.07
_BRUSHED_LINES_M = (0.2e-3, 20e-3)  # width of the finest and of the broadest lines
_BRUSHED_LENGTH_M = 15e-3
_SCRATCHES_PER_M2 = 40_000.0
_SCRATCH_LENGTH_M = (2e-3, 40e-3)
_SCRATCH_DEPTH, _BRIGHT_DEPTH_MOST, _DARK_DEPTH_MOST = 0.06, 0.2, 0.4  # exponential
_WIDE_RATIO, _WIDE_M = 0.08, 0.2e-3  # the others are as fine as the picture
_TAPER = ((1.0, 0.2), (0.85, 0.4), (0.7, 0.65), (0.5, 1.0))  # parts of the length, and their share of the depth
_SPOT_RADIUS_M, _HALO_M = (4e-3, 7e-3), 3e-3
_SPOT_BRIGHTNESS = 0.3
_PREFERENCE = np.array([1.0, 1.001, 1.002])  # decides at 45 deg, where rounding would


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceTexture:
    """How bright a part's surface is from place to place."""

    grey: UInt8[np.ndarray, "rows columns"]
    """Brightness relative to the plain material (255 is 1): the four panels one below the other."""
    low_part: Float[np.ndarray, "3"]
    """Lower corner of the box around the part, m."""
    high_part: Float[np.ndarray, "3"]
    """Upper corner of that box, m."""
    texel_m: float
    """Size of a pixel on the surface."""

    def __post_init__(self) -> None:
        if self.grey.shape != (sum(self._rows), self._columns):
            raise BadGeometry(f"texture: expected {(sum(self._rows), self._columns)} pixels, found {self.grey.shape}")

    @property
    def _rows(self) -> tuple[int, int, int, int]:
        return _layout(self.low_part, self.high_part, self.texel_m)[0]

    @property
    def _columns(self) -> int:
        return _layout(self.low_part, self.high_part, self.texel_m)[1]

    def places_px(
        self, points_part: Float[np.ndarray, "n 3"], normals_part: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 2"]:
        """Column and row of points of the surface (m); 0 is a pixel's centre."""
        side = np.argmax(np.abs(normals_part) * _PREFERENCE, axis=1)
        side[(side == 1) & (normals_part[:, 1] > 0)] = 3
        z_row, y_row, x_row, opposite_row = np.cumsum([0, *self._rows[:3]])
        first_row = np.array([x_row, y_row, z_row, opposite_row])[side]
        across, along = np.array([1, 0, 0, 0])[side], np.array([2, 2, 1, 2])[side]
        offset_px = (points_part - self.low_part) / self.texel_m - 0.5
        each = np.arange(len(points_part))
        return np.column_stack([offset_px[each, across], offset_px[each, along] + first_row])

    def factor(
        self, points_part: Float[np.ndarray, "n 3"], normals_part: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n"]:
        """Brightness at points of the surface, between 0 and 1."""
        return self.brightness(self.places_px(points_part, normals_part))

    def brightness(self, places_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Brightness at places of the picture (bilinear, as graphics cards do)."""
        low = np.floor(places_px)
        share_u, share_v = (places_px - low).T
        height, width = self.grey.shape
        u0, v0 = low.astype(np.int64).T
        u0, u1 = np.clip(u0, 0, width - 1), np.clip(u0 + 1, 0, width - 1)
        v0, v1 = np.clip(v0, 0, height - 1), np.clip(v0 + 1, 0, height - 1)
        upper = self.grey[v0, u0] * (1 - share_u) + self.grey[v0, u1] * share_u
        lower = self.grey[v1, u0] * (1 - share_u) + self.grey[v1, u1] * share_u
        return (upper * (1 - share_v) + lower * share_v) / 255


def surface_texture(
    low_part: Float[np.ndarray, "3"],
    high_part: Float[np.ndarray, "3"],
    kind: TextureName,
    spots_part: Float[np.ndarray, "k 3"],
    rng: np.random.Generator,
    texel_m: float = 0.1e-3,
) -> SurfaceTexture:
    """The texture of a part within a box, with tack spots about the given points (m).

    Lines of a brushed part run along x (on the panel along x: along y).
    """
    rows, columns = _layout(low_part, high_part, texel_m)
    panels = [_PATTERNS[kind]((count, columns), texel_m, rng) for count in rows]
    centres_px, radii_px = (
        (spots_part - low_part) / texel_m - 0.5,
        rng.uniform(*_SPOT_RADIUS_M, len(spots_part)) / texel_m,
    )
    below_px = (high_part[2] - spots_part[:, 2]) / texel_m  # the panel along z shows the part's top
    flat_px = np.zeros(len(spots_part))
    seen = (0, [0, 1], below_px), (1, [0, 2], flat_px), (3, [0, 2], flat_px)  # not on the ends, which no seam shows
    for index, axes, off_px in seen:
        panels[index] *= _spots(panels[index].shape, centres_px[:, axes], off_px, radii_px, _HALO_M / texel_m)
    grey = np.rint(255 * np.clip(np.concatenate(panels), 0, 1)).astype(np.uint8)
    return SurfaceTexture(grey=grey, low_part=low_part, high_part=high_part, texel_m=texel_m)


def even_spots(points_part: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "count 3"]:
    """Points in the middle of `count` equally long stretches of a line."""
    if count == 0:
        return np.empty((0, 3))
    way_m = length_along(points_part)
    places_m = (np.arange(count) + 0.5) / count * way_m[-1]
    return np.column_stack([np.interp(places_m, way_m, points_part[:, axis]) for axis in range(3)])


def _layout(
    low_part: Float[np.ndarray, "3"], high_part: Float[np.ndarray, "3"], texel_m: float
) -> tuple[tuple[int, int, int, int], int]:
    """Rows of the four panels, and columns of all."""
    size = np.asarray(high_part, float) - np.asarray(low_part, float)
    if not (np.all(np.isfinite(size)) and np.all(size > 0) and texel_m > 0):
        raise BadGeometry(f"texture: expected a box and pixels larger than nothing, found {size} m and {texel_m} m")
    length, width, height = (int(n) for n in np.ceil(size / texel_m - 1e-9))
    if (width + 3 * height) * max(length, width) > _MOST_PIXELS:
        raise BadGeometry(f"texture: a part of {size} m needs more than {_MOST_PIXELS} pixels of {texel_m} m")
    return (width, height, height, height), max(length, width)


def _plain(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float[np.ndarray, "rows columns"]:
    return np.ones(shape, np.float32)


def _brushed(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float[np.ndarray, "rows columns"]:
    """Lines along the rows: noise with a spectrum of 1/f across, made at a few places along and smoothed between."""
    rows, columns = shape
    places = max(int(columns * texel_m / _BRUSHED_LENGTH_M), 1) + 3
    frequency = np.fft.rfftfreq(rows, texel_m)
    shortest, longest = _BRUSHED_LINES_M
    kept = (frequency >= 1 / longest) & (frequency <= 1 / shortest)
    if not kept.any():  # a part narrower than its broadest line
        return np.full(shape, _BRUSHED_MEAN, np.float32)
    amplitude = np.where(kept, 1 / np.sqrt(np.maximum(frequency, 1 / longest)), 0)
    noise = np.fft.irfft(np.fft.rfft(rng.normal(size=(rows, places)), axis=0) * amplitude[:, None], rows, axis=0)
    lines = cv2.resize((noise / noise.std()).astype(np.float32), (columns, rows), interpolation=cv2.INTER_CUBIC)
    return np.float32(_BRUSHED_MEAN) + np.float32(_BRUSHED_SPREAD) * lines


def _scratched(shape: tuple[int, int], texel_m: float, rng: np.random.Generator) -> Float[np.ndarray, "rows columns"]:
    """Fine brushing with scratches over it."""
    panel = np.rint(255 * (_BRUSHED_MEAN + 0.3 * (_brushed(shape, texel_m, rng) - _BRUSHED_MEAN))).astype(np.uint8)
    fine = 4  # bits behind the binary point for cv2.line
    for _ in range(rng.poisson(_SCRATCHES_PER_M2 * panel.size * texel_m**2)):
        middle, angle_rad = rng.uniform(0, shape[::-1]), rng.uniform(0, np.pi)
        length_m, depth = np.exp(rng.uniform(*np.log(_SCRATCH_LENGTH_M))), rng.exponential(_SCRATCH_DEPTH)
        half = length_m / texel_m / 2 * np.array([np.cos(angle_rad), np.sin(angle_rad)])
        change = min(depth, _BRIGHT_DEPTH_MOST) if rng.uniform() < 0.4 else -min(2 * depth, _DARK_DEPTH_MOST)
        width = max(round(_WIDE_M / texel_m), 1) if rng.uniform() < _WIDE_RATIO else 1
        for part, share in _TAPER:
            start, end = (np.rint((middle + s * part * half) * 2**fine).astype(int).tolist() for s in (-1, 1))
            cv2.line(panel, start, end, round(255 * (_BRUSHED_MEAN + share * change)), width, cv2.LINE_AA, fine)
    return panel.astype(np.float32) / 255


_PATTERNS = {"none": _plain, "brushed": _brushed, "scratched": _scratched}


def _spots(
    shape: tuple[int, ...],
    centres_px: Float[np.ndarray, "k 2"],
    off_px: Float[np.ndarray, "k"],
    radii_px: Float[np.ndarray, "k"],
    halo_px: float,
) -> Float[np.ndarray, "rows columns"]:
    """Dark discs with a lighter (straw) and a darker (blue) ring around, 1 elsewhere, about centres off the panel."""
    panel = np.ones(shape, np.float32)
    for (u, v), off, radius in zip(centres_px, off_px, radii_px, strict=True):
        reach = radius + 2 * halo_px
        v0, v1 = (int(np.clip(x, 0, shape[0])) for x in (np.floor(v - reach), np.ceil(v + reach) + 1))
        u0, u1 = (int(np.clip(x, 0, shape[1])) for x in (np.floor(u - reach), np.ceil(u + reach) + 1))
        away = np.hypot(np.hypot(np.arange(u0, u1) - u, np.arange(v0, v1)[:, None] - v), off)
        beyond = (away - radius) / halo_px
        level = np.interp(beyond, [-0.3, 0.0, 0.5, 1.0, 2.0], [_SPOT_BRIGHTNESS, 0.55, 0.85, 0.65, 1.0])
        panel[v0:v1, u0:u1] = np.minimum(panel[v0:v1, u0:u1], level)
    return panel

"""The picture in fine cells, whose corners stand for the surface between them, and single pixels where they do not.

A field that is smooth on surfaces (light, places of a texture) is found at knots 8 pixels apart and drawn out linearly
between them. Where the four knots about a pixel do not lie on one surface (edges, folds) or differ in what they were
marked with (lit or shaded), the pixel is `rough`: it needs a ray of its own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.cell.errors import BadGeometry
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.weld.coarse_view import SeenCells

STEP_PX = 8  # a power of two: cv2.warpAffine's weights are exact then
_LARGEST_TURN = 0.2  # of the normal between knots of one surface
_LARGEST_STEP_M = 1e-3  # of a knot out of another one's tangent plane
_LARGEST_JUMP = 100.0  # of what is drawn out, e.g. a texture's pixels


@dataclass(frozen=True, kw_only=True, eq=False)
class FineView:
    """Knots over a camera's picture, in order of rows; the last ones may lie beyond its border."""

    width_px: int
    """Width of the picture."""
    height_px: int
    """Height of the picture."""
    directions_camera: Float[np.ndarray, "rows columns 3"]
    """Unit ray of each knot."""

    @property
    def rays_camera(self) -> Float[np.ndarray, "n 3"]:
        """The knots' rays in a row."""
        return self.directions_camera.reshape(-1, 3)

    def whole(self, field: Float[np.ndarray, "n"]) -> Float[np.ndarray, "height width"]:
        """A field of the knots over the whole picture (float32), linear between them."""
        knots = field.reshape(self.directions_camera.shape[:2]).astype(np.float32)
        onto = np.array([[1 / STEP_PX, 0, 0], [0, 1 / STEP_PX, 0]])
        size = self.width_px, self.height_px
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return np.asarray(cv2.warpAffine(knots, onto, size, flags=flags, borderMode=cv2.BORDER_REPLICATE))

    def rough(
        self, seen: SeenCells, marks: Bool[np.ndarray, "n"], places: Float[np.ndarray, "n 2"]
    ) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
        """Rows and columns of the pixels whose knots are not of one surface, differ in marks or lie apart in places."""
        shape = self.directions_camera.shape[:2]
        first, others = _corners(np.arange(seen.geom_id.size).reshape(shape))
        odd = np.zeros(first.shape, bool)
        for other in others:
            turned = np.abs(seen.normals_base[first] - seen.normals_base[other]).max(axis=-1) > _LARGEST_TURN
            step_m = np.einsum(
                "...i,...i->...", seen.normals_base[first], seen.points_base[first] - seen.points_base[other]
            )
            apart = np.abs(places[first] - places[other]).max(axis=-1) > _LARGEST_JUMP
            odd |= turned | apart | (np.abs(step_m) > _LARGEST_STEP_M)
            odd |= (seen.geom_id[first] != seen.geom_id[other]) | (marks[first] != marks[other])
        pixels = np.kron(odd, np.ones((STEP_PX, STEP_PX), bool))[: self.height_px, : self.width_px]
        rows, columns = np.nonzero(pixels)
        return rows, columns

    def rays(self, rows: Int[np.ndarray, "k"], columns: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k 3"]:
        """Unit rays of pixels, drawn out between the knots' (a lens bends them by far less than a pixel)."""
        (row, down), (column, right) = np.divmod(rows, STEP_PX), np.divmod(columns, STEP_PX)
        down, right = down[:, None] / STEP_PX, right[:, None] / STEP_PX
        knots = self.directions_camera
        above = (1 - right) * knots[row, column] + right * knots[row, column + 1]
        below = (1 - right) * knots[row + 1, column] + right * knots[row + 1, column + 1]
        rays = (1 - down) * above + down * below
        return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def fine_view(camera: CameraModel) -> FineView:
    """The knots of a camera."""
    u_px, v_px = (np.arange(-(-size // STEP_PX) + 1) * float(STEP_PX) for size in (camera.width_px, camera.height_px))
    rays = camera.unproject(np.stack(np.meshgrid(u_px, v_px), axis=-1))
    if not np.all(np.isfinite(rays)):
        raise BadGeometry("camera: the lens distortion cannot be inverted over the whole picture")
    directions = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return FineView(width_px=camera.width_px, height_px=camera.height_px, directions_camera=directions)


def _corners(knots: Int[np.ndarray, "rows columns"]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """For each cell its first knot and the three others."""
    return knots[:-1, :-1], (knots[:-1, 1:], knots[1:, :-1], knots[1:, 1:])

"""The picture in fine cells, whose corners stand for the surface between them, and single pixels where they do not.

A field that is smooth on surfaces (light, places of a texture) is found at knots 8 pixels apart and drawn out linearly
between them. Where the four knots about a pixel do not lie on one surface (edges, folds) or differ in what they were
marked with (lit or shaded), the pixel is `rough`: it needs a ray of its own.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

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
        odd = np.zeros([size - 1 for size in self.directions_camera.shape[:2]], bool)
        for field, largest in ((seen.normals_base, _LARGEST_TURN), (places, _LARGEST_JUMP)):
            for axis in field.T:
                first, others = self._corners(axis)
                for other in others:
                    odd |= np.abs(first - other) > largest
        for field in (seen.geom_id, marks):
            first, others = self._corners(field)
            for other in others:
                odd |= first != other
        normal, (points, others) = self._corners(seen.normals_base)[0], self._corners(seen.points_base)
        for other in others:
            odd |= np.abs(np.einsum("...i,...i->...", normal, points - other)) > _LARGEST_STEP_M
        row, column = np.nonzero(odd)
        within = np.arange(STEP_PX)
        rows = np.broadcast_to((STEP_PX * row[:, None] + within)[:, :, None], (len(row), STEP_PX, STEP_PX)).ravel()
        columns = np.broadcast_to((STEP_PX * column[:, None] + within)[:, None], (len(row), STEP_PX, STEP_PX)).ravel()
        inside = (rows < self.height_px) & (columns < self.width_px)
        return rows[inside], columns[inside]

    def _corners(self, field: Shaped[np.ndarray, "n *k"]) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        """A field of the knots at each cell's first corner, and at its three others."""
        knots = field.reshape(*self.directions_camera.shape[:2], *field.shape[1:])
        return knots[:-1, :-1], (knots[:-1, 1:], knots[1:, :-1], knots[1:, 1:])

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

"""The picture in coarse cells: what the camera sees in each, and fields of cells blown up to the whole picture.

Glare and fume are smooth, so cells of some 40 pixels hold them.
"""

from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry
from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.rays import RayCaster

FARTHEST_M = 1.0
"""How far light of the weld and fume are followed."""


@dataclass(frozen=True, kw_only=True)
class SeenCells:
    """What the camera sees in each cell; base frame, metres. Cells where it sees nothing lie 1 m away."""

    centre_base: Float[np.ndarray, "3"]
    """The camera's centre."""
    points_base: Float[np.ndarray, "n 3"]
    """Surface point."""
    normals_base: Float[np.ndarray, "n 3"]
    """Outward unit normal; 0 where nothing is seen."""
    range_m: Float[np.ndarray, "n"]
    """Distance from the camera."""
    geom_id: Int[np.ndarray, "n"]
    """The geom; -1 where nothing is seen."""


class CoarseView:
    """The camera's picture as a grid of cells, in order of rows."""

    def __init__(self, camera: CameraModel, cell_px: float = 40.0) -> None:
        self._size = camera.width_px, camera.height_px
        self.columns, self.rows = (max(2, round(size / cell_px)) for size in self._size)
        u_px, v_px = (
            (np.arange(count) + 0.5) * size / count - 0.5
            for count, size in zip((self.columns, self.rows), self._size, strict=True)
        )
        self._middles = np.rint(np.stack(np.meshgrid(u_px, v_px), axis=-1).reshape(-1, 2)).astype(np.int64)
        self.pixels = self._middles.astype(float)
        """Middle of each cell, to the nearest pixel's centre."""
        rays = camera.unproject(self.pixels)
        if not np.all(np.isfinite(rays)):
            raise BadGeometry("camera: the lens distortion cannot be inverted over the whole picture")
        self.directions_camera = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        """Unit ray of each cell."""

    def look(self, caster: RayCaster, data: mujoco.MjData, T_base_camera: RigidTransform) -> SeenCells:
        """What the camera sees from `T_base_camera`."""
        directions_base = self.directions_camera @ T_base_camera.rotation.as_matrix().T
        return seen_along(directions_base, caster, data, T_base_camera)

    def whole(self, field: Float[np.ndarray, "n"]) -> Float[np.ndarray, "height width"]:
        """A field of the cells over the whole picture (float32), linear between the cells' middles."""
        cells = field.reshape(self.rows, self.columns).astype(np.float32)
        return np.asarray(cv2.resize(cells, self._size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)

    def at(self, field: Float[np.ndarray, "n"], pixels: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k"]:
        """A field of the cells at some pixels, linear between the cells' middles."""
        cells = field.reshape(self.rows, self.columns)
        (u, column), (v, row) = (
            _between(pixels[:, axis], size, count)
            for axis, (size, count) in enumerate(zip(self._size, (self.columns, self.rows), strict=True))
        )
        above = (1 - u) * cells[row, column] + u * cells[row, column + 1]
        below = (1 - u) * cells[row + 1, column] + u * cells[row + 1, column + 1]
        return (1 - v) * above + v * below


def seen_along(
    directions_base: Float[np.ndarray, "n 3"], caster: RayCaster, data: mujoco.MjData, T_base_camera: RigidTransform
) -> SeenCells:
    """What a camera sees along unit directions."""
    centre_base = T_base_camera.translation
    hits = caster.cast(data, centre_base, directions_base)
    near = hits.hit & (hits.distance_m < FARTHEST_M)
    range_m = np.where(near, hits.distance_m, FARTHEST_M)
    return SeenCells(
        centre_base=centre_base,
        points_base=centre_base + range_m[:, None] * directions_base,
        normals_base=np.where(near[:, None], hits.normals, 0.0),
        range_m=range_m,
        geom_id=np.where(near, hits.geom_id, -1),
    )


def _between(pixels: Float[np.ndarray, "k"], size: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Share of the way to the next cell, and the cell before; the border's value holds beyond it."""
    place = np.clip((pixels + 0.5) * count / size - 0.5, 0, count - 1)
    cell = np.minimum(place.astype(np.int64), count - 2)
    return place - cell, cell

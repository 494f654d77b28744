"""Rays against MuJoCo's simple solids in closed form, in the frame of the geom; all from one origin or each its own.

A ray crosses a convex solid in one stretch. A box is three slabs, a cylinder is an endless cylinder within a slab: the
stretches' intersection; a capsule is a cylinder with two balls: from the first entry to the last exit.
"""

import mujoco
import numpy as np
from jaxtyping import Float

Origins = Float[np.ndarray, "3"] | Float[np.ndarray, "n 3"]
"""One origin for all rays, or one for each."""

_Stretch = tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]
_PLANE, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX = (
    mujoco.mjtGeom.mjGEOM_PLANE.value,
    mujoco.mjtGeom.mjGEOM_SPHERE.value,
    mujoco.mjtGeom.mjGEOM_CAPSULE.value,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID.value,
    mujoco.mjtGeom.mjGEOM_CYLINDER.value,
    mujoco.mjtGeom.mjGEOM_BOX.value,
)
SOLIDS = (_PLANE, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX)
"""Kinds of geoms (mjtGeom) that are known here."""


def solid_hits(
    kind: int, size: Float[np.ndarray, "3"], origin: Origins, directions: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Distances (infinite for a miss) and outward unit normals; from inside, those of the way out.

    `kind` and `size` are MuJoCo's geom type and size. A plane is met from above only, as in MuJoCo.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        near, far = _stretch(kind, size, origin, directions)
        distance_m = np.where(near >= 0, near, far)
        distance_m = np.where((near <= far) & (far >= 0), distance_m, np.inf)
        points = origin + distance_m[:, None] * directions
        if kind == _PLANE:
            inside = np.all((size[:2] <= 0) | (np.abs(points[:, :2]) <= size[:2]), axis=1)
            distance_m = np.where(inside, distance_m, np.inf)
        return distance_m, _normals(kind, size, points)


def _stretch(
    kind: int, size: Float[np.ndarray, "3"], origin: Origins, directions: Float[np.ndarray, "n 3"]
) -> _Stretch:
    """Where the rays go in and out (m along the ray, negative behind the origin); the entry is later for a miss."""
    radius_m, half_m = size[0], size[1]
    if kind == _PLANE:
        distance_m = np.where(directions[:, 2] < 0, -origin[..., 2] / directions[:, 2], -np.inf)
        return distance_m, distance_m
    if kind == _SPHERE:
        return _quadric(np.full(3, 1 / radius_m), origin, directions)
    if kind == _ELLIPSOID:
        return _quadric(1 / size, origin, directions)
    if kind == _BOX:
        return _common(*(_slab(size[axis], origin[..., axis], directions[:, axis]) for axis in range(3)))
    endless = _quadric(np.array([1 / radius_m, 1 / radius_m, 0.0]), origin, directions)
    cylinder = _common(endless, _slab(half_m, origin[..., 2], directions[:, 2]))
    if kind == _CYLINDER:
        return cylinder
    ends = (_quadric(np.full(3, 1 / radius_m), origin - [0, 0, z], directions) for z in (half_m, -half_m))
    return _joined(cylinder, *ends)


def _quadric(scale: Float[np.ndarray, "3"], origin: Origins, directions: Float[np.ndarray, "n 3"]) -> _Stretch:
    """Within |scale * p| <= 1: from the foot of the perpendicular on the ray, so exact from afar too."""
    o, d = scale * origin, scale * directions
    dd = np.einsum("ni,ni->n", d, d)
    foot = np.where(dd > 0, -np.einsum("ni,ni->n", d, np.broadcast_to(o, d.shape)) / dd, 0)
    beside = o + foot[:, None] * d
    inside = 1 - np.einsum("ni,ni->n", beside, beside)
    half = np.where(inside >= 0, np.sqrt(np.maximum(inside, 0) / dd), -np.inf)
    half = np.where((dd == 0) & (inside >= 0), np.inf, half)
    return foot - half, foot + half


def _slab(half_m: float, origin: Float[np.ndarray, "..."], directions: Float[np.ndarray, "n"]) -> _Stretch:
    """Within |p| <= half along one axis."""
    one, other = (-half_m - origin) / directions, (half_m - origin) / directions
    along = directions == 0
    endless = np.where(np.abs(origin) <= half_m, np.inf, -np.inf)
    return (
        np.where(along, -endless, np.minimum(one, other)),
        np.where(along, endless, np.maximum(one, other)),
    )


def _common(*stretches: _Stretch) -> _Stretch:
    return np.maximum.reduce([s[0] for s in stretches]), np.minimum.reduce([s[1] for s in stretches])


def _joined(*stretches: _Stretch) -> _Stretch:
    """From the first entry to the last exit of those that are met."""
    near = np.minimum.reduce([np.where(low <= high, low, np.inf) for low, high in stretches])
    far = np.maximum.reduce([np.where(low <= high, high, -np.inf) for low, high in stretches])
    return near, far


def _normals(kind: int, size: Float[np.ndarray, "3"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Outward unit normals at points of the surface."""
    if kind == _PLANE:
        return np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    if kind == _BOX:
        face = np.argmax(np.nan_to_num(np.abs(points) - size), axis=1)
        return np.where(np.arange(3) == face[:, None], np.sign(points), 0.0)
    if kind == _CYLINDER:
        on_end = np.abs(points[:, 2]) - size[1] > np.hypot(points[:, 0], points[:, 1]) - size[0]
        normals = np.where(on_end[:, None], points * [0, 0, 1], points * [1, 1, 0])
    elif kind == _CAPSULE:
        normals = points - np.clip(points[:, 2], -size[1], size[1])[:, None] * [0, 0, 1]
    else:
        normals = points / (size**2 if kind == _ELLIPSOID else 1.0)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)

"""Sections of joints by their drawings, what a line sensor sees of them, and the exact features.

A section is drawn in its own frame: s along the plate, d into its depth, top of the plates at d = 0; s grows to the
left of the travel. Chains of points, one for each part; light comes along z of the laser frame.
"""

import numpy as np

from tracking.fabricated_profiles import p2_camera, p2_plane
from weldcell.cell.profile import Stripe
from weldcell.tracking.triangulation import triangulate

CAMERA, PLANE = p2_camera(), p2_plane()
PLATE_M = 0.03
DEG_10, DEG_15, DEG_45, DEG_60, DEG_90 = np.deg2rad([10, 15, 45, 60, 90])


def butt(*, gap=0.002, mismatch=0.0, thickness=0.008):
    """Square edges; mismatch: how much higher the left plate stands."""
    right = [[-PLATE_M, 0], [-gap / 2, 0], [-gap / 2, thickness]]
    left = [[gap / 2, thickness], [gap / 2, -mismatch], [PLATE_M, -mismatch]]
    return [right, left], {"left": (gap / 2, -mismatch), "right": (-gap / 2, 0)}


def v(*, angle=DEG_60, thickness=0.012, gap=0.0, face=0.002):
    depth = thickness - face
    edge = gap / 2 + depth * np.tan(angle / 2)
    left = [[PLATE_M, 0], [edge, 0], [gap / 2, depth]]
    features = {"left": (edge, 0), "root": (0, depth), "right": (-edge, 0)}
    if gap == 0:
        return [[[-s, d] for s, d in left] + left[1::-1]], features
    left = [*left, [gap / 2, thickness]]
    return [[[-s, d] for s, d in left], left], features


def bevel(*, angle=DEG_45, thickness=0.012, gap=0.0, face=0.002, mirror=False):
    """The left plate has the bevel, the right one a square edge (mirror: the reverse)."""
    depth = thickness - face
    edge = gap + depth * np.tan(angle)
    square = [[-PLATE_M, 0], [0, 0], [0, thickness]]
    bevelled = [[gap, thickness], [gap, depth], [edge, 0], [PLATE_M, 0]]
    features = {"left": (edge, 0), "root": (gap / 2, depth), "right": (0, 0)}
    return _maybe_mirrored([square, bevelled], features, mirror)


def _arc(radius, wall, gap, depth):
    """From the bottom (gap / 2, depth) along a quarter circle into a wall inclined by `wall` against the depth."""
    turn = np.linspace(0, np.pi / 2 - wall, 400)
    arc = np.column_stack([gap / 2 + radius * np.sin(turn), depth - radius + radius * np.cos(turn)])
    s, d = arc[-1]
    return [*arc.tolist(), [s + d * np.tan(wall), 0.0], [PLATE_M, 0.0]]


def u(*, wall=DEG_10, radius=0.006, thickness=0.016, gap=0.0, face=0.003):
    depth = thickness - face
    left = _arc(radius, wall, gap, depth)
    if gap:
        left = [[gap / 2, thickness], *left]
    edge = left[-2][0]
    return [[[-s, d] for s, d in left], left], {"left": (edge, 0), "centre": (0, depth), "right": (-edge, 0)}


def j(*, wall=DEG_15, radius=0.006, thickness=0.016, gap=0.0, face=0.003, mirror=False):
    """The left plate has the J, the right one a square edge (mirror: the reverse)."""
    depth = thickness - face
    left = [[s + gap / 2, d] for s, d in _arc(radius, wall, gap, depth)]  # from s = gap on
    left = [[gap, thickness], *left]
    square = [[-PLATE_M, 0], [0, 0], [0, thickness]]
    features = {"left": (left[-2][0], 0), "root": (gap / 2, depth), "right": (0, 0)}
    return _maybe_mirrored([square, left], features, mirror)


def lap(*, thickness=0.006, mirror=False):
    """The upper plate is the right one (mirror: the left one)."""
    upper = [[-PLATE_M, 0], [0, 0], [0, thickness]]
    lower = [[-PLATE_M, thickness], [PLATE_M, thickness]]
    return _maybe_mirrored([upper, lower], {"edge": (0, 0), "root": (0, thickness)}, mirror)


def fillet(*, angle=DEG_90):
    """A valley, seen along its middle."""
    run, rise = PLATE_M * np.sin(angle / 2), PLATE_M * np.cos(angle / 2)
    return [[[-run, -rise], [0, 0], [run, -rise]]], {"root": (0, 0)}


def corner(*, angle=DEG_90, thickness=0.006):
    """Two plates at this angle whose inner corners touch: edge faces at right angles to the plates."""
    half = angle / 2  # of the roof's ridge
    plate = np.array([np.sin(half), np.cos(half)])  # down the left plate
    normal = np.array([np.cos(half), -np.sin(half)])  # out of the left plate
    edge = thickness * normal
    left = [[0, 0], edge.tolist(), (edge + PLATE_M * plate).tolist()]
    features = {"left": tuple(edge), "root": (0, 0), "right": (-edge[0], edge[1])}
    return [[[-s, d] for s, d in left[::-1]] + left[1:]], features


JOINTS = {
    "butt": butt, "v": v, "v-gap": v, "bevel": bevel, "u": u, "j": j, "lap": lap, "fillet": fillet, "corner": corner,
}  # fmt: skip


def _maybe_mirrored(parts, features, mirror):
    if not mirror:
        return parts, features
    swapped = {"left": "right", "right": "left"}
    flipped = {swapped.get(name, name): (-s, d) for name, (s, d) in features.items()}
    return [[[-s, d] for s, d in part] for part in parts], flipped


def placed(drawn, *, tilt_rad=0.0, x_m=0.0, z_m=0.19, bend=0.0):
    """Parts and features in the laser frame; bend: curvature of the plates beside the joint (1/m)."""
    parts, features = drawn
    cos, sin = np.cos(tilt_rad), np.sin(tilt_rad)

    first, last = min(s for s, _ in features.values()), max(s for s, _ in features.values())

    def put(points):
        points = np.atleast_2d(np.asarray(points, float))
        beside = np.maximum(points[:, 0] - last, 0) + np.maximum(first - points[:, 0], 0)
        bent = np.column_stack([points[:, 0], points[:, 1] + bend * beside**2 / 2])
        return bent @ np.array([[cos, sin], [-sin, cos]]) + [x_m, z_m]

    if bend:
        parts = [_finely(part) for part in parts]
    return [put(part) for part in parts], {name: put(point)[0] for name, point in features.items()}


def _finely(part, step_m=2e-4):
    part = np.asarray(part, float)
    length = np.append(0, np.cumsum(np.hypot(*np.diff(part, axis=0).T)))
    at = np.unique(np.concatenate([length, np.arange(0, length[-1], step_m)]))
    return np.column_stack([np.interp(at, length, part[:, 0]), np.interp(at, length, part[:, 1])])


def seen_stripe(parts):
    """The exact stripe: each column's uppermost point that light along z reaches. Column rays and segments are cut."""
    start = np.concatenate([part[:-1] for part in parts])
    end = np.concatenate([part[1:] for part in parts])
    axes, origin = PLANE.T_camera_laser.rotation.as_matrix(), PLANE.T_camera_laser.translation
    u_px = np.arange(CAMERA.width_px, dtype=float)
    lateral = (u_px - CAMERA.principal_px[0]) / CAMERA.focal_px[0]
    # Camera x is the laser frame's x; depth = origin_z + z times the light's z: x = lateral depth is a line.
    offset = start[:, 0] + origin[0] - lateral[:, None] * (origin[2] + axes[2, 2] * start[:, 1])
    rate = (end - start)[:, 0] - lateral[:, None] * axes[2, 2] * (end - start)[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -offset / rate
    column, segment = np.nonzero((share >= 0) & (share <= 1))
    hit = start[segment] + share[column, segment][:, None] * (end - start)[segment]
    lit = hit[:, 1] <= _surface_z(start, end, hit[:, 0]) + 1e-9
    column, hit = column[lit], hit[lit]
    order = np.lexsort((hit[:, 1], column))
    column, hit = column[order], hit[order]
    first = np.append(True, np.diff(column) > 0)[: len(column)]
    pixels = CAMERA.project(PLANE.T_camera_laser.apply(np.insert(hit[first], 1, 0.0, axis=1)))
    inside = (pixels[:, 1] >= 0) & (pixels[:, 1] <= CAMERA.height_px - 1)
    return Stripe(u_px=pixels[inside, 0], v_px=pixels[inside, 1], sigma_px=np.full(int(inside.sum()), 1.0))


def _surface_z(start, end, x):
    """Least z of all segments at each x."""
    low, high = np.minimum(start[:, 0], end[:, 0]), np.maximum(start[:, 0], end[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (end[:, 1] - start[:, 1]) / (end[:, 0] - start[:, 0])
        z = start[:, 1] + slope * (x[:, None] - start[:, 0])
    vertical = high - low < 1e-12
    z = np.where(vertical, np.minimum(start[:, 1], end[:, 1]), z)
    return np.where((x[:, None] >= low + 1e-9) & (x[:, None] <= high - 1e-9), z, np.inf).min(axis=1)


def measured(stripe, *, noise_m=0.0, strays=0.0, hidden_m=(), rng=None):
    """The profile of a stripe with noise along the light, a share of strays (half of them in runs), hidden x ranges."""
    exact = triangulate(stripe, CAMERA, PLANE)
    claimed_px = max(noise_m, 1e-7) / exact.sigma_m  # exact.sigma_m is that of one pixel
    v_px = stripe.v_px.copy()
    if noise_m:
        v_px = v_px + claimed_px * rng.normal(size=len(v_px))
    if strays:
        stray = rng.random(len(v_px)) < strays / 2
        v_px = np.where(stray, v_px + rng.uniform(-150, 150, len(v_px)), v_px)
        for _ in range(int(strays / 2 * len(v_px) / 5)):
            at, length = rng.integers(len(v_px)), rng.integers(3, 8)
            v_px[at : at + length] = np.clip(v_px[at : at + length].mean() + rng.uniform(-150, 150), 0, 1079)
    x_m = PLANE.T_camera_laser.inv().apply(exact.points_camera)[:, 0]
    keep = (v_px >= 0) & (v_px <= CAMERA.height_px - 1)
    for low, high in hidden_m:
        keep &= (x_m < low) | (x_m > high)
    return triangulate(Stripe(u_px=stripe.u_px[keep], v_px=v_px[keep], sigma_px=claimed_px[keep]), CAMERA, PLANE)


def laser_points(features):
    """The features (x, z) in the laser frame."""
    return PLANE.T_camera_laser.inv().apply(features.points_camera)[:, [0, 2]]


def errors_m(features, truth):
    """Distance of each feature from the true one."""
    return np.array(
        [np.hypot(*(at - truth[name])) for name, at in zip(features.names, laser_points(features), strict=True)]
    )

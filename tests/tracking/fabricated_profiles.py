"""Stripes, pictures, profiles and clouds from closed forms, for the tests of tracking."""

import numpy as np

from weldcell.cell.optics import CameraModel, LaserPlane
from weldcell.cell.profile import Stripe


def stripe_picture(
    centre_px,
    *,
    height_px=400,
    peak_grey=120.0,
    sigma_px=2.0,
    background=0.0,
    noise_grey=0.0,
    speckle_contrast=0.0,
    rng=None,
):
    """An 8-bit picture with a Gaussian stripe at centre_px of each column (NaN: none)."""
    centre_px = np.asarray(centre_px, float)
    rows = np.arange(height_px)[:, None]
    light = peak_grey * np.exp(-0.5 * ((rows - centre_px) / sigma_px) ** 2)
    light = np.where(np.isfinite(centre_px), light, 0.0)
    if speckle_contrast:
        shape = speckle_contrast**-2  # gamma distribution of mean 1
        light = light * rng.gamma(shape, 1 / shape, light.shape)
    grey = light + background
    if noise_grey:
        grey = grey + rng.normal(0, noise_grey, grey.shape)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def p2_camera(distortion=None):
    """The sensor of P2: 1440 x 1080 pixels of 3.45 um behind 12 mm."""
    return CameraModel(
        width_px=1440,
        height_px=1080,
        focal_px=np.array([3478.26, 3478.26]),
        principal_px=np.array([724.3, 533.8]),
        distortion=np.zeros(14) if distortion is None else distortion,
    )


def p2_plane():
    """Its light plane: 45 degrees, 275 mm ahead."""
    return LaserPlane(normal_camera=np.array([0, -1, 1]) / np.sqrt(2), offset_m=0.275 / np.sqrt(2))


def v_corners(*, depth_m=0.06, groove_angle_rad=np.pi / 4, tilt_rad=0.0, x_m=0.0, z_m=0.17, plate_m=0.03):
    """Corners (x, z) in the laser frame: plate end, left edge, root, right edge, plate end."""
    half = depth_m * np.tan(groove_angle_rad / 2)
    flat = np.array([[-half - plate_m, 0], [-half, 0], [0, depth_m], [half, 0], [half + plate_m, 0]])
    cos, sin = np.cos(tilt_rad), np.sin(tilt_rad)
    return flat @ np.array([[cos, sin], [-sin, cos]]) + [x_m, z_m]


def stripe_of_corners(corners, camera, plane, *, sigma_px=0.25):
    """The exact stripe of a polyline (laser frame) in a distortion-free camera, and sigma_px as its claimed sigma.

    A straight line of the light plane is a straight line of the picture, so the pixels of the corners suffice.
    """
    points_laser = np.column_stack([corners[:, 0], np.zeros(len(corners)), corners[:, 1]])
    pixels = camera.project(plane.T_camera_laser.apply(points_laser))
    u_px = np.arange(np.ceil(max(pixels[0, 0], 0)), np.floor(min(pixels[-1, 0], camera.width_px - 1)) + 1)
    v_px = np.interp(u_px, pixels[:, 0], pixels[:, 1])
    inside = (v_px >= 0) & (v_px <= camera.height_px - 1)
    u_px, v_px = u_px[inside], v_px[inside]
    return Stripe(u_px=u_px, v_px=v_px, sigma_px=np.full(len(u_px), sigma_px))


def shifted(stripe, offset_px):
    """The stripe with its centres moved."""
    return Stripe(u_px=stripe.u_px, v_px=stripe.v_px + offset_px, sigma_px=stripe.sigma_px)


def boss_planes(*, edge_m=0.05, slope_rad=0.9272952180016122, top_m=0.03):
    """Normals and offsets of a boss about z: base, top, and slanted faces towards +x, +y, -x, -y."""
    # A slope of 4 in 3. The slanted edge runs over (r, r, h) with h = r tan(slope): its length is r sqrt(2 + tan^2).
    run = edge_m / np.sqrt(2 + np.tan(slope_rad) ** 2)
    height = run * np.tan(slope_rad)
    azimuth = np.arange(4) * np.pi / 2
    sides = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], -1) * np.sin(slope_rad)
    normals = np.vstack([[0, 0, 1], [0, 0, 1], sides + [0, 0, np.cos(slope_rad)]])
    offsets = np.array([0.0, height, *[(top_m / 2 + run) * np.sin(slope_rad)] * 4])
    return normals, offsets


def boss_scan(*, frames=150, columns=1000, half_m=0.06, noise_m=0.0, frame_noise_m=0.0, rng=None, **boss):
    """Points of a scan of the boss seen from above: frames along x, columns along y."""
    normals, offsets = boss_planes(**boss)
    x, y = np.meshgrid(np.linspace(-half_m, half_m, frames), np.linspace(-half_m, half_m, columns), indexing="ij")
    faces = (offsets[2:, None, None] - normals[2:, 0, None, None] * x - normals[2:, 1, None, None] * y) / normals[2, 2]
    z = np.maximum(np.minimum(faces.min(axis=0), offsets[1]), 0.0)
    points = np.stack([x, y, z], -1)
    if noise_m:
        points[..., 2] += rng.normal(0, noise_m, z.shape)
    if frame_noise_m:
        points += rng.normal(0, frame_noise_m, (frames, 1, 3))
    return points.reshape(-1, 3)


def picture_of_corners(corners, camera, plane, *, peak_grey=110.0, sigma_px=1.6, contrast=0.45, noise_grey=1.5, rng):
    """The noisy picture of a polyline's stripe: brightness falls off with the distance from it, plates at 18 grey."""
    points_laser = np.column_stack([corners[:, 0], np.zeros(len(corners)), corners[:, 1]])
    pixels = camera.project(plane.T_camera_laser.apply(points_laser))
    columns, rows = np.arange(camera.width_px), np.arange(camera.height_px)[:, None]
    squared = np.full((camera.height_px, camera.width_px), np.inf, dtype=np.float32)
    for start, end in zip(pixels[:-1], pixels[1:], strict=True):
        (du, dv), length2 = end - start, np.sum((end - start) ** 2)
        along = np.clip(((columns - start[0]) * du + (rows - start[1]) * dv) / length2, 0, 1)
        distance2 = (columns - start[0] - along * du) ** 2 + (rows - start[1] - along * dv) ** 2
        squared = np.minimum(squared, distance2.astype(np.float32))
    light = peak_grey * np.exp(-squared / (2 * sigma_px**2)) * rng.gamma(contrast**-2, contrast**2, squared.shape)
    ambient = np.where((columns > pixels[0, 0]) & (columns < pixels[-1, 0]), 18.0, 4.0)
    return np.clip(np.rint(light + ambient + rng.normal(0, noise_grey, light.shape)), 0, 255).astype(np.uint8)

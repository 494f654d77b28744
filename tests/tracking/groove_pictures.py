"""Pictures of a V-groove's stripe, turned, coloured and before a board, from closed forms."""

import numpy as np

SHAPE = (560, 760)
CORNERS_PX = np.array([[-400.0, 240], [250, 245], [380, 375], [505, 255], [1200, 265]])
"""The stripe's polyline (u, v): plate, left edge, root, right edge, plate."""


def turned(corners_px, angle_rad, shape=SHAPE):
    """The polyline turned about the picture's centre, and shrunk to stay within it."""
    centre = np.array([shape[1] - 1, shape[0] - 1]) / 2
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return (np.asarray(corners_px) - centre) @ np.array([[cos, sin], [-sin, cos]]) * 0.9 + centre


def stripe_light(corners_px, shape=SHAPE, sigma_px=2.0):
    """Light of a stripe of height 1 along the polyline: a Gaussian of the distance from it."""
    columns, rows = np.arange(shape[1]), np.arange(shape[0])[:, None]
    squared = np.full(shape, np.inf)
    for start, end in zip(corners_px[:-1], corners_px[1:], strict=True):
        du, dv = end - start
        along = np.clip(((columns - start[0]) * du + (rows - start[1]) * dv) / (du**2 + dv**2), 0, 1)
        squared = np.minimum(squared, (columns - start[0] - along * du) ** 2 + (rows - start[1] - along * dv) ** 2)
    return np.exp(-squared / (2 * sigma_px**2))


def board_grey(shape=SHAPE, square_px=45.0, angle_rad=0.2, first=(60.0, 40.0)):
    """A chessboard of 9 x 7 squares, 190 and 25 grey levels, on 90."""
    columns, rows = np.arange(shape[1]) - first[0], np.arange(shape[0])[:, None] - first[1]
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = (columns * cos + rows * sin) / square_px, (rows * cos - columns * sin) / square_px
    squares = np.where((np.floor(x) + np.floor(y)) % 2 == 0, 190.0, 25.0)
    return np.where((x > 0) & (x < 9) & (y > 0) & (y < 7), squares, 90.0)


def grey_picture(corners_px=CORNERS_PX, *, rng, peak_grey=140.0, contrast=0.3, background=18.0, sigma_px=2.0):
    """An 8-bit picture with speckle and noise."""
    light = stripe_light(corners_px, sigma_px=sigma_px) * rng.gamma(contrast**-2, contrast**2, SHAPE)
    grey = peak_grey * light + background + rng.normal(0, 1.5, SHAPE)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def colour_picture(channel, *, rng, peak_grey=220.0, spill=0.25, corners_px=CORNERS_PX):
    """An RGB picture of a laser whose light falls into one channel, and in part into the others, on a chessboard."""
    board = board_grey()
    share = np.full(3, spill)
    share[channel] = 1.0
    light = stripe_light(corners_px) * rng.gamma(10, 0.1, SHAPE) * (0.3 + board / 255)
    picture = 0.7 * board[..., None] * [1.0, 0.95, 0.9] + peak_grey * light[..., None] * share
    return np.clip(np.rint(picture + rng.normal(0, 2, picture.shape)), 0, 255).astype(np.uint8)

"""Which pictures' stripe points lie in one plane: a picture whose stripe was mistaken for something else does not.

The points of one picture lie on a line; those of two pictures tell a plane. The pair whose plane the most pictures
agree with wins (random sample consensus with all samples; Fischler and Bolles 1981).
"""

from itertools import combinations

import numpy as np
from jaxtyping import Bool, Float, Int

from weldcell.calib.laser_plane import plane_through

_NEAR_SHARE = 0.005  # of the distance: far above any noise, far below a wrong line
_MOST_PAIRS = 400


def agreeing_pictures(
    points_camera: Float[np.ndarray, "n 3"], picture: Int[np.ndarray, "n"], count: int
) -> tuple[Bool[np.ndarray, "count"], Float[np.ndarray, "count"]]:
    """Which pictures agree, and each one's root mean square distance from their plane (m; NaN without points).

    All agree where no plane is shared by most of them: then nothing tells which are wrong.
    """
    rows = [np.flatnonzero((picture == k) & np.isfinite(points_camera).all(axis=1)) for k in range(count)]
    lit = [k for k in range(count) if len(rows[k])]
    near_m = _NEAR_SHARE * float(np.nanmedian(points_camera[:, 2]))
    best, best_key = np.full(count, np.nan), (0, 0.0)
    pairs = list(combinations(lit, 2))
    for first, second in pairs[:: max(1, len(pairs) // _MOST_PAIRS)]:
        plane = plane_through(points_camera[np.concatenate([rows[first], rows[second]])])
        if plane is None:
            continue
        rms = np.full(count, np.nan)
        for k in lit:
            rms[k] = np.sqrt(np.mean(plane.distance_m(points_camera[rows[k]]) ** 2))
        key = (int(np.sum(rms < near_m)), -float(np.nanmedian(rms)))
        if key > best_key:
            best, best_key = rms, key
    agree = best < near_m
    if agree.sum() < max(3, 0.5 * len(lit) + 1e-9):
        return np.ones(count, bool), best
    return agree | np.isnan(best), best

"""Which of a few points lie in line: how a seam is told from spatter before anything is known of it."""

import numpy as np
from jaxtyping import Bool, Float

_STEEPEST = 0.15  # slope of the deviations: a turn of 3 degrees, and a bend of 10 / m shifted along by 10 mm
_BEND_PER_M = 2.0  # of the deviations: that bend where it changes most, as on an S of 20 mm in 300 mm
_SIGMAS = 4.0
_SLACK_M = 0.2e-3


def in_line(
    places_m: Float[np.ndarray, "n"], offsets_m: Float[np.ndarray, "n 2"], sigma_m: Float[np.ndarray, "n"]
) -> Bool[np.ndarray, "n"]:
    """Which points agree with the one that most agree with, and then with the line through these.

    Offsets are the lateral and vertical deviations at these places of the path. Two points agree if a misplaced seam
    can run through both; the line's slope is the median of the slopes between two points (Theil 1950, Sen 1968).
    """
    apart_m = np.linalg.norm(offsets_m[:, None] - offsets_m, axis=-1)
    steps_m = places_m[:, None] - places_m
    allowed_m = _STEEPEST * np.abs(steps_m) + _SIGMAS * (sigma_m[:, None] + sigma_m) / 2 + _SLACK_M
    agree = apart_m <= allowed_m
    agree = agree[np.argmax(agree.sum(axis=1))]
    first, second = np.triu_indices(int(agree.sum()), 1)
    places, offsets = places_m[agree], offsets_m[agree]
    steps = places[second] - places[first]
    if not np.any(steps):
        return agree
    apart = steps != 0
    slope = np.median((offsets[second] - offsets[first])[apart] / steps[apart, None], axis=0)
    level = np.median(offsets - slope * places[:, None], axis=0)
    off_m = np.linalg.norm(offsets_m - slope * places_m[:, None] - level, axis=1)
    bent_m = _BEND_PER_M / 2 * np.square(np.ptp(places) / 2)
    return agree & (off_m <= _SIGMAS * sigma_m + bent_m + _SLACK_M / 4)

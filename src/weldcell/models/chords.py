"""Places on curves whose straight chords stray from them by less than a given distance."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

_PROBES = 1001  # where the curvature is measured
_MOST_PLACES = 100_000
_SAFETY = 0.9  # of the chord: curvature between the probes


def chord_places(
    lines_at: Callable[[Float[np.ndarray, "n"]], Float[np.ndarray, "n k 3"]],
    start: float,
    end: float,
    chord_m: float,
    largest_step: float,
) -> Float[np.ndarray, "n"]:
    """Parameters from `start` to `end`, dense where any of the k lines bends: all chords stray by less than `chord_m`.

    A chord over a step h of the parameter strays by |p''| h^2 / 8, p'' taken across the line.
    """
    probes = np.linspace(start, end, _PROBES)
    step = (end - start) / (_PROBES - 1)
    lines = lines_at(np.concatenate([[start - step], probes, [end + step]]))
    slope = (lines[2:] - lines[:-2]) / (2 * step)
    bend = (lines[2:] - 2 * lines[1:-1] + lines[:-2]) / step**2
    speed = np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12)
    along = np.sum(bend * slope, axis=-1, keepdims=True) / speed**2
    across = np.linalg.norm(bend - along * slope, axis=-1).max(axis=1)
    density = np.maximum(np.sqrt(across / (8 * _SAFETY * chord_m)), 1 / largest_step)
    total = np.concatenate([[0], np.cumsum((density[1:] + density[:-1]) / 2 * step)])
    count = min(int(np.ceil(total[-1] - 1e-9)), _MOST_PLACES)
    return np.interp(np.linspace(0, total[-1], count + 1), total, probes)


def arc(
    centre: tuple[float, float], radius_m: float, start_rad: float, end_rad: float, chord_m: float
) -> Float[np.ndarray, "n 2"]:
    """Points on a circle's arc in a plane, from angle to angle; chords stray by less than `chord_m` (r (1 - cos))."""
    step = 2 * np.arccos(max(1 - chord_m / radius_m, 0))
    count = max(int(np.ceil(abs(end_rad - start_rad) / step)), 1)
    angle = np.linspace(start_rad, end_rad, count + 1)
    return np.asarray(centre) + radius_m * np.column_stack([np.cos(angle), np.sin(angle)])


def growing_shares(whole: float, first: float, largest: float, growth: float) -> Float[np.ndarray, "n"]:
    """Shares from 0 to 1 of a length, in steps that grow from about `first` to `largest`."""
    ends = [0.0]
    while ends[-1] < whole:
        first, step = min(first * growth, largest), first
        ends.append(ends[-1] + step)
    return np.array(ends) / ends[-1]

"""Where the stripe runs in a picture that holds other bright things: the best path through it.

Spatter, a part's lit edges and the noise of an arc's glare outshine the stripe in many columns, but seldom in many
columns in a row. What stands out of five neighbouring columns, in units of the noise at its own brightness, makes
candidates. A path earns each one's clearness (but only so much that no single one decides), and pays for rising or
falling, and more for a jump, such as over a groove's edge, or for being nowhere. The best of all paths is found exactly
(Viterbi 1967). Its steps are products of matrices in which max stands for the sum and + for the product. These are
associative, so neighbours are merged in pairs, and all pairs at once (Hassan, Sarkka and Garcia-Fernandez, Temporal
parallelization of inference in hidden Markov models, 2021).
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped, UInt

from weldcell.tracking.cell_noise import NoiseModel
from weldcell.tracking.stripe_faint import STEEPEST_CELLS
from weldcell.tracking.stripe_pieces import in_long_pieces

_TOGETHER, _SHEARS = 2, (-1, 0, 1)  # columns on both sides that are summed, along so many rows a column
_SIDE_ROWS = (2, 4)  # 8 to 16 px off: clear of a stripe of 3 px sigma, and not of a patch 24 px wide
_FAR_ROWS = (3, 5)  # that tell how the light falls towards a core
_STRIDE = 4  # columns a step
_CANDIDATES, _APART = 3, 3  # rows on both sides of a candidate that give no other one
_LEAST_SNR = 2.0
_WORTH_SNR, _MOST_SNR = 3.0, 6.0  # the clearest of a column's noise is worth nothing
_BRIGHTER_WORTH = 0.6  # of what is e times as clear as that: decides between what is clear anyway
_BEND_COST, _JUMP_COST, _FALL_COST = 0.2, 12.0, 0.1  # the first and the last for each row
_FEWEST_STEPS, _MOST_GAP = 6, 2  # of a piece, and steps from one of its places to the next
_ROUNDING = 0.5


def over_slopes(cores: Shaped[np.ndarray, "rows k"]) -> Shaped[np.ndarray, "rows k"]:
    """What stands out of both its sides, and out of the slope of light that they are on.

    A core is compared with its sides' mean, which is right on a slope, but half of an edge; and with each side, less
    what the light falls towards the core, as far as it falls on alike behind it: an edge does not.
    """
    reach, count = _FAR_ROWS[1], len(cores)
    padded = cv2.copyMakeBorder(cores, reach, reach, 0, 0, cv2.BORDER_REPLICATE)
    smooth = cv2.blur(padded, (2 * _TOGETHER + 1, 1))
    (far_above, above, below, far_below) = (
        smooth[reach + row :][:count] for row in (-_FAR_ROWS[1], -_FAR_ROWS[0], *_FAR_ROWS)
    )
    falls = (
        cv2.min(cv2.subtract(far_above, above), cv2.subtract(below, far_below)),
        cv2.min(cv2.subtract(far_below, below), cv2.subtract(above, far_above)),
    )
    expected = np.zeros_like(cores)
    for rows in _SIDE_ROWS:
        above, below = padded[reach - rows :][:count], padded[reach + rows :][:count]
        cv2.max(expected, cv2.addWeighted(above, 0.5, below, 0.5, 0.0), dst=expected)
        for side, fall in zip((above, below), falls, strict=True):
            for _ in range(rows // (_FAR_ROWS[1] - _FAR_ROWS[0])):
                side = cv2.subtract(side, fall)
            cv2.max(expected, side, dst=expected)
    return cv2.subtract(cores, expected)


def stripe_path(
    response: Shaped[np.ndarray, "rows k"], cores: Shaped[np.ndarray, "rows k"], noise: NoiseModel
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Columns and rows that the best path goes through, in every fourth column where it is anywhere.

    `response` is what stands out of its surroundings, `cores` how bright it is.
    """
    light = _summed(response)
    level = cv2.transpose(cores)[::_STRIDE]
    sigma = np.sqrt(2 * _TOGETHER + 1) * noise.sigma(np.arange(int(cores.max()) + 1.0))
    least = _ROUNDING * (2 * _TOGETHER + 1) + _LEAST_SNR * sigma
    light -= np.minimum(light, np.rint(least).astype(light.dtype).take(level))
    each = np.arange(len(light))
    rows = _brightest(light)
    found = light[each[:, None], rows]
    at = level[each[:, None], rows]
    snr = np.where(found > 0, (found + least[at]) / np.maximum(sigma[at], 1e-9), -np.inf)
    states = best_states(_worth(snr), _costs(rows))
    each = np.flatnonzero(states < rows.shape[1])
    chosen = rows[each, states[each]]
    kept = _in_runs(each, chosen)
    return _STRIDE * each[kept], chosen[kept]


def _in_runs(steps: Int[np.ndarray, "n"], rows: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
    """Which places are part of a piece: what stands out in fewer columns is no stripe."""
    if len(steps) == 0:
        return np.zeros(0, bool)
    gaps = np.diff(steps)
    broken = (gaps > _MOST_GAP) | (np.abs(np.diff(rows)) > 1 + STEEPEST_CELLS * _STRIDE * gaps)
    return in_long_pieces(broken, _FEWEST_STEPS)


def _summed(response: Shaped[np.ndarray, "rows k"]) -> UInt[np.ndarray, "n rows"]:
    """The largest of the sums over five columns, level, rising or falling, about every fourth one."""
    height, width = response.shape
    apart = _TOGETHER * max(_SHEARS)
    padded = np.zeros(
        (width + 2 * _TOGETHER, height + 2 * apart), np.uint16 if response.dtype == np.uint8 else np.uint32
    )
    padded[_TOGETHER:-_TOGETHER, apart : apart + height] = cv2.transpose(response)
    largest = np.zeros((-(-width // _STRIDE), height), padded.dtype)
    for shear in _SHEARS:
        first, *others = (
            padded[_TOGETHER + aside : _TOGETHER + aside + width : _STRIDE, apart + shear * aside :][:, :height]
            for aside in range(-_TOGETHER, _TOGETHER + 1)
        )
        total = first + others[0]
        for other in others[1:]:
            total += other
        np.maximum(largest, total, out=largest)
    return largest


def _brightest(light: UInt[np.ndarray, "n rows"]) -> Int[np.ndarray, "n few"]:
    """The brightest rows of each step, with none beside another."""
    each, around = np.arange(len(light))[:, None], np.arange(-_APART, _APART + 1)
    left = cv2.copyMakeBorder(light, 0, 0, _APART, _APART, cv2.BORDER_CONSTANT, value=0)
    rows = np.empty((len(light), _CANDIDATES), np.int64)
    for k in range(_CANDIDATES):
        rows[:, k] = left.argmax(axis=1)
        left[each, rows[:, k, None] + around] = 0  # where nothing is left this does nothing
    return np.maximum(rows - _APART, 0)


def _worth(snr: Float[np.ndarray, "n few"]) -> Float[np.ndarray, "n states"]:
    """What a path earns at each candidate, and, last, nowhere."""
    nowhere = np.zeros((len(snr), 1))
    brighter = _BRIGHTER_WORTH * np.log(np.maximum(snr / _MOST_SNR, 1.0))
    return np.concatenate([np.minimum(snr, _MOST_SNR) - _WORTH_SNR + brighter, nowhere], axis=1)


def _costs(rows: Int[np.ndarray, "n few"]) -> Float[np.ndarray, "steps states states"]:
    """What each step from one candidate to one of the next column's costs; nowhere is half a jump away."""
    few = rows.shape[1]
    costs = np.full((len(rows) - 1, few + 1, few + 1), _JUMP_COST / 2)
    costs[:, few, few] = 0.0
    fall = np.abs(rows[1:, None, :] - rows[:-1, :, None])
    joined = fall <= 1 + STEEPEST_CELLS * _STRIDE
    costs[:, :few, :few] = np.where(joined, _BEND_COST * fall, _JUMP_COST + _FALL_COST * fall)
    return costs


def best_states(
    worth: Float[np.ndarray, "n states"], costs: Float[np.ndarray, "steps states states"]
) -> Int[np.ndarray, "n"]:
    """The states, one for each step, whose worths less the costs between them have the largest sum."""
    steps, states = len(costs), np.arange(worth.shape[1])
    gains = np.full((len(states), len(states), 1 << max(steps - 1, 0).bit_length()), -np.inf)  # from, to, step
    gains[states, states] = 0.0  # beyond the last step nothing changes
    gains[:, :, :steps] = (worth[1:, None, :] - costs).transpose(1, 2, 0)
    gains[:, :, 0] += worth[0, :, None]
    halves = []
    while gains.shape[2] > 1:
        first, second = gains[:, :, 0::2], gains[:, :, 1::2]
        halves.append((first, second))
        gains = (first.transpose(1, 0, 2)[:, :, None] + second[:, None]).max(axis=0)  # over the state between
    ends = np.array(divmod(int(gains.argmax()), len(states)))
    for first, second in reversed(halves):
        each = np.arange(first.shape[2])
        found = np.empty(2 * len(ends) - 1, np.int64)
        found[0::2], found[1::2] = ends, (first[ends[:-1], :, each] + second[:, ends[1:], each].T).argmax(axis=1)
        ends = found
    return ends[: steps + 1]

"""Which regions of a thresholded picture are the stripe: those that follow one another along it at its own level.

The longest such chain is the stripe's pieces on the surface. A groove's bottom, spatter and ghosts are regions too, but
lie off the level of what is to either side of them, so that no chain runs through them and on.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

_MOST_REGIONS = 80
_STEEPEST = 0.2  # of a gap: a stripe that leans by 11 degrees runs on
_WIDEST_SHARE = 1 / 3  # of the picture: a wider gap is no seam
_LEVEL_WIDTHS = 4  # of a region's end, whose mean row is its level


@dataclass(frozen=True, kw_only=True, eq=False)
class StripeChain:
    """The stripe's pieces in a picture whose stripe runs along rows, from left to right."""

    pieces: UInt8[np.ndarray, "height width"]
    """Mask (0 and 255) of all pieces."""
    gaps_px: Float[np.ndarray, "k"]
    """Dark columns between each piece and the next; negative where they overlap."""
    steps_px: Float[np.ndarray, "k"]
    """How much deeper in the picture each next piece begins."""
    found: bool
    """Whether there is any piece."""


def stripe_chain(mask: UInt8[np.ndarray, "height width"], width_px: float, *, least_region_px: int) -> StripeChain:
    """The chain of regions that covers most of the picture's columns.

    A link costs as much as it steps up or down, and a stripe width: a speck in a gap does not pay for itself.
    """
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    largest = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")[:_MOST_REGIONS]
    chosen = largest[stats[largest, cv2.CC_STAT_AREA] >= least_region_px]
    chosen = chosen[np.argsort(stats[chosen, cv2.CC_STAT_LEFT], kind="stable")]
    first = stats[chosen, cv2.CC_STAT_LEFT].astype(float)
    last = first + stats[chosen, cv2.CC_STAT_WIDTH] - 1
    levels = _end_levels(labels, chosen, first, last, _LEVEL_WIDTHS * width_px)
    chain = _longest_chain(first, last, levels, width_px, _WIDEST_SHARE * mask.shape[1])
    kept = np.zeros(len(stats), np.uint8)
    kept[chosen[chain]] = 255
    before, after = chain[:-1], chain[1:]
    return StripeChain(
        pieces=kept[labels],
        gaps_px=first[after] - last[before] - 1,
        steps_px=levels[after, 0] - levels[before, 1],
        found=len(chain) > 0,
    )


def _end_levels(
    labels: Int[np.ndarray, "height width"],
    chosen: Int[np.ndarray, "k"],
    first: Float[np.ndarray, "k"],
    last: Float[np.ndarray, "k"],
    reach_px: float,
) -> Float[np.ndarray, "k 2"]:
    """Mean row of each chosen region about its left and its right end."""
    place = np.full(int(labels.max()) + 1, -1)
    place[chosen] = np.arange(len(chosen))
    rows, columns = np.nonzero(labels)
    region = place[labels[rows, columns]]
    rows, columns, region = rows[region >= 0], columns[region >= 0], region[region >= 0]
    levels = np.zeros((len(chosen), 2))
    for side, near in enumerate((columns < first[region] + reach_px, columns > last[region] - reach_px)):
        total = np.bincount(region[near], weights=rows[near], minlength=len(chosen))
        levels[:, side] = total / np.bincount(region[near], minlength=len(chosen))
    return levels


def _longest_chain(
    first: Float[np.ndarray, "k"],
    last: Float[np.ndarray, "k"],
    levels: Float[np.ndarray, "k 2"],
    width_px: float,
    widest_px: float,
) -> Int[np.ndarray, "m"]:
    """Places of the regions (ordered by `first`) that make the chain of most columns, less what its links cost."""
    score, before = last - first + 1, np.full(len(first), -1)
    for this in range(1, len(first)):
        gaps = first[this] - last[:this] - 1
        steps = np.abs(levels[this, 0] - levels[:this, 1])
        joins = (gaps > -width_px) & (gaps <= widest_px) & (steps <= width_px + _STEEPEST * np.maximum(gaps, 0))
        gain = np.where(joins, score[:this] - steps - width_px, 0.0)
        if gain.max() > 0:
            before[this] = int(gain.argmax())
            score[this] += gain.max()
    chain = [int(score.argmax())] if len(score) else []
    while chain and before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1], dtype=int)

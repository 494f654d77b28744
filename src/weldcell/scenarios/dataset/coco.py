"""COCO keypoints: one annotation a picture, with the seam's features, the stripe's box and its mask.

Keypoints are in pixels, (0, 0) being the centre of the top-left pixel, as everywhere in weldcell and as pycocotools'
masks count pixels; the box reaches from the corner of its first pixel to the corner of its last, as `toBbox` gives it.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Int

from weldcell.sensor_sim.labels import FrameTruth

Annotation = dict[str, Any]

_CATEGORY = 1
_MOST_GROUPS = 7  # of five bits, for a run of up to 2^34 pixels


def annotation(truth: FrameTruth, frame: int) -> Annotation | None:
    """The annotation of one frame; None where no stripe is in the picture."""
    if not truth.stripe_mask.any():
        return None
    visibility = truth.features.visibility
    keypoints = np.column_stack([np.where(visibility[:, None] > 0, truth.features.pixels, 0.0), visibility])
    return {
        "id": picture_id(frame),
        "image_id": picture_id(frame),
        "category_id": _CATEGORY,
        "keypoints": [int(value) if value.is_integer() else float(value) for value in keypoints.ravel()],
        "num_keypoints": int(np.count_nonzero(visibility)),
        "bbox": box(truth.stripe_mask),
        "area": int(truth.stripe_mask.sum()),
        "segmentation": run_lengths(truth.stripe_mask),
        "iscrowd": 0,
    }


def picture_id(frame: int) -> int:
    """COCO's number of a frame's picture and annotation: from 1, since evaluations take 0 for none."""
    return frame + 1


def document(
    pictures: Sequence[Mapping[str, Any]], annotations: Iterable[Annotation], features: Sequence[str], version: str
) -> dict[str, Any]:
    """The whole annotation file; `pictures` have id, file_name, width and height."""
    chain = [[k + 1, k + 2] for k in range(len(features) - 1)]
    seam = {"id": _CATEGORY, "name": "seam", "supercategory": "seam", "keypoints": list(features), "skeleton": chain}
    return {
        "info": {"description": "Laser stripe on a weld seam, simulated by weldcell", "version": version},
        "licenses": [],
        "categories": [seam],
        "images": list(pictures),
        "annotations": list(annotations),
    }


def box(mask: Bool[np.ndarray, "height width"]) -> list[int]:
    """Left, top, width and height of a mask that is not empty."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    left, top = int(columns[0]), int(rows[0])
    return [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1]


def run_lengths(mask: Bool[np.ndarray, "height width"]) -> dict[str, Any]:
    """The mask in pycocotools' compressed run-length code: runs of 0 and 1 in turn, column by column."""
    flat = np.concatenate([[0], mask.ravel(order="F"), [0]]).astype(np.int8)
    counts = np.diff(np.concatenate([[0], np.flatnonzero(np.diff(flat)), [mask.size]]))
    if counts[-1] == 0 and len(counts) > 1:
        counts = counts[:-1]
    return {"size": list(mask.shape), "counts": _packed(counts)}


def _packed(counts: Int[np.ndarray, "n"]) -> str:
    """Counts as text, each less the last but one, in groups of five bits, low ones first (`rleToString`)."""
    rest = counts.copy()
    rest[3:] -= counts[1:-2]
    groups = np.zeros((len(rest), _MOST_GROUPS), np.uint8)
    more = np.ones(len(rest), bool)
    for k in range(_MOST_GROUPS):
        low = rest & 0x1F
        rest = rest >> 5
        last = np.where(low & 0x10, rest == -1, rest == 0)
        groups[:, k] = np.where(more, (low | np.where(last, 0, 0x20)) + 48, 0)
        more = more & ~last
    return groups[groups > 0].tobytes().decode("ascii")

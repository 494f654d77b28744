"""YOLO-pose: a text line a picture (class, box, keypoints with visibility) and the file that describes the set.

Coordinates are shares of the picture from its outer corner, so the centre of the top-left pixel is at half a pixel.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from weldcell.scenarios.dataset.coco import box
from weldcell.sensor_sim.labels import FrameTruth


def label(truth: FrameTruth) -> str:
    """The label file's content; empty where no stripe is in the picture."""
    if not truth.stripe_mask.any():
        return ""
    height_px, width_px = truth.stripe_mask.shape
    left, top, box_width, box_height = box(truth.stripe_mask)
    size = np.array([width_px, height_px])
    centre = (np.array([left, top]) + np.array([box_width, box_height]) / 2) / size
    numbers = [*centre, box_width / width_px, box_height / height_px]
    for pixel, visibility in zip((truth.features.pixels + 0.5) / size, truth.features.visibility, strict=True):
        numbers += [*(pixel if visibility else (0.0, 0.0)), int(visibility)]
    return "0 " + " ".join(f"{number:.8g}" for number in numbers) + "\n"


def description(features: Sequence[str]) -> dict[str, Any]:
    """The content of data.yaml: one split, which the user may divide."""
    return {
        "path": ".",
        "train": "images",
        "val": "images",
        "names": ["seam"],
        "kpt_shape": [len(features), 3],
        "keypoint_names": list(features),
    }

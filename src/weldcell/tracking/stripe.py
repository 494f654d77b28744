"""The laser stripe of a picture: its centre in each column (or row) to a fraction of a pixel, with its deviation."""

from typing import Literal

import cv2
import numpy as np
from jaxtyping import Shaped

from weldcell.cell.errors import BadInput
from weldcell.cell.profile import Stripe
from weldcell.tracking.stripe_centre import measure
from weldcell.tracking.stripe_search import CELL_COLUMNS, search
from weldcell.tracking.stripe_steps import parted_at_steps

Along = Literal["rows", "columns"]
"""What the stripe of a flat surface runs along."""


def find_stripe(
    image: np.ndarray,
    *,
    along: Along = "rows",
    speckle_contrast: float | None = None,
) -> Stripe:
    """The strongest stripe of each column (of each row, if it runs along columns), where there is a clear one.

    `image` has one channel of 8 or 16 bits (BadInput otherwise); cameras' 10 to 14 bits come as 16. A stripe that runs
    diagonally is found either way. `sigma_px` follows from the picture's noise and from the speckle contrast (standard
    deviation over mean of one pixel's brightness), which is measured on the stripe's own roughness unless it is given.
    """
    grey = _prepared(image, along)
    rough = search(grey)
    if rough is None:
        return Stripe(u_px=np.zeros(0), v_px=np.zeros(0), sigma_px=np.zeros(0), amplitude_grey=np.zeros(0))
    centres = measure(grey, parted_at_steps(grey, rough), speckle_contrast=speckle_contrast)
    keep = centres.columns < image.shape[1 if along == "rows" else 0]
    along_px, across_px = centres.columns[keep].astype(float), centres.v_px[keep]
    u_px, v_px = (along_px, across_px) if along == "rows" else (across_px, along_px)
    return Stripe(u_px=u_px, v_px=v_px, sigma_px=centres.sigma_px[keep], amplitude_grey=centres.amplitude_grey[keep])


def _prepared(image: np.ndarray, along: Along) -> Shaped[np.ndarray, "height width"]:
    """The picture with the stripe along its rows, of an even width."""
    grey = _levels(image)
    if along == "columns":
        grey = np.ascontiguousarray(grey.T) if grey.size == 0 else cv2.transpose(grey)
    if grey.shape[1] % CELL_COLUMNS and grey.size:
        grey = cv2.copyMakeBorder(grey, 0, 0, 0, 1, cv2.BORDER_REPLICATE)
    return grey


def _levels(image: np.ndarray) -> Shaped[np.ndarray, "height width"]:
    """The picture in steps of one: cameras write 12 bits into 16 shifted, programs 8 bits times 257."""
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
        raise BadInput(
            f"stripe: expected a grey picture of 8 or 16 bits, found shape {image.shape}, type {image.dtype}"
        )
    image = np.ascontiguousarray(image)
    if image.dtype == np.uint8 or image.size == 0:
        return image
    step = int(np.gcd.reduce(image[:: max(1, len(image) // 64)], axis=None))
    if step <= 1 or np.any(image % step):
        return image
    image = image // np.uint16(step)
    return image.astype(np.uint8) if image.max() <= 255 else image

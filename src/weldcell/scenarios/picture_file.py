"""The user's own pictures: PNG, JPEG, TIFF or BMP, grey or colour, 8 or 16 bits, checked before they are decoded."""

import struct
import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Shaped
from PIL import Image

from weldcell.cell.errors import BadInput

LARGEST_PIXELS = 64_000_000
LARGEST_SIDE_PX = 32_768
_FORMATS = ("PNG", "JPEG", "TIFF", "BMP")
_LARGEST = f"at most {LARGEST_PIXELS // 10**6} million, {LARGEST_SIDE_PX} to a side"
_EXPECTED = "expected a picture in PNG, JPEG, TIFF or BMP"
_BROKEN = (OSError, ValueError, SyntaxError, EOFError, struct.error)  # Pillow's ways


def check_picture(path: Path) -> None:
    """Refuses what is no picture, or one too large, by the file's header alone."""
    with _opened(path):
        pass


def read_picture(path: Path) -> Shaped[np.ndarray, "height width *channels"]:
    """The picture as it is stored: grey (height, width) or RGB (height, width, 3), of 8 or 16 bits.

    Transparency is left out, and a camera's note that the picture should be turned (EXIF) is not followed: pixels are
    counted as they are stored. Pillow checks that the file is whole, as OpenCV fills up a truncated one; OpenCV
    decodes, as Pillow cuts 16-bit colours to 8.
    """
    with _opened(path) as image:
        try:
            image.load()
        except _BROKEN as error:
            raise BadInput(f"{path}: found a picture that is damaged or cut short ({error})") from None
    decoded = cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise BadInput(f"{path}: found a picture that cannot be decoded, {_EXPECTED}")
    if decoded.dtype not in (np.uint8, np.uint16):
        raise BadInput(f"{path}: found pixels of type {decoded.dtype}, expected 8 or 16 bits")
    if decoded.ndim == 3:
        decoded = decoded[..., 0] if decoded.shape[2] < 3 else decoded[..., 2::-1]  # OpenCV's order is blue first
    return np.ascontiguousarray(decoded)


def _opened(path: Path) -> Any:
    """Pillow's picture, of which only the header has been read."""
    if not path.exists():
        raise BadInput(f"{path}: no such file, {_EXPECTED}")
    if not path.is_file():
        raise BadInput(f"{path}: found {'a folder' if path.is_dir() else 'no plain file'}, {_EXPECTED}")
    if path.stat().st_size == 0:
        raise BadInput(f"{path}: found an empty file, {_EXPECTED}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about large pictures, which are refused below, and odd metadata
            image = Image.open(path, formats=_FORMATS)
    except PermissionError:
        raise
    except Image.DecompressionBombError:
        raise BadInput(f"{path}: found far too many pixels, expected {_LARGEST}") from None
    except _BROKEN:
        raise BadInput(f"{path}: found no picture that can be read, {_EXPECTED}") from None
    width, height = image.size
    pages = getattr(image, "n_frames", 1)
    if width * height > LARGEST_PIXELS or max(width, height) > LARGEST_SIDE_PX or pages > 1:
        image.close()
        if pages > 1:
            raise BadInput(f"{path}: found {pages} pictures in one file, expected one")
        raise BadInput(f"{path}: found {width} x {height} pixels, expected {_LARGEST}")
    return image

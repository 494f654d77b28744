"""How near the stripe's centre comes to what its picture tells at best: the Cramer-Rao bound at four noise levels."""

import numpy as np
from tests.tracking.line_pictures import centre_bound_px, noisy_line

from benchmarks.table import Figure
from weldcell.tracking.stripe import find_stripe

LEVELS: dict[str, dict[str, float]] = {
    "bright, quiet camera": {"peak_grey": 200.0, "read_grey": 0.5},
    "dim, quiet camera": {"peak_grey": 60.0, "read_grey": 1.0},
    "dim, noisy camera": {"peak_grey": 60.0, "read_grey": 4.0},
    "dim, read noise only": {"peak_grey": 50.0, "read_grey": 2.0, "electrons_per_grey": float("inf")},
}
"""Levels of 255; 41 electrons for a level unless it says otherwise, as the sensor's."""
SIGMAS_PX = (0.8, 1.2, 2.0, 3.5)
PICTURES, COLUMNS = 6, 1440


def figures() -> list[Figure]:
    """Error (rms) of the extracted centres over the bound, for each noise level and width of the stripe."""
    return [
        Figure(
            name=f"{name}, stripe of {sigma_px:g} px sigma",
            value=_over_bound(level | {"sigma_px": sigma_px}),
            unit="of the bound",
            at_most=1.3,
        )
        for name, level in LEVELS.items()
        for sigma_px in SIGMAS_PX
    ]


def _over_bound(level: dict[str, float]) -> float:
    rng = np.random.default_rng(1)
    squares, bounds = [], []
    for _ in range(PICTURES):
        centre_px = 150 + rng.random() + 40 * np.linspace(0, 1, COLUMNS)  # all sub-pixel phases, many times
        stripe = find_stripe(noisy_line(centre_px, rng=rng, **level))
        columns = stripe.u_px.astype(int)
        squares.append((stripe.v_px - centre_px[columns]) ** 2)
        bounds.append(centre_bound_px(centre_px[columns[::30]], **level) ** 2)
    return float(np.sqrt(np.mean(np.concatenate(squares)) / np.mean(np.concatenate(bounds))))

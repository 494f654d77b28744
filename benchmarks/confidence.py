"""`python -m benchmarks.confidence`: fits the weights of `weldcell.tracking.confidence` and prints them.

Every feature of every joint that a finder reports, at all levels of noise and with strays, is right or wrong: within
0.15 mm of the true one, or not. The weights are those of the greatest likelihood. How well they hold on other seeds is
counted in bins: of the features that claim 0.8 to 0.9, that share should be right.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from rich.console import Console
from scipy.optimize import minimize

from benchmarks.table import Grid, show_grid
from joint_pictures import NOMINAL, LabelledPicture, labelled_pictures
from weldcell.cell.profile import Stripe
from weldcell.cell.randomness import generator
from weldcell.tracking.confidence import RIGHT_WITHIN_M, WEIGHTS, grounds, probability
from weldcell.tracking.joint import JOINT_KINDS
from weldcell.tracking.section import section_of
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate

TUNING_SEEDS = range(1, 7)
TRACKS, COUNTED = 3, 1
STRAYS = (0.1, 0.25, 0.4, 0.55)
"""Shares of columns that show something else, half of them in runs, on top of nominal pictures."""
BIN_EDGES = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0])
_STRAY_PX = 150.0
_PENALTY = 1e-3  # on the squared weights: keeps what hardly matters near 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Claims:
    """Features that finders reported, one entry each."""

    grounds: Float[np.ndarray, "n k"]
    right: Bool[np.ndarray, "n"]


def claims(seeds: Sequence[int]) -> Claims:
    """What the finders report of pictures at all levels, and with strays."""
    rows = [row for seed in seeds for row in _claims_of(seed)]
    sigma_m, support, error_m = np.array(rows).T
    return Claims(grounds=grounds(sigma_m, support), right=error_m <= RIGHT_WITHIN_M)


def fitted(told: Claims) -> Float[np.ndarray, "k"]:
    """The weights of the greatest likelihood, lightly penalised."""

    def cost(weights: Float[np.ndarray, "k"]) -> tuple[float, Float[np.ndarray, "k"]]:
        score, free = told.grounds @ weights, np.append(0.0, weights[1:])
        gradient = told.grounds.T @ (probability(told.grounds, weights) - told.right) / len(score)
        loss = np.mean(np.logaddexp(0, score) - told.right * score) + _PENALTY * free @ free
        return float(loss), gradient + 2 * _PENALTY * free

    return np.asarray(minimize(cost, np.zeros(told.grounds.shape[1]), jac=True).x)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reliability:
    """Claimed probabilities against what came true, in bins of the claim."""

    count: Float[np.ndarray, "bins"]
    claimed: Float[np.ndarray, "bins"]
    """Mean claim of each bin; NaN in an empty one."""
    right: Float[np.ndarray, "bins"]
    """Share that was right."""
    brier: float
    """Mean squared difference of claim and truth."""
    calibration_error: float
    """Mean difference of claimed and true share over the bins, weighted by their counts."""

    def grid(self) -> Grid:
        """As a table."""
        rows = [
            (f"{low:.2f} to {high:.2f}", f"{count:.0f}", f"{claimed:.3f}", f"{right:.3f}")
            for low, high, count, claimed, right in zip(
                BIN_EDGES[:-1], BIN_EDGES[1:], self.count, self.claimed, self.right, strict=True
            )
            if count
        ]
        return Grid(title="Confidence against truth", columns=("claimed", "features", "mean claim", "right"), rows=rows)


def reliability(claimed: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> Reliability:
    """How claims hold."""
    bins = len(BIN_EDGES) - 1
    place = np.clip(np.searchsorted(BIN_EDGES, claimed, side="right") - 1, 0, bins - 1)
    count, claims_sum, right_sum = (
        np.bincount(place, weights=weights, minlength=bins)
        for weights in (np.ones(len(claimed)), claimed, right.astype(float))
    )
    filled = np.where(count > 0, count, np.nan)
    return Reliability(
        count=count,
        claimed=claims_sum / filled,
        right=right_sum / filled,
        brier=float(np.mean((claimed - right) ** 2)),
        calibration_error=float(np.abs(claims_sum - right_sum).sum() / len(claimed)),
    )


def with_strays(stripe: Stripe, share: float, height_px: int, rng: np.random.Generator) -> Stripe:
    """The stripe with this share of its columns elsewhere, single ones and runs of three to seven."""
    v_px, count = stripe.v_px.copy(), len(stripe.v_px)
    single = rng.random(count) < share / 2
    v_px[single] += rng.uniform(-_STRAY_PX, _STRAY_PX, int(single.sum()))
    for _ in range(int(share / 2 * count / 5)):
        at, length = rng.integers(count), rng.integers(3, 8)
        v_px[at : at + length] = v_px[at : at + length].mean() + rng.uniform(-_STRAY_PX, _STRAY_PX)
    keep = (v_px >= 0) & (v_px <= height_px - 1)
    amplitude = None if stripe.amplitude_grey is None else stripe.amplitude_grey[keep]
    return replace(
        stripe, u_px=stripe.u_px[keep], v_px=v_px[keep], sigma_px=stripe.sigma_px[keep], amplitude_grey=amplitude
    )


def _claims_of(seed: int) -> Iterator[tuple[float, float, float]]:
    for labelled in labelled_pictures(seed, tracks=TRACKS, counted=COUNTED):
        stripe = find_stripe(labelled.picture)
        yield from _judged(labelled, stripe)
        if labelled.level == NOMINAL:
            rng = generator(seed, f"detectors/{labelled.kind}/{labelled.track}/strays", labelled.frame)
            for share in STRAYS:
                yield from _judged(labelled, with_strays(stripe, share, labelled.camera.height_px, rng))


def _judged(labelled: LabelledPicture, stripe: Stripe) -> Iterator[tuple[float, float, float]]:
    """Sigma, support and error of each feature."""
    joint, plane, truth = JOINT_KINDS[labelled.kind], labelled.plane, labelled.truth
    profile = triangulate(stripe, labelled.camera, plane)
    if not profile.valid.any():
        return
    found = joint.find(section_of(profile, plane), None)
    if found.trust is None:
        return
    for name, corner in zip(joint.names, found.corners, strict=True):
        at_camera = plane.T_camera_laser.apply([corner.x_m, 0.0, corner.z_m])
        error_m = float(np.linalg.norm(at_camera - truth.points_camera[truth.names.index(name)]))
        yield corner.sigma_m, float(found.trust.support), error_m


def main() -> None:
    """Prints the weights, and how well they and those in use hold on the seeds that they come from."""
    told = claims(TUNING_SEEDS)
    weights = fitted(told)
    console = Console()
    console.print(f"WEIGHTS = np.array({weights.round(2).tolist()})  # of {len(told.right)} features", highlight=False)
    for name, used in (("fitted", weights), ("in use", WEIGHTS)):
        held = reliability(probability(told.grounds, used), told.right)
        console.print(f"{name}: Brier score {held.brier:.3f}, calibration error {held.calibration_error:.3f}")
        show_grid(console, held.grid())


if __name__ == "__main__":
    main()

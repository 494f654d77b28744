"""Where the part really is while it is welded: misplaced from the start, and drifting from when the arc is lit."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.configuration import WeldConfig
from weldcell.cell.frames import rigid_from, translation
from weldcell.cell.randomness import generator
from weldcell.cell.seam import Seam

_RISE_SHARE = 0.3  # of the drift's vertical part against a horizontal one: a clamped plate moves mostly in its plane
_WARMING_SHARE = 0.5  # of the weld's time: heat first moves the part fast, then slower (1 - exp)


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingPart:
    """The actual part over time, and its exact seam."""

    T_base_told: RigidTransform
    """Where the controller was told that it lies."""
    misplacement: RigidTransform
    """The part before the arc was lit, in that frame."""
    drift_base: Float[np.ndarray, "3"]
    """How far it has moved when the weld is over, m."""
    weld_s: float
    """How long the weld takes, from arc on to arc off."""
    seam_part: Seam
    """The exact seam's middle line as the feature `middle`, with its approach."""

    def T_base_part(self, arc_s: float) -> RigidTransform:
        """Where the part is so many seconds after the arc was lit (0 before that)."""
        warm_s = _WARMING_SHARE * self.weld_s
        share = (1 - np.exp(-max(arc_s, 0.0) / warm_s)) / (1 - np.exp(-self.weld_s / warm_s))
        return translation(share * self.drift_base) * self.T_base_told * self.misplacement


def misplaced(config: WeldConfig, seed: int) -> RigidTransform:
    """How the part stands in the frame that the controller was told: shifted and turned by the configured amounts."""
    rng = generator(seed, "weld/misplacement")
    towards_rad, sign = rng.uniform(0, 2 * np.pi), rng.choice([-1.0, 1.0])
    shift_told = 1e-3 * config.misplacement_mm * np.array([np.cos(towards_rad), np.sin(towards_rad), 0.0])
    return rigid_from(Rotation.from_euler("z", sign * config.misplacement_deg, degrees=True), shift_told)


def drift_base(config: WeldConfig, seed: int) -> Float[np.ndarray, "3"]:
    """Where the heat moves the part until the weld's end, m."""
    direction = generator(seed, "weld/drift").normal(size=3) * [1.0, 1.0, _RISE_SHARE]
    drift: Float[np.ndarray, "3"] = 1e-3 * config.drift_mm * direction / np.linalg.norm(direction)
    return drift

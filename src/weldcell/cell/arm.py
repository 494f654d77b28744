"""The arm as its controller believes it to be: plain numbers, without a simulator."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.errors import BadGeometry


@dataclass(frozen=True, kw_only=True, eq=False)
class NominalArm:
    """A serial arm of k revolute joints at reading zero, as a product of exponentials needs it."""

    axes_base: Float[np.ndarray, "k 3"]
    """Unit vectors along the joint axes; a positive reading turns right-handed about them."""
    anchors_base: Float[np.ndarray, "k 3"]
    """A point on each joint axis (m)."""
    T_base_flange_zero: RigidTransform
    """The flange."""
    link_masses_kg: Float[np.ndarray, "k"]
    """Mass that each joint carries up to the next one; the last holds the tools as well."""
    link_centres_base: Float[np.ndarray, "k 3"]
    """Centre of each of these masses (m)."""

    def __post_init__(self) -> None:
        count = len(self.axes_base)
        for name in ("axes_base", "anchors_base", "link_centres_base"):
            values = getattr(self, name)
            if np.shape(values) != (count, 3) or not np.isfinite(values).all():
                raise BadGeometry(f"arm: {name} has shape {np.shape(values)}, expected ({count}, 3) finite numbers")
        if np.abs(np.linalg.norm(self.axes_base, axis=1) - 1).max() > 1e-6:
            raise BadGeometry("arm: axes_base are not unit vectors")
        if np.shape(self.link_masses_kg) != (count,) or not np.all(np.asarray(self.link_masses_kg) >= 0):
            raise BadGeometry(f"arm: expected {count} link masses, none below 0")

    @property
    def joints(self) -> int:
        """How many joints it has."""
        return len(self.axes_base)

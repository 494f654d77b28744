"""What a joint's cross-section consists of.

A section lies in the plane perpendicular to the seam: its first axis points to the left of travel, the second upright.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

JointKind = Literal["butt", "v", "v-gap", "bevel", "u", "j", "lap", "fillet", "corner"]


@dataclass(frozen=True, kw_only=True)
class JointSize:
    """A joint's sizes; each kind reads those that it has."""

    thickness_m: float
    """Of the plates; of a lap and a fillet: of the lower plate."""
    groove_angle_rad: float = np.pi / 3
    """Between both walls of the groove."""
    root_gap_m: float = 0.0
    """Between the members at the root; of a lap and a fillet: between the plates, upright."""
    root_face_m: float = 0.0
    """Height of the land below the root."""
    root_radius_m: float = 0.0
    """Of the rounded bottom of a U or J."""
    mismatch_m: float = 0.0
    """How much higher the left member stands."""
    upper_thickness_m: float = 0.0
    """Of a lap's upper plate and of a fillet's web; 0: the lower plate's."""
    rise_m: float = 0.05
    """Height of a fillet's web; length of a corner's plates, along their inner sides."""
    corner_angle_rad: float = np.pi / 2
    """Between both plates of a corner, on the inner side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlateEdge:
    """A plate that reaches from this edge to one side without end."""

    side: Literal[1, -1]
    """1: it lies on the left, -1: on the right."""
    edge: Float[np.ndarray, "k 2"]
    """Its edge from the underside upwards, m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FullPlate:
    """A plate that reaches to both sides without end."""

    low_m: float
    """Height of its underside."""
    high_m: float
    """Height of its upper side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bar:
    """A member with a closed outline."""

    outline: Float[np.ndarray, "k 2"]
    """Counter-clockwise with left on the right-hand side of the page (seen against travel), m."""


Member = PlateEdge | FullPlate | Bar


@dataclass(frozen=True, kw_only=True, eq=False)
class TackShape:
    """How a tack weld fills the section: its outline grows from the first to the last."""

    seed: Float[np.ndarray, "k 2"]
    """At the tack's ends: within the metal, or low in the gap, m."""
    full: Float[np.ndarray, "k 2"]
    """In the tack's middle; both counter-clockwise as a bar's outline, m."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointSection:
    """A joint's cross-section."""

    kind: JointKind
    """Which joint."""
    members: tuple[Member, ...]
    """What is joined; members may touch, never overlap."""
    features: Mapping[str, Float[np.ndarray, "2"]]
    """The features' exact places, m; left to right."""
    approach: Float[np.ndarray, "2"]
    """Unit direction out of the joint: midway between its walls, against which the wire points."""
    tack: TackShape
    """How tack welds fill it."""

    def lowered(self, by_m: float) -> "JointSection":
        """The same section with its origin `by_m` further up."""

        def move(places: Float[np.ndarray, "*k 2"]) -> Float[np.ndarray, "*k 2"]:
            return places - [0, by_m]

        def moved(member: Member) -> Member:
            if isinstance(member, FullPlate):
                return FullPlate(low_m=member.low_m - by_m, high_m=member.high_m - by_m)
            if isinstance(member, Bar):
                return Bar(outline=move(member.outline))
            return PlateEdge(side=member.side, edge=move(member.edge))

        return replace(
            self,
            members=tuple(moved(member) for member in self.members),
            features={name: move(place) for name, place in self.features.items()},
            tack=TackShape(seed=move(self.tack.seed), full=move(self.tack.full)),
        )

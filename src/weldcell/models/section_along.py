"""A joint's section that changes along its path: a gap that opens or closes, a plate that lies askew.

Over a share of the part's length the section goes linearly in x from the first to the last, then it stays the last. Two
things can change, each exactly:

sideways    every point of an outline is led so much further from the path, as a milling cutter would be. So a gap
            changes; where it is 0 the members touch and are one solid.
upwards     a plate whose end is higher lies askew. It is turned as a whole, so its height goes with the x of its own
            points, not with the places on the path that they lie beside; it cannot kink, so it rises over the whole
            length. A bar (a fillet's web) is led along the path, its height like its place.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from weldcell.cell.errors import BadGeometry
from weldcell.models.joint_section import Bar, JointSection, Member, PlateEdge
from weldcell.models.seam_path import SeamPath

_SAME_M = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class SectionAlong:
    """A section as a function of the place on a path."""

    start: JointSection
    """At the part's start."""
    end: JointSection
    """From `end_share` on; of the same kind."""
    length_m: float
    """The part's length along x."""
    end_share: float = 1.0
    """Share of the length over which the section changes."""

    def __post_init__(self) -> None:
        kind = self.start.kind
        if not (np.isfinite(self.end_share) and 0 < self.end_share <= 1):
            raise BadGeometry(f"{kind}: end_share is {self.end_share}, expected it above 0 and at most 1")
        if kind != self.end.kind or _form(self.start) != _form(self.end):
            raise BadGeometry(
                f"{kind}: end_section is another joint ({self.end.kind}), expected the same kind and form"
            )
        if np.abs(self.start.approach - self.end.approach).max() > _SAME_M:
            raise BadGeometry(f"{kind}: end_section leans another way, expected the same angles")
        rises = [rise_m for rise_m in self.rises_m if rise_m != 0]
        if len(rises) > 1 or (rises and self.end_share < 1):
            raise BadGeometry(
                f"{kind}: end_section raises plates, expected one of them, and end_share 1: it can't kink"
            )

    @property
    def rises_m(self) -> list[float]:
        """How much higher each plate's end is than its start; 0 for bars."""
        return [_rise_m(self.start.kind, *pair) for pair in zip(self.start.members, self.end.members, strict=True)]

    @property
    def kink_x(self) -> float:
        """The place on the path where the section is the last one."""
        return self.length_m * (self.end_share - 0.5)

    def share(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """How far the section has changed at places on the path; before the part's start it goes on backwards."""
        return np.minimum((x / self.length_m + 0.5) / self.end_share, 1.0)

    def lift(self, x: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The share of its rise that a plate has at points with these x."""
        return x / self.length_m + 0.5

    def outline(
        self, first: Float[np.ndarray, "k 2"], last: Float[np.ndarray, "k 2"], x: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n k 2"]:
        """An outline at places on the path, given its first and its last form."""
        return first + self.share(x)[:, None, None] * (last - first)

    def features(self, path: SeamPath, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k 3"]:
        """The features beside places on the path, m."""
        first, last = (np.array(list(section.features.values())) for section in (self.start, self.end))
        if not any(self.rises_m):
            return path.frames(x).place(self.outline(first, last, x))
        lines = path.frames(x).place(self.outline(first, np.column_stack([last[:, 0], first[:, 1]]), x))
        lines[..., 2] += self.lift(lines[..., 0]) * (last - first)[:, 1]
        return lines


def _form(section: JointSection) -> list:
    """What both sections must have in common."""
    members = [(type(member), getattr(member, "side", 0), np.shape(_points(member))) for member in section.members]
    return [*members, *section.features, section.tack.seed.shape, section.tack.full.shape]


def _points(member: Member) -> Float[np.ndarray, "k 2"]:
    if isinstance(member, Bar):
        return member.outline
    return member.edge if isinstance(member, PlateEdge) else np.array([(0.0, member.low_m), (0.0, member.high_m)])


def _rise_m(kind: str, first: Member, last: Member) -> float:
    if isinstance(first, Bar):
        return 0.0
    up_m = (_points(last) - _points(first))[:, 1]
    if np.ptp(up_m) > _SAME_M:
        raise BadGeometry(f"{kind}: end_section has plates of another thickness, expected the same")
    rise_m = float(up_m.mean())
    return rise_m if abs(rise_m) > _SAME_M else 0.0

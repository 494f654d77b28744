"""One joint in profile after profile, each looked for where the last one was."""

import math

from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import JointFeatures, Profile
from weldcell.tracking.joint import anchor_x_m, find_joint, not_found

_FORGOTTEN_AFTER = 5
SEARCH_M = 20e-3
"""A part that is misplaced by 10 mm and 3 degrees has its seam, 300 mm long, so near where it was taught."""


class JointFollower:
    """Finds a joint about its last place, and anywhere again when it was not seen there for a while.

    What was found once and not again may have been something else: it is forgotten at once. Before its place is known,
    what lies farther than `search_m` from the middle of the light, where the sensor was aimed, is something else too.
    """

    def __init__(self, kind: str, plane: LaserPlane, *, search_m: float = math.inf) -> None:
        self._kind, self._plane, self._search_m = kind, plane, search_m
        self._last: JointFeatures | None = None
        self._is_sure = False
        self._missed = 0

    def find(self, profile: Profile) -> JointFeatures:
        """The joint's features in the next profile, as `find_joint` gives them."""
        joint = find_joint(profile, self._kind, self._plane, previous=self._last)
        if joint.valid and self._last is None:
            joint = self._if_aimed_at(joint)
        if joint.valid:
            self._is_sure = self._last is not None
            self._last, self._missed = joint, 0
        else:
            self._missed += 1
            if not self._is_sure or self._missed > _FORGOTTEN_AFTER:
                self._last, self._is_sure = None, False
        return joint

    def _if_aimed_at(self, joint: JointFeatures) -> JointFeatures:
        off_m = abs(anchor_x_m(self._kind, self._plane, joint))
        if off_m <= self._search_m:
            return joint
        return not_found(joint.names, f"the only {self._kind} joint lies {off_m * 1e3:.0f} mm from where it should be")

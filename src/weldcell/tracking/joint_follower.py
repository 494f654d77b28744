"""One joint in profile after profile, each looked for where the last one was."""

from weldcell.cell.optics import LaserPlane
from weldcell.cell.profile import JointFeatures, Profile
from weldcell.tracking.joint import find_joint

_FORGOTTEN_AFTER = 5


class JointFollower:
    """Finds a joint about its last place, and anywhere again when it was not seen there for a while.

    What was found once and not again may have been something else: it is forgotten at once.
    """

    def __init__(self, kind: str, plane: LaserPlane) -> None:
        self._kind, self._plane = kind, plane
        self._last: JointFeatures | None = None
        self._is_sure = False
        self._missed = 0

    def find(self, profile: Profile) -> JointFeatures:
        """The joint's features in the next profile, as `find_joint` gives them."""
        joint = find_joint(profile, self._kind, self._plane, previous=self._last)
        if joint.valid:
            self._is_sure = self._last is not None
            self._last, self._missed = joint, 0
        else:
            self._missed += 1
            if not self._is_sure or self._missed > _FORGOTTEN_AFTER:
                self._last, self._is_sure = None, False
        return joint

"""Seam detectors on labelled pictures of rising noise: P1's morphology and the piecewise models, alone and gated.

What is compared is the *seam point* across the seam, as both kinds give one: the middle between the joint's outer
features (left and right; edge and root of a lap; a fillet's root). In the picture that is its u, in space its x in the
laser frame. Morphology's own point is the centroid of what closes the gap; its height depends on what was filled, so
only its place across the seam has a truth. The models' features are judged in full beside it, in both directions.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from jaxtyping import Float

from joint_parts import KINDS
from joint_pictures import LEVELS, LabelledPicture, Level, labelled_pictures
from weldcell.cell.profile import JointFeatures
from weldcell.models.joint_section import JointKind
from weldcell.tracking.joint import find_joint
from weldcell.tracking.morphology import SeamPoint, seam_point
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate

SEED = 101
TRACKS = 6
"""Of each kind: 9 kinds, 6 tracks of 4 counted frames and 10 levels are 2160 pictures."""
MORPHOLOGY, GATED_MORPHOLOGY = "morphology", "morphology, gated"
MODELS, GATED_MODELS = "piecewise models", "piecewise models, gated"
DETECTORS = (MORPHOLOGY, GATED_MORPHOLOGY, MODELS, GATED_MODELS)
_WRONG_M = 1e-3
_REACH_PX = 150.0  # of morphology's gate
_OUTER = {"lap": ("edge", "root"), "fillet": ("root",)}
_LEFT_RIGHT = ("left", "right")


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What one detector made of one picture."""

    detector: str
    kind: JointKind
    level: Level
    valid: bool
    reason: str = ""
    across_px: float = np.nan
    """Error of the seam point along u; all errors are positive, NaN where not valid."""
    across_m: float = np.nan
    """Along x of the laser frame."""
    features_px: Float[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0))
    """Distance of each feature in the picture; empty for morphology."""
    features_m: Float[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0))
    """In space."""
    confidence: Float[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0))
    stripe_ms: float = 0.0
    """Picture to profile: processor time of one thread, as the next."""
    whole_ms: float = 0.0
    """Picture to features."""

    @property
    def wrong(self) -> bool:
        """Valid, but more than a millimetre off."""
        return self.valid and bool(max([self.across_m, *self.features_m]) > _WRONG_M)


class Detectors:
    """All detectors on the frames of one track at one level, in order: the gated ones remember the last valid find."""

    def __init__(self) -> None:
        self._last_point: Float[np.ndarray, "2"] | None = None
        self._last_joint: JointFeatures | None = None

    def outcomes(self, labelled: LabelledPicture) -> list[Outcome]:
        """What each detector makes of the next frame."""
        return [*self._morphology(labelled), *self._models(labelled)]

    def _morphology(self, labelled: LabelledPicture) -> Iterator[Outcome]:
        begin, last_px = time.thread_time(), self._last_point
        found = gated = seam_point(labelled.picture)
        took_ms = gated_ms = 1e3 * (time.thread_time() - begin)
        if last_px is not None and not (found.valid and np.hypot(*(found.point_px - last_px)) <= _REACH_PX):
            begin = time.thread_time()  # otherwise the gate lets the same point through
            gated = seam_point(labelled.picture, near_px=last_px, reach_px=_REACH_PX)
            gated_ms = 1e3 * (time.thread_time() - begin)
        self._last_point = gated.point_px if gated.valid else last_px
        yield _judged_point(MORPHOLOGY, labelled, found, took_ms)
        yield _judged_point(GATED_MORPHOLOGY, labelled, gated, gated_ms)

    def _models(self, labelled: LabelledPicture) -> Iterator[Outcome]:
        begin = time.thread_time()
        profile = triangulate(find_stripe(labelled.picture), labelled.camera, labelled.plane)
        stripe_ms = 1e3 * (time.thread_time() - begin)
        for detector, previous in ((MODELS, None), (GATED_MODELS, self._last_joint)):
            begin = time.thread_time()
            found = find_joint(profile, labelled.kind, labelled.plane, previous=previous)
            took_ms = 1e3 * (time.thread_time() - begin)
            if detector == GATED_MODELS and found.valid:
                self._last_joint = found
            yield _judged(detector, labelled, found, stripe_ms, stripe_ms + took_ms)


def _judged_point(detector: str, labelled: LabelledPicture, found: SeamPoint, took_ms: float) -> Outcome:
    truth, kind, T_camera_laser = labelled.truth, labelled.kind, labelled.plane.T_camera_laser
    point_camera = labelled.plane.intersect(labelled.camera.unproject(found.point_px))
    x_m = float(T_camera_laser.inv().apply(point_camera)[0])
    return Outcome(
        detector=detector,
        kind=kind,
        level=labelled.level,
        valid=found.valid,
        reason=found.reason,
        across_px=abs(float(found.point_px[0]) - _middle(truth.names, truth.pixels, kind)[0]),
        across_m=abs(x_m - _middle_x_m(truth.names, truth.points_camera, labelled)),
        whole_ms=took_ms,
    )


def _judged(
    detector: str, labelled: LabelledPicture, found: JointFeatures, stripe_ms: float, whole_ms: float
) -> Outcome:
    truth, kind = labelled.truth, labelled.kind
    pixels, order = labelled.camera.project(found.points_camera), [truth.names.index(name) for name in found.names]
    middle_px = _middle(found.names, pixels, kind)[0] - _middle(truth.names, truth.pixels, kind)[0]
    x_m = _middle_x_m(found.names, found.points_camera, labelled)
    return Outcome(
        detector=detector,
        kind=kind,
        level=labelled.level,
        valid=found.valid,
        reason=found.reason,
        across_px=abs(float(middle_px)),
        across_m=abs(x_m - _middle_x_m(truth.names, truth.points_camera, labelled)),
        features_px=np.linalg.norm(pixels - truth.pixels[order], axis=1),
        features_m=np.linalg.norm(found.points_camera - truth.points_camera[order], axis=1),
        confidence=found.confidence,
        stripe_ms=stripe_ms,
        whole_ms=whole_ms,
    )


def _middle(names: tuple[str, ...], places: Float[np.ndarray, "k d"], kind: JointKind) -> Float[np.ndarray, "d"]:
    """Middle between the outer features."""
    outer = [names.index(name) for name in _OUTER.get(kind, _LEFT_RIGHT)]
    return np.asarray(np.mean(places[outer], axis=0))


def _middle_x_m(names: tuple[str, ...], points_camera: Float[np.ndarray, "k 3"], labelled: LabelledPicture) -> float:
    middle_camera = _middle(names, points_camera, labelled.kind)
    return float(labelled.plane.T_camera_laser.inv().apply(middle_camera)[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """All outcomes, and what the levels were."""

    outcomes: list[Outcome]
    pictures: int
    snr: dict[str, float]
    """Median of the stripe's peak over a pixel's noise, by level."""


def compared(
    seed: int = SEED,
    *,
    tracks: int = TRACKS,
    kinds: Sequence[JointKind] = KINDS,
    levels: Sequence[Level] = LEVELS,
) -> Comparison:
    """All detectors on all pictures."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)  # processor time of one thread is the time a frame takes
    outcomes: list[Outcome] = []
    ratios: dict[str, list[float]] = {level.name: [] for level in levels}
    detectors: dict[tuple[JointKind, int, str], Detectors] = {}
    pictures = 0
    for labelled in labelled_pictures(seed, kinds=kinds, tracks=tracks, levels=levels):
        key = (labelled.kind, labelled.track, labelled.level.name)
        found = detectors.setdefault(key, Detectors()).outcomes(labelled)
        if labelled.frame > 0:  # the first one only gates
            outcomes += found
            ratios[labelled.level.name].append(labelled.stripe_grey / labelled.noise_grey)
            pictures += 1
    cv2.setNumThreads(threads)
    return Comparison(
        outcomes=outcomes, pictures=pictures, snr={name: float(np.median(values)) for name, values in ratios.items()}
    )

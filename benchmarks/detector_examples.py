"""What the detectors are given: one joint at several levels of noise, with what the models found of it."""

import cv2
import numpy as np
from jaxtyping import UInt8

from joint_pictures import LEVELS, JointScene, LabelledPicture
from weldcell.models.joint_section import JointKind
from weldcell.tracking.joint import find_joint
from weldcell.tracking.stripe import find_stripe
from weldcell.tracking.triangulation import triangulate

_SHOWN = ("nominal", "light 1/30", "20 grey added", "arc and spatter")
_HALF_PX, _ZOOM = (130, 90), 1.5
_FONT, _SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.45
_INK, _PAPER, _STRIPE, _FOUND, _TRUE = (40, 40, 40), (255, 255, 255), (0, 160, 255), (60, 60, 255), (80, 220, 80)


def example_sheet(seed: int, kinds: tuple[JointKind, ...] = ("v", "lap")) -> UInt8[np.ndarray, "height width 3"]:
    """Cut-outs about the joint (BGR), one row a kind: stripe orange, found features crosses, true ones circles."""
    levels = [level for level in LEVELS if level.name in _SHOWN]
    rows = []
    for kind in kinds:
        with JointScene(seed, kind, 0) as scene:
            rows.append(np.hstack([_cut_out(shown) for shown in scene.pictures(1, levels)]))
    return np.vstack(rows)


def _cut_out(shown: LabelledPicture) -> UInt8[np.ndarray, "height width 3"]:
    stripe = find_stripe(shown.picture)
    found = find_joint(triangulate(stripe, shown.camera, shown.plane), shown.kind, shown.plane)
    corner_px = np.rint(np.mean(shown.truth.pixels, axis=0)).astype(int) - _HALF_PX
    corner_px = np.clip(corner_px, 0, np.array(shown.picture.shape[::-1]) - 2 * np.array(_HALF_PX))
    (left, top), (width, height) = corner_px, 2 * np.array(_HALF_PX)
    grey = cv2.resize(shown.picture[top : top + height, left : left + width], None, fx=_ZOOM, fy=_ZOOM)
    canvas = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    for pixels, draw in (
        (np.column_stack([stripe.u_px, stripe.v_px]), _dot),
        (shown.truth.pixels, _circle),
        (shown.camera.project(found.points_camera) if found.valid else np.empty((0, 2)), _cross),
    ):
        for place in (pixels - corner_px + 0.5) * _ZOOM - 0.5:
            draw(canvas, (round(place[0]), round(place[1])))
    canvas = cv2.copyMakeBorder(canvas, 20, 2, 2, 2, cv2.BORDER_CONSTANT, value=_PAPER)
    words = f"{shown.kind}, {shown.level.name}{'' if found.valid else ': none found'}"
    return np.asarray(cv2.putText(canvas, words, (6, 14), _FONT, _SIZE, _INK, 1, cv2.LINE_AA))


def _dot(canvas: UInt8[np.ndarray, "height width 3"], at_px: tuple[int, int]) -> None:
    cv2.circle(canvas, at_px, 0, _STRIPE, -1)


def _circle(canvas: UInt8[np.ndarray, "height width 3"], at_px: tuple[int, int]) -> None:
    cv2.circle(canvas, at_px, 9, _TRUE, 1, cv2.LINE_AA)


def _cross(canvas: UInt8[np.ndarray, "height width 3"], at_px: tuple[int, int]) -> None:
    cv2.drawMarker(canvas, at_px, _FOUND, cv2.MARKER_CROSS, 15, 1, cv2.LINE_AA)

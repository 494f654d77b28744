"""The overlay of a detection: the picture, the stripe's centre on it, the features named, each magnified below."""

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8

from weldcell.cell.profile import Stripe
from weldcell.tracking.picture_joint import PictureJoint

_SIDES_PX = (640, 1920)  # least and greatest length of the longer side as drawn
_STRIPE_RGB = (0, 255, 90)
_FEATURE_RGB = ((255, 170, 0), (255, 70, 170), (0, 200, 255), (255, 255, 0), (190, 140, 255))
_FAULT_RGB = (255, 110, 90)
_GAMMA = 0.6  # shows dark surroundings too
_GAP_PX = 6.0  # the line along the stripe does not bridge more
_FONT, _TEXT_SIZE, _TEXT_HEIGHT_PX = cv2.FONT_HERSHEY_SIMPLEX, 0.55, 18
_INSET_PX, _INSET_ZOOM, _MARGIN_PX = 240, 8, 8
_FINE = 4  # binary digits of OpenCV's sub-pixel drawing


def overlay_png(picture: Shaped[np.ndarray, "height width *channels"], stripe: Stripe, joint: PictureJoint) -> bytes:
    """The overlay as a PNG file."""
    bright = _brightened(picture)
    longer = max(bright.shape[:2])
    scale = float(np.clip(longer, *_SIDES_PX)) / longer
    size = [max(1, round(side * scale)) for side in bright.shape[1::-1]]
    canvas = cv2.resize(bright, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
    points_px = np.column_stack([stripe.u_px, stripe.v_px])
    _draw_line(canvas, (points_px + 0.5) * scale - 0.5, _GAP_PX * max(scale, 1.0))
    panels = [_legend(stripe, joint)]
    if joint.valid:
        _draw_features(canvas, joint, (joint.points_px + 0.5) * scale - 0.5)
        panels.append(np.hstack([_inset(bright, points_px, joint, index) for index in range(len(joint.names))]))
    width = max(part.shape[1] for part in (canvas, *panels))
    whole = np.vstack([_widened(part, width) for part in (canvas, *panels)])
    return bytes(cv2.imencode(".png", whole[..., ::-1])[1])


def _legend(stripe: Stripe, joint: PictureJoint) -> UInt8[np.ndarray, "height width 3"]:
    """A line that says what the green line is, and what was not found."""
    if len(stripe.u_px):
        text = f"stripe centre: {len(stripe.u_px)} points, sigma {np.median(stripe.sigma_px):.2f} px"
    else:
        text = "no stripe"
    fault = "" if joint.valid else f"not found: {joint.reason}"
    gap_px = 3 * _MARGIN_PX
    width = _text_width_px(text) + gap_px + _text_width_px(fault) + 2 * _MARGIN_PX
    legend = np.zeros((_TEXT_HEIGHT_PX + 2 * _MARGIN_PX, width, 3), np.uint8)
    _draw_text(legend, text, (_MARGIN_PX, _MARGIN_PX), _STRIPE_RGB)
    _draw_text(legend, fault, (_MARGIN_PX + _text_width_px(text) + gap_px, _MARGIN_PX), _FAULT_RGB)
    return legend


def _brightened(picture: Shaped[np.ndarray, "height width *channels"]) -> UInt8[np.ndarray, "height width 3"]:
    """The picture in 8-bit RGB from black to white, dark parts lifted."""
    most = max(float(picture.max(initial=0)), 1.0)
    lifted = np.rint(255 * (np.arange(int(most) + 1) / most) ** _GAMMA).astype(np.uint8)
    grey = lifted[picture]
    return np.ascontiguousarray(grey if grey.ndim == 3 else np.repeat(grey[..., None], 3, axis=2))


def _draw_line(canvas: UInt8[np.ndarray, "height width 3"], points: Float[np.ndarray, "n 2"], gap_px: float) -> None:
    """A thin line through the stripe's centres, broken where they are."""
    breaks = np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > gap_px) + 1
    for piece in np.split(points, breaks):
        if len(piece):
            cv2.polylines(canvas, [_fine(piece)], False, _STRIPE_RGB, 1, cv2.LINE_AA, _FINE)


def _draw_features(canvas: UInt8[np.ndarray, "height width 3"], joint: PictureJoint, points: np.ndarray) -> None:
    taken: list[tuple[int, int, int, int]] = []
    for index, point in enumerate(points):
        colour = _FEATURE_RGB[index % len(_FEATURE_RGB)]
        _draw_cross(canvas, point, 14, colour)
        u, v = joint.points_px[index]
        text = f"{joint.names[index]} ({u:.2f}, {v:.2f})"
        corner = _free_place(canvas.shape, point, _text_width_px(text), taken)
        taken.append((*corner, corner[0] + _text_width_px(text), corner[1] + _TEXT_HEIGHT_PX))
        _draw_text(canvas, text, corner, colour)


def _free_place(
    shape: tuple[int, ...], point: Float[np.ndarray, "2"], width_px: int, taken: list[tuple[int, int, int, int]]
) -> tuple[int, int]:
    """Top-left corner of a text beside the point that lies in the picture and on no other text."""
    right, left = point[0] + 18, point[0] - 18 - width_px
    places = [
        (int(np.clip(x, 0, max(shape[1] - width_px, 0))), int(np.clip(point[1] + dy, 0, shape[0] - _TEXT_HEIGHT_PX)))
        for dy in (-30, 14, -52, 36, -74, 58)
        for x in (right, left)
    ]
    return next((place for place in places if not any(_overlap(place, width_px, box) for box in taken)), places[0])


def _overlap(corner: tuple[int, int], width_px: int, box: tuple[int, int, int, int]) -> bool:
    x, y = corner
    return x < box[2] and box[0] < x + width_px and y < box[3] and box[1] < y + _TEXT_HEIGHT_PX


def _inset(
    bright: UInt8[np.ndarray, "height width 3"], points_px: Float[np.ndarray, "n 2"], joint: PictureJoint, index: int
) -> UInt8[np.ndarray, "side side 3"]:
    """The surroundings of a feature, magnified: the pixels, each stripe centre and the feature."""
    half = _INSET_PX / _INSET_ZOOM / 2
    first = np.round(joint.points_px[index]) - half
    onto = np.array([[_INSET_ZOOM, 0, 0], [0, _INSET_ZOOM, 0]], float)
    onto[:, 2] = (0.5 - first) * _INSET_ZOOM - 0.5
    inset = cv2.warpAffine(bright, onto, (_INSET_PX, _INSET_PX), flags=cv2.INTER_NEAREST)
    near = points_px[np.all(np.abs(points_px - joint.points_px[index]) < half, axis=1)]
    for point in (near - first + 0.5) * _INSET_ZOOM - 0.5:
        cv2.circle(inset, _fine(point), 2 << _FINE, _STRIPE_RGB, -1, cv2.LINE_AA, _FINE)
    colour = _FEATURE_RGB[index % len(_FEATURE_RGB)]
    _draw_cross(inset, (joint.points_px[index] - first + 0.5) * _INSET_ZOOM - 0.5, 24, colour)
    _draw_text(inset, f"{joint.names[index]} x{_INSET_ZOOM}", (_MARGIN_PX, _MARGIN_PX), colour)
    cv2.rectangle(inset, (0, 0), (_INSET_PX - 1, _INSET_PX - 1), (70, 70, 70), 1)
    return inset


def _draw_cross(canvas: UInt8[np.ndarray, "height width 3"], point: np.ndarray, size_px: int, colour: tuple) -> None:
    for outline, thickness in (((0, 0, 0), 3), (colour, 1)):
        for step in (np.array([size_px, 0.0]), np.array([0.0, size_px])):
            for side in (-1, 1):  # open in the middle, so that it hides nothing
                start, end = point + side * step / 3, point + side * step
                cv2.line(canvas, _fine(start), _fine(end), outline, thickness, cv2.LINE_AA, _FINE)
        cv2.circle(canvas, _fine(point), (size_px * 2 // 3) << _FINE, outline, thickness, cv2.LINE_AA, _FINE)


def _draw_text(
    canvas: UInt8[np.ndarray, "height width 3"], text: str, corner: tuple[int, int], colour: tuple[int, int, int]
) -> None:
    x, y = corner[0], corner[1] + _TEXT_HEIGHT_PX - 5
    for dx, dy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):  # a thicker text would be wider
        cv2.putText(canvas, text, (x + dx, y + dy), _FONT, _TEXT_SIZE, (0, 0, 0), 1, cv2.LINE_AA)
    cv2.putText(canvas, text, (x, y), _FONT, _TEXT_SIZE, colour, 1, cv2.LINE_AA)


def _text_width_px(text: str) -> int:
    return int(cv2.getTextSize(text, _FONT, _TEXT_SIZE, 1)[0][0])


def _fine(points: Float[np.ndarray, "*n 2"]) -> np.ndarray:
    return np.round(points * 2**_FINE).astype(np.int32)


def _widened(picture: UInt8[np.ndarray, "height width 3"], width: int) -> UInt8[np.ndarray, "height wider 3"]:
    return np.asarray(cv2.copyMakeBorder(picture, 0, 0, 0, width - picture.shape[1], cv2.BORDER_CONSTANT))

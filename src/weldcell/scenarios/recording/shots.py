"""One picture and what was found in it, as it is drawn."""

from collections.abc import Iterator

import cv2
import numpy as np
import rerun as rr
from jaxtyping import Float, UInt8, UInt16
from scipy.spatial.transform import RigidTransform

from weldcell.cell.profile import JointFeatures, Profile, Stripe
from weldcell.scenarios.recording import palette
from weldcell.scenarios.recording.meshes import entity_name
from weldcell.scenarios.recording.sensor import PICTURE, DrawnSensor

STEPS = "steps"

Drawn = Iterator[tuple[str, rr.AsComponents]]

_EVERY_STRIPE_POINT = 12  # of the stripe's centres: dots that leave the stripe itself in sight
_EVERY_PROFILE_POINT = 2  # of the profile's points, some 0.08 mm apart
_BITS_TOO_MANY = 4  # of a 12-bit picture for a JPEG
_CORNER_TO_CENTRE_PX = 0.5  # rerun's pixel (0, 0) is the corner of the top-left pixel, ours its centre


def drawn_picture(
    image: UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"] | None,
    quality: int,
    stripe: Stripe | None,
    joint: JointFeatures | None,
    sensor: DrawnSensor,
) -> Drawn:
    """The camera's picture, if there is one, as JPEG, with stripe centres and features on top."""
    if image is not None:
        levels = image if image.dtype == np.uint8 else (image >> _BITS_TOO_MANY).astype(np.uint8)
        encoded = cv2.imencode(".jpg", levels, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        yield PICTURE, rr.EncodedImage(contents=encoded.tobytes(), media_type="image/jpeg")
    pixels = np.zeros((0, 2)) if stripe is None else np.column_stack([stripe.u_px, stripe.v_px])
    pixels = pixels[::_EVERY_STRIPE_POINT] + _CORNER_TO_CENTRE_PX
    yield f"{PICTURE}/stripe", rr.Points2D(pixels, colors=palette.STRIPE, radii=rr.Radius.ui_points(0.8))
    names, points_camera = _found(joint)
    pixels = sensor.camera.project(points_camera) + _CORNER_TO_CENTRE_PX
    yield f"{PICTURE}/features", _features_2d(pixels, names)


def drawn_step(name: str, picture: UInt8[np.ndarray, "h w"], quality: int, point_px: Float[np.ndarray, "2"]) -> Drawn:
    """One step of a picture's processing, masks without loss, with the point that came of it (NaN: none)."""
    is_mask = set(np.unique(picture)) <= {0, 255}
    kind, options = ("png", []) if is_mask else ("jpeg", [cv2.IMWRITE_JPEG_QUALITY, quality])
    encoded = cv2.imencode(f".{kind}", picture, options)[1]
    yield f"{STEPS}/{name}", rr.EncodedImage(contents=encoded.tobytes(), media_type=f"image/{kind}")
    points = point_px[None][np.isfinite(point_px).all(keepdims=True)] + _CORNER_TO_CENTRE_PX
    yield f"{STEPS}/{name}/point", rr.Points2D(points, colors=palette.POINT, radii=rr.Radius.ui_points(3.0))


def drawn_profile(profile: Profile | None, joint: JointFeatures | None, sensor: DrawnSensor) -> Drawn:
    """Profile and features in the light plane; what was not found wipes out that of the picture before."""
    points_mm = sensor.profile_mm(_thinned(profile))
    yield "profile/points", rr.Points2D(points_mm, colors=palette.PROFILE, radii=rr.Radius.ui_points(1.2))
    names, points_camera = _found(joint)
    yield "profile/features", _features_2d(sensor.profile_mm(points_camera), names)


def drawn_in_base(
    profile: Profile | None, joint: JointFeatures | None, T_base_camera: RigidTransform, sensor: DrawnSensor
) -> Iterator[tuple[str, Float[np.ndarray, "n 3"], rr.Points3D]]:
    """Profile (coloured by depth over the measuring range) and features that were found: name, points, drawing."""
    points_camera = _thinned(profile)
    if len(points_camera):
        points_base = T_base_camera.apply(points_camera)
        near, far = np.nanmin(sensor.range_mm[:, 1]), np.nanmax(sensor.range_mm[:, 1])
        colours = palette.depth_colours(-sensor.profile_mm(points_camera)[:, 1], -far, -near)
        cloud = rr.Points3D(points_base.astype(np.float32), colors=colours, radii=rr.Radius.ui_points(1.0))
        yield "profile", points_base, cloud
    names, points_camera = _found(joint)
    for name, point_camera, colour in zip(names, points_camera, palette.named_colours(names), strict=True):
        point_base = T_base_camera.apply(point_camera)[None]
        point = rr.Points3D(point_base, colors=colour, radii=rr.Radius.ui_points(2.0))
        yield f"features/{entity_name(name)}", point_base, point


def _thinned(profile: Profile | None) -> Float[np.ndarray, "n 3"]:
    if profile is None:
        return np.zeros((0, 3))
    return profile.points_camera[profile.valid][::_EVERY_PROFILE_POINT]


def _found(joint: JointFeatures | None) -> tuple[list[str], Float[np.ndarray, "k 3"]]:
    if joint is None or not joint.valid:
        return [], np.zeros((0, 3))
    seen = np.isfinite(joint.points_camera).all(axis=1)
    return [name for name, s in zip(joint.names, seen, strict=True) if s], joint.points_camera[seen]


def _features_2d(points: Float[np.ndarray, "k 2"], names: list[str]) -> rr.Points2D:
    colours, radius = palette.named_colours(names), rr.Radius.ui_points(5.0)
    return rr.Points2D(points, labels=names, show_labels=True, colors=colours, radii=radius)

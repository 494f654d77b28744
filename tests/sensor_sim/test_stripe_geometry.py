"""The drawn stripe of every preset against closed-form shapes cut by the light plane and projected by OpenCV."""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import mujoco
import numpy as np
import pytest

from sensor_sim.rigs import SENSORS, Heights, Rig, sensor
from weldcell.cell.frames import translation
from weldcell.models.boss import boss
from weldcell.models.v_groove import SPath, v_groove_plate
from weldcell.sensor_sim.drawing import draw_stripe

TILT = np.deg2rad([12.0, -17.0])  # of the plane, along base x and y
RADIUS_M, SPHERE = 0.02, np.array([0.004, 0.006, -0.02])
EDGE_SIGMAS = 5.0  # an edge's two faces mix in the blur of either side


@dataclass(frozen=True)
class Shape:
    """A scene and its upper surface in closed form, the light meeting the camera's axis near the origin."""

    model: mujoco.MjModel
    heights: Heights
    yaw_rad: float = 0.0


def compiled(world: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{world}</worldbody></mujoco>")


def tilted_plane() -> Shape:
    normal = np.array([np.tan(TILT[0]), np.tan(TILT[1]), 1.0]) / np.hypot(1, np.linalg.norm(np.tan(TILT)))
    plane = f'<geom type="plane" size="1 1 1" zaxis="{normal[0]} {normal[1]} {normal[2]}"/>'
    return Shape(compiled(plane), lambda x, y: -(normal[0] * x + normal[1] * y) / normal[2])


def sphere() -> Shape:
    def heights(x, y):
        rise = np.sqrt(np.maximum(RADIUS_M**2 - (x - SPHERE[0]) ** 2 - (y - SPHERE[1]) ** 2, 0))
        return np.where(rise > 0.6 * RADIUS_M, SPHERE[2] + rise, np.nan)  # the stripe folds at the limb

    position = " ".join(str(value) for value in SPHERE)
    return Shape(compiled(f'<geom type="sphere" size="{RADIUS_M}" pos="{position}"/>'), heights)


def groove() -> Shape:
    """The S-shaped groove near a crest of its path, cut askew."""
    path, thickness, face, half_rad, middle = SPath(length_m=0.3, amplitude_m=0.02), 0.04, 0.004, np.pi / 8, 0.06
    part = v_groove_plate(0.3, 0.16, thickness, 2 * half_rad, 0.0, face, path.amplitude_m)
    shift = np.array([-middle, -path.offset(np.array([middle]), 0.0)[0, 1], -0.025])
    spec = mujoco.MjSpec()
    part.add_to(spec, translation(shift))

    def heights(x, y):
        place = np.stack([x, y], axis=1) - shift[:2]
        along = place[:, 0].copy()
        for _ in range(60):  # nearest point of the path: what is left along the path's direction is taken out
            slope = path.slope(along)
            away = place - path.offset(along, 0.0)
            along += (away[:, 0] + slope * away[:, 1]) / (1 + slope**2)
        distance = np.linalg.norm(place - path.offset(along, 0.0), axis=1)
        return np.minimum(face + distance / np.tan(half_rad), thickness) + shift[2]

    return Shape(spec.compile(), heights, yaw_rad=np.deg2rad(10.0))


def frustum() -> Shape:
    part = boss(0.03, np.deg2rad(53.13), 0.024)
    spec = mujoco.MjSpec()
    shift = np.array([0.003, 0.002, -0.025])
    part.add_to(spec, translation(shift))
    faces = {name: plane for name, plane in part.planes_part.items() if name != "base"}

    def heights(x, y):
        over = [(d - nx * (x - shift[0]) - ny * (y - shift[1])) / nz for nx, ny, nz, d in faces.values()]
        return np.maximum(np.minimum.reduce(over), part.planes_part["base"][3]) + shift[2]

    return Shape(spec.compile(), heights, yaw_rad=np.deg2rad(20.0))


SHAPES: dict[str, Callable[[], Shape]] = {
    "tilted plane": tilted_plane, "sphere": sphere, "groove": groove, "boss": frustum
}  # fmt: skip


def exact_line(rig: Rig, shape: Shape, T_base_camera, half_m: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (along, across) of the lit line, densely, and whether each is smooth there."""
    points_base = rig.profile_base(T_base_camera, shape.heights, half_m, 60_001)
    points_base = points_base[np.isfinite(points_base[:, 2])]
    points_camera = np.ascontiguousarray(T_base_camera.inv().apply(points_base))
    camera = rig.camera
    pixels = cv2.projectPoints(points_camera, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)[0][:, 0]
    slope = np.diff(points_base[:, 2]) / (2 * half_m / 60_000)
    kink = np.append(False, np.append(np.abs(np.diff(slope)) > 0.1, False))
    kink[[0, -1]] = True  # ends of what is known
    return (pixels if rig.config.stripe_along == "rows" else pixels[:, ::-1]), kink


def exact_centres(rig: Rig, shape: Shape, T_base_camera, cuts: np.ndarray, sigma_px: np.ndarray) -> np.ndarray:
    """Exact place of the stripe on each cut; NaN close to an edge of the shape."""
    line, kink = exact_line(rig, shape, T_base_camera)
    order = np.argsort(line[:, 0])
    assert np.all(np.abs(np.diff(order)) == 1)  # it does not fold in the picture
    centres = np.interp(cuts, line[order, 0], line[order, 1], left=np.nan, right=np.nan)
    off_edge = np.abs(cuts[:, None] - line[kink, 0]).min(axis=1)
    return np.where(off_edge > EDGE_SIGMAS * sigma_px, centres, np.nan)


def drawn_centres(rig: Rig, pieces, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Grey centroids of the drawn picture on the cuts of known pieces, as drawn and rounded to 8 bits."""
    camera = rig.camera
    laser = draw_stripe(pieces, camera.width_px, camera.height_px)
    picture = np.zeros((camera.height_px, camera.width_px))
    picture[laser.window] = laser.grey
    cuts = picture.T if pieces.along == "rows" else picture
    return centroids(cuts[pieces.cut_px[known]]), centroids(np.rint(cuts[pieces.cut_px[known]]))


def centroids(lines: np.ndarray) -> np.ndarray:
    """Centroid of each line's light."""
    return lines @ np.arange(lines.shape[1]) / lines.sum(axis=1)


@pytest.mark.parametrize("name", list(SENSORS))
@pytest.mark.parametrize("shape_name", list(SHAPES))
def test_the_noise_free_stripe_lies_where_the_light_plane_cuts_the_exact_shape(name, shape_name):
    rig, shape = sensor(name), SHAPES[shape_name]()
    T_base_camera = rig.T_base_camera(yaw_rad=shape.yaw_rad)
    pieces = rig.pieces(shape.model, T_base_camera)
    expected = exact_centres(rig, shape, T_base_camera, pieces.cut_px, pieces.sigma_px)
    known = np.isfinite(expected) & (pieces.coverage > 0.9999) & (pieces.amplitude_grey > 30)
    assert known.sum() > 200
    # mesh chords 0.5 um, 0.01 px; between rays the line is a cubic
    np.testing.assert_allclose(pieces.centre_px[known], expected[known], atol=0.01)  # px
    drawn, rounded = (centres - expected[known] for centres in drawn_centres(rig, pieces, known))
    assert np.abs(drawn).max() <= 0.012  # px, and light is drawn out to four sigma
    rounded = rounded[pieces.amplitude_grey[known] > 60]
    assert np.sqrt(np.mean(rounded**2)) <= 0.02  # px, what the sensor has to show; rounding to 8 bits costs most of it
    assert np.abs(rounded).max() <= 0.05

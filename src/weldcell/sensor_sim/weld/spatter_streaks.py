"""From droplets to their streaks in one picture: flight, landing, what hides them, blur and brightness."""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.optics import CameraModel
from weldcell.sensor_sim.focus import Lens
from weldcell.sensor_sim.weld.photometry import Photometry
from weldcell.sensor_sim.weld.spatter import Droplets, flight_m, temperature_k
from weldcell.sensor_sim.weld.streaks import Streaks

_STRAIGHT_S = 1e-3  # a flight this long is drawn as one straight streak: gravity bends it by 1 um
_MOST_PARTS = 16
_NEAREST_M = 0.03  # droplets closer to the lens would have hit its window


def spatter_streaks(
    droplets: Droplets,
    landing_s: Float[np.ndarray, "n"],
    window_s: tuple[float, float],
    origin_camera: Float[np.ndarray, "3"],
    camera: CameraModel,
    T_base_camera: RigidTransform,
    glass: Lens,
    response: Photometry,
) -> tuple[Streaks, Float[np.ndarray, "n"]]:
    """The streaks of one exposure, and each one's distance from the camera (m).

    Droplets start at `origin_camera` (the arc, camera frame) and lie still from the ages `landing_s` on.
    """
    parts = int(np.clip(np.ceil((window_s[1] - window_s[0]) / _STRAIGHT_S), 1, _MOST_PARTS))
    borders_s = np.linspace(*window_s, parts + 1)
    which = np.tile(np.arange(len(droplets.birth_s)), parts)
    flying, landing_s = droplets.chosen(which), landing_s[which]
    since_s, until_s = (np.repeat(border, len(droplets.birth_s)) for border in (borders_s[:-1], borders_s[1:]))
    from_age_s, to_age_s = (np.maximum(time_s - flying.birth_s, 0) for time_s in (since_s, until_s))
    R_camera_base = T_base_camera.rotation.as_matrix().T
    starts, stops = (
        origin_camera + flight_m(flying, np.minimum(age_s, landing_s)) @ R_camera_base.T
        for age_s in (from_age_s, to_age_s)
    )
    middle = (starts + stops) / 2
    depth_m = np.maximum(middle[:, 2], _NEAREST_M)
    size_px = flying.diameter_m * float(np.mean(camera.focal_px)) / depth_m
    grey = response.hot_steel_grey(temperature_k(flying, (from_age_s + to_age_s) / 2, landing_s))
    present = (to_age_s - from_age_s) / (window_s[1] - window_s[0])
    ends_px = camera.project(starts), camera.project(stops)
    seen = np.all(np.isfinite(np.hstack(ends_px)), axis=1) & (np.minimum(starts[:, 2], stops[:, 2]) > _NEAREST_M)
    seen &= present > 0
    blur_px = glass.blur_sigma_px(middle[seen], camera.project(middle[seen]), camera)
    streaks = Streaks(
        start_px=ends_px[0][seen],
        stop_px=ends_px[1][seen],
        sigma_px=np.hypot(size_px[seen] / 4, blur_px),
        light_grey=(grey * np.pi / 4 * size_px**2 * present)[seen],
    )
    return streaks, np.linalg.norm(middle[seen], axis=1)

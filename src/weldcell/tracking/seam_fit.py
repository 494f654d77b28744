"""From the features of single frames to the seam: smooth lines in space, indexed by arc length."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float
from scipy.integrate import cumulative_simpson
from scipy.interpolate import BSpline, CubicSpline

from weldcell.cell.errors import JobFailed
from weldcell.cell.seam import Seam
from weldcell.tracking.smoothing import smooth_curve

_FEWEST_FRAMES = 8
_CENTRES = ("root", "centre")


def fit_seam(
    points_base: Mapping[str, Float[np.ndarray, "n 3"]],
    *,
    sigma_m: Mapping[str, Float[np.ndarray, "n"]] | None = None,
    robot_sigma_m: float = 3e-5,
    spacing_m: float = 1e-3,
    centre: str | None = None,
) -> Seam:
    """The seam through the frames' feature points (rows in order of travel; NaN where a frame is invalid).

    Each feature gets a robust smoothing curve; how smooth, its own scatter decides. A point's weight is
    1 / (sigma_m^2 + robot_sigma_m^2): the sensor's sigma, and the robot's, which all frames share. Arc length runs
    along `centre` (by default root or centre, else the first feature), from its first valid frame to its last.

    Raises JobFailed if a feature has fewer than eight valid frames.
    """
    points = {name: np.asarray(rows, dtype=float) for name, rows in points_base.items()}
    centre = centre or next((name for name in _CENTRES if name in points), next(iter(points)))
    seen = {name: np.isfinite(rows).all(axis=1) for name, rows in points.items()}
    for name, frames in seen.items():
        if frames.sum() < _FEWEST_FRAMES:
            raise JobFailed(f"seam: {name} has {frames.sum()} valid frames, at least {_FEWEST_FRAMES} are needed")
    sigma = dict(sigma_m or {})
    weight = {name: 1 / (np.square(sigma.get(name, np.zeros(len(points[name])))) + robot_sigma_m**2) for name in points}
    parameter = _travel(points[centre], seen[centre])
    curves = {}
    for name in points:
        use = seen[name] & np.isfinite(weight[name])
        curves[name] = smooth_curve(parameter[use], points[name][use], weight[name][use]).curve
    first, last = parameter[seen[centre]][[0, -1]]
    at, arc_length_m = _even_arc_length(curves[centre], float(first), float(last), spacing_m)
    return Seam(arc_length_m=arc_length_m, points={name: curve(at) for name, curve in curves.items()})


def _travel(points: Float[np.ndarray, "n 3"], seen: Bool[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Roughly the distance travelled at each frame, also at frames that saw nothing.

    The chords between single frames are lengthened by noise and strays, so frames are taken as evenly spaced first,
    and the length of the smooth curve through them replaces that.
    """
    frame = np.arange(len(points), dtype=float)
    curve = smooth_curve(frame[seen], points[seen], np.ones(int(seen.sum()))).curve
    speed = np.linalg.norm(curve.derivative()(frame), axis=1)
    return cumulative_simpson(np.maximum(speed, 1e-3 * np.median(speed)), x=frame, initial=0.0)


def _even_arc_length(
    curve: BSpline, first: float, last: float, spacing_m: float
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Parameters at about even steps of the curve's arc length, and these arc lengths."""
    dense = np.linspace(first, last, max(50, 4 * int(np.ceil((last - first) / spacing_m))))
    length = cumulative_simpson(np.linalg.norm(curve.derivative()(dense), axis=1), x=dense, initial=0.0)
    arc_length_m = np.linspace(0.0, length[-1], max(2, int(np.ceil(length[-1] / spacing_m)) + 1))
    return np.clip(CubicSpline(length, dense)(arc_length_m), first, last), arc_length_m

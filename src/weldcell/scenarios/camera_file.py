"""camera.yaml: a camera's intrinsics, written by `calibrate camera` and read by `calibrate laser-plane`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from weldcell.cell.errors import BadGeometry, BadInput
from weldcell.cell.optics import CameraModel
from weldcell.scenarios.yaml_file import read_yaml

_COEFFICIENTS = 12  # of the distortion proper; the tilt has a field of its own
_LARGEST_PX = 100_000
_PROBES = 9  # along each side: places where the distortion must be invertible
_FIELDS = ("width_px", "height_px", "matrix_px", "distortion", "tilt_deg")


def camera_mapping(camera: CameraModel) -> dict[str, Any]:
    """The camera as the file has it."""
    return {
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "matrix_px": camera.matrix,
        "distortion": camera.distortion[:_COEFFICIENTS],
        "tilt_deg": np.degrees(camera.distortion[_COEFFICIENTS:]),
    }


def read_camera(path: Path) -> CameraModel:
    """The camera of a file; refused, naming file and field, unless it is one whose rays can be told."""
    values = read_yaml(path)
    if missing := [name for name in _FIELDS if name not in values]:
        raise BadInput(f"{path}: {missing[0]}: found none, expected fields {', '.join(_FIELDS)}")
    sizes = {name: _size(path, values, name) for name in ("width_px", "height_px")}
    matrix = _numbers(path, values, "matrix_px", (3, 3))
    tilt = np.radians(_numbers(path, values, "tilt_deg", (2,)))
    if np.any(np.abs(matrix[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] - [0, 0, 0, 0, 1]) > 1e-9):
        raise BadInput(f"{path}: matrix_px: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    try:
        camera = CameraModel(
            **sizes,
            focal_px=matrix[[0, 1], [0, 1]],
            principal_px=matrix[:2, 2],
            distortion=np.concatenate([_numbers(path, values, "distortion", (_COEFFICIENTS,)), tilt]),
        )
    except BadGeometry as refusal:
        raise BadInput(f"{path}: {refusal}") from None
    u, v = (np.linspace(0, sizes[name] - 1, _PROBES) for name in ("width_px", "height_px"))
    if not np.isfinite(camera.unproject(np.stack(np.meshgrid(u, v), axis=-1))).all():
        raise BadInput(f"{path}: distortion: it cannot be inverted over the whole picture")
    return camera


def _size(path: Path, values: Mapping[str, Any], name: str) -> int:
    value = values[name]
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= _LARGEST_PX:
        raise BadInput(f"{path}: {name}: found {str(value)[:40]!r}, expected a whole number from 1 to {_LARGEST_PX}")
    return value


def _numbers(path: Path, values: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> np.ndarray:
    expected = f"expected {' x '.join(map(str, shape))} finite numbers"
    try:
        array = np.array(values[name], dtype=float)
    except (TypeError, ValueError):
        raise BadInput(f"{path}: {name}: found {str(values[name])[:40]!r}, {expected}") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise BadInput(f"{path}: {name}: found {str(values[name])[:40]!r}, {expected}")
    return array

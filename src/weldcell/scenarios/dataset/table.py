"""All truth and parameters as Parquet tables: a row a stripe point, and a row a frame.

Lengths are in millimetres, also the translations of the 4 x 4 transforms, which are lists of 16 numbers, row by row.
"""

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, get_args

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from weldcell.cell.configuration import DisturbanceKind
from weldcell.scenarios.dataset.plan import FramePlan, PlatePlan
from weldcell.sensor_sim.labels import FrameTruth, StripeTruth

FIRST_BOUNCE, SECOND_BOUNCE = 1, 2

_MM = 1e3


def stripe_table(truth: FrameTruth, frame: int, geom_names: Sequence[str]) -> pa.Table:
    """A row for each stripe point of a frame, those of the second bounce last."""
    parts = [(truth.stripe, FIRST_BOUNCE), (truth.ghosts, SECOND_BOUNCE)]
    return pa.concat_tables([_points(part, truth, frame, bounce, geom_names) for part, bounce in parts])


def frame_row(truth: FrameTruth, frame: FramePlan, plate: PlatePlan, file_name: str) -> dict[str, Any]:
    """What a frame is, its poses and models, and its features."""
    strength = {f"{kind.replace('-', '_')}_strength": 0.0 for kind in get_args(DisturbanceKind)}
    strength |= {f"{one.kind.replace('-', '_')}_strength": one.strength for one in frame.disturbances}
    plain = {name: value for name, value in vars(frame).items() if name not in ("number", "disturbances")}
    row = {
        "frame": frame.number,
        "file_name": file_name,
        "plate": plate.number,
        **{name: value for name, value in vars(plate).items() if name != "number"},
        **plain,
        **strength,
        "stripe_px": int(truth.stripe_mask.sum()),
        "ghost_px": int(truth.ghost_mask.sum()),
        **_models(truth),
    }
    for name, point, pixel, visibility in zip(
        truth.features.names,
        _MM * truth.features.points_camera,
        truth.features.pixels,
        truth.features.visibility,
        strict=True,
    ):
        row |= {f"{name}_{axis}_mm": float(value) for axis, value in zip("xyz", point, strict=True)}
        row |= {f"{name}_{axis}_px": float(value) for axis, value in zip("uv", pixel, strict=True)}
        row[f"{name}_visibility"] = int(visibility)
    return row


def parquet(tables: Iterable[pa.Table]) -> bytes:
    """A Parquet file with these tables as its row groups; the same tables give the same bytes."""
    content, writer = io.BytesIO(), None
    for table in tables:
        writer = writer or pq.ParquetWriter(content, table.schema, compression="zstd")
        writer.write_table(table, row_group_size=max(len(table), 1))
    if writer is not None:
        writer.close()
    return content.getvalue()


def frame_table(rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """The rows of all frames as a table."""
    return pa.Table.from_pylist(list(rows))


def _points(truth: StripeTruth, frame: FrameTruth, number: int, bounce: int, geom_names: Sequence[str]) -> pa.Table:
    count = len(truth.visibility)
    columns = {
        "frame": np.full(count, number, np.int32),
        "bounce": np.full(count, bounce, np.int8),
        "visibility": truth.visibility.astype(np.int8),
        "u_px": truth.pixels[:, 0],
        "v_px": truth.pixels[:, 1],
        "sigma_px": truth.sigma_px.astype(np.float32),
        "amplitude_grey": truth.amplitude_grey.astype(np.float32),
        **_coordinates("camera", "_mm", _MM * truth.points_camera),
        **_coordinates("base", "_mm", _MM * frame.T_base_camera.apply(truth.points_camera)),
        **_coordinates("normal_camera", "", truth.normals_camera.astype(np.float32)),
        "surface": pa.DictionaryArray.from_arrays(
            pa.array(truth.geom_id.astype(np.int32), mask=truth.geom_id < 0), list(geom_names)
        ),
    }
    return pa.table(columns)


def _coordinates(prefix: str, unit: str, points: Float[np.ndarray, "n 3"]) -> dict[str, Float[np.ndarray, "n"]]:
    return {f"{prefix}_{axis}{unit}": np.ascontiguousarray(points[:, k]) for k, axis in enumerate("xyz")}


def _models(truth: FrameTruth) -> dict[str, Any]:
    camera = truth.camera
    return {
        "T_base_flange_actual": _matrix_mm(truth.T_base_flange_actual),
        "T_base_flange_nominal": _matrix_mm(truth.T_base_flange_nominal),
        "T_flange_camera": _matrix_mm(truth.T_flange_camera),
        "T_base_part": _matrix_mm(truth.T_base_part),
        "width_px": camera.width_px,
        "height_px": camera.height_px,
        "camera_matrix": camera.matrix.ravel().tolist(),
        "distortion": camera.distortion.tolist(),
        "plane_normal_camera": truth.plane.normal_camera.tolist(),
        "plane_offset_mm": _MM * truth.plane.offset_m,
    }


def _matrix_mm(transform: RigidTransform) -> list[float]:
    matrix = transform.as_matrix()
    matrix[:3, 3] *= _MM
    return matrix.ravel().tolist()

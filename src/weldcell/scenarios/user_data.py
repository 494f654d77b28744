"""The user's own CSV files: poses of the flange and points of the sensor, checked where they come in.

Millimetres and degrees in the files, metres and radians from here on. An error names file, line and column.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from weldcell.cell.errors import BadInput
from weldcell.cell.frames import rigid_from
from weldcell.scenarios.csv_file import csv_number, csv_rows

_PLACE = ("x_mm", "y_mm", "z_mm")
_EULER = ("rx_deg", "ry_deg", "rz_deg")
_QUATERNION = ("qw", "qx", "qy", "qz")
_UNIT_TOLERANCE = 1e-3  # a unit quaternion printed with three digits after the point
_LARGEST_FILE_BYTES = 200_000_000

EULER_SEQUENCES = tuple(
    "".join(letters)
    for axes in ("XYZ", "xyz")
    for letters in product(axes, repeat=3)
    if letters[0] != letters[1] != letters[2]
)
"""SciPy's: upper case about the moving axes, lower case about the fixed ones."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Poses:
    """Flange poses by id, in the order of the file."""

    ids: tuple[str, ...]
    T_base_flange: RigidTransform


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """Points in the sensor's frame by id."""

    ids: tuple[str, ...]
    """One a row."""
    lines: tuple[int, ...]
    """Where each row stands in the file, counted from 1."""
    points_sensor: Float[np.ndarray, "n 3"]
    """Metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Table:
    ids: tuple[str, ...]
    lines: tuple[int, ...]
    columns: tuple[str, ...]
    values: Float[np.ndarray, "n columns"]

    def picked(self, names: tuple[str, ...]) -> Float[np.ndarray, "n k"]:
        return self.values[:, [self.columns.index(name) for name in names]]


def read_poses(path: Path, euler: str | None) -> Poses:
    """The poses of a file `id,x_mm,y_mm,z_mm` and `rx_deg,ry_deg,rz_deg` (with `euler`) or `qw,qx,qy,qz`."""
    table = _read(path, (_PLACE + _EULER, _PLACE + _QUATERNION))
    _refuse_twice(path, table)
    if "qw" in table.columns:
        if euler is not None:
            raise BadInput(f"{path}: found the columns {','.join(_QUATERNION)} and --euler, expected one of the two")
        rotation = _from_quaternions(path, table)
    else:
        if euler is None:
            raise BadInput(
                f"{path}: found {','.join(_EULER)} without --euler, expected the sequence, e.g. --euler XYZ "
                "(upper case: about the moving axes; lower case: about the fixed ones)"
            )
        rotation = Rotation.from_euler(checked_euler(euler), table.picked(_EULER), degrees=True)
    return Poses(ids=table.ids, T_base_flange=rigid_from(rotation, table.picked(_PLACE) * 1e-3))


def read_points(path: Path, *, once: bool) -> Points:
    """The points of a file `id,x_mm,y_mm,z_mm`; with `once`, every id has one row."""
    table = _read(path, (_PLACE,))
    if once:
        _refuse_twice(path, table)
    return Points(ids=table.ids, lines=table.lines, points_sensor=table.picked(_PLACE) * 1e-3)


def match_ids(poses_file: Path, poses: Poses, points_file: Path, points: Points) -> None:
    """Raises BadInput unless every pose has points and all points have a pose."""
    known = set(poses.ids)
    for line, name in zip(points.lines, points.ids, strict=True):
        if name not in known:
            raise BadInput(f"{points_file}, line {line}, column id: found {name!r}, which {poses_file} does not have")
    seen = set(points.ids)
    for name in poses.ids:
        if name not in seen:
            raise BadInput(f"{points_file}: found no row of id {name!r}, which {poses_file} has")


def checked_euler(sequence: str) -> str:
    """The sequence if it is one of SciPy's: three letters, all upper or all lower case, no neighbours alike."""
    if sequence not in EULER_SEQUENCES:
        raise BadInput(
            f"--euler: found {sequence!r}, expected three letters such as XYZ (about the moving axes) or xyz (about "
            "the fixed ones), no neighbours alike"
        )
    return sequence


def _read(path: Path, layouts: tuple[tuple[str, ...], ...]) -> _Table:
    rows = _rows(path)
    expected = " or ".join(",".join(("id", *layout)) for layout in layouts)
    if not rows:
        raise BadInput(f"{path}: found an empty file, expected the header {expected}")
    header_line, header = rows[0]
    columns = tuple(name.strip() for name in header)
    if not any(sorted(columns) == sorted(("id", *layout)) for layout in layouts):
        hint = " (separated by ';', expected ',')" if len(columns) == 1 and ";" in columns[0] else ""
        shown = ",".join(columns)[:80]
        raise BadInput(f"{path}, line {header_line}: found the header {shown!r}{hint}, expected {expected}")
    if len(rows) == 1:
        raise BadInput(f"{path}: found the header alone, expected rows below it")
    numeric = tuple(name for name in columns if name != "id")
    ids, lines, values = [], [], []
    for line, row in rows[1:]:
        cells = _cells(path, line, row, columns)
        if not cells["id"]:
            raise BadInput(f"{path}, line {line}, column id: found nothing, expected a name")
        ids.append(cells["id"])
        lines.append(line)
        values.append([csv_number(cells[name], f"{path}, line {line}, column {name}") for name in numeric])
    return _Table(ids=tuple(ids), lines=tuple(lines), columns=numeric, values=np.array(values))


def _rows(path: Path) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with the number of its line."""
    if not path.is_file():
        raise BadInput(f"{path}: found {'a folder' if path.is_dir() else 'no such file'}, expected a CSV file")
    if path.stat().st_size > _LARGEST_FILE_BYTES:
        raise BadInput(f"{path}: found {path.stat().st_size} bytes, expected at most {_LARGEST_FILE_BYTES}")
    return csv_rows(path.read_bytes(), str(path))


def _cells(path: Path, line: int, row: list[str], columns: tuple[str, ...]) -> dict[str, str]:
    if len(row) != len(columns):
        hint = ""
        if len(row) > len(columns):  # the first number that was cut in two, if it was that
            hint = f", the first too many after column {columns[-1]} (a comma as decimal sign? write 1.5, not 1,5)"
        elif len(row) < len(columns):
            hint = f", column {columns[len(row)]} is the first that is missing"
        raise BadInput(f"{path}, line {line}: found {len(row)} cells, expected {len(columns)}{hint}")
    return dict(zip(columns, (cell.strip() for cell in row), strict=True))


def _refuse_twice(path: Path, table: _Table) -> None:
    first: dict[str, int] = {}
    for line, name in zip(table.lines, table.ids, strict=True):
        if name in first:
            raise BadInput(f"{path}, line {line}, column id: found {name!r} again, it stands in line {first[name]}")
        first[name] = line


def _from_quaternions(path: Path, table: _Table) -> Rotation:
    quaternions = table.picked(_QUATERNION)
    lengths = np.linalg.norm(quaternions, axis=1)
    for line, length in zip(table.lines, lengths, strict=True):
        if abs(length - 1) > _UNIT_TOLERANCE:
            raise BadInput(
                f"{path}, line {line}, columns {','.join(_QUATERNION)}: found length {length:.4g}, expected 1"
            )
    return Rotation.from_quat(quaternions, scalar_first=True)

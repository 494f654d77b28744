"""A seam as a polyline: `x_mm,y_mm,z_mm` and, for several lines, a column `feature` (e.g. left, root, right)."""

import re
from pathlib import Path

import numpy as np

from weldcell.cell.errors import BadInput
from weldcell.models.own_part import SeamLines
from weldcell.scenarios.csv_file import csv_number, csv_rows
from weldcell.scenarios.user_cell.jail import bounded_bytes

_PLACE = ("x_mm", "y_mm", "z_mm")
_EXPECTED = "x_mm,y_mm,z_mm or feature,x_mm,y_mm,z_mm"
_MOST_ROWS, _MOST_BYTES = 20_000, 5_000_000
_FEATURE = re.compile(r"[a-z][a-z0-9_]{0,30}")


def read_seam(path: Path, where: str) -> SeamLines:
    """The lines of a seam's file, in the frame of the part's file; without a column `feature` the line is the root."""
    rows = _rows(path, where)
    line, header = rows[0]
    columns = [name.strip() for name in header]
    if sorted(columns) not in (sorted(_PLACE), sorted((*_PLACE, "feature"))):
        raise BadInput(f"{where}, line {line}: found the header {','.join(columns)[:80]!r}, expected {_EXPECTED}")
    points: dict[str, list[list[float]]] = {}
    for line, row in rows[1:]:
        if len(row) != len(columns):
            hint = " (a comma as decimal sign? write 1.5, not 1,5)" if len(row) > len(columns) else ""
            raise BadInput(f"{where}, line {line}: found {len(row)} cells, expected {len(columns)}{hint}")
        cells = dict(zip(columns, (cell.strip() for cell in row), strict=True))
        feature = cells.get("feature", "root")
        if not _FEATURE.fullmatch(feature):
            raise BadInput(
                f"{where}, line {line}, column feature: found {feature[:40]!r}, expected a word such as root"
            )
        points.setdefault(feature, []).append(
            [csv_number(cells[name], f"{where}, line {line}, column {name}") for name in _PLACE]
        )
    if not points:
        raise BadInput(f"{where}: found the header alone, expected a point a row")
    lines_m = {feature: 1e-3 * np.array(line) for feature, line in points.items()}
    for feature, line_m in lines_m.items():
        if not np.any(np.ptp(line_m, axis=0) > 0):
            raise BadInput(f"{where}: {feature}: found {len(line_m)} points at one place, expected a line")
    return SeamLines(lines_m=lines_m)


def _rows(path: Path, where: str) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with the number of its line."""
    rows = csv_rows(bounded_bytes(path, _MOST_BYTES, where), where)
    if not rows:
        raise BadInput(f"{where}: found an empty file, expected the header {_EXPECTED}")
    if len(rows) > _MOST_ROWS:
        raise BadInput(f"{where}: found {len(rows)} rows, expected at most {_MOST_ROWS}")
    return rows

"""Rows and numbers of the user's CSV files; what is wrong is refused by line and column."""

import csv
import re

from weldcell.cell.errors import BadInput

LARGEST = 1e6
"""Numbers beyond this are refused: a kilometre in millimetres."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


def csv_rows(content: bytes, where: str) -> list[tuple[int, list[str]]]:
    """The rows that hold anything, each with the number of its line; `where` names the file."""
    try:
        text = content.decode("utf-8-sig")  # reads a byte-order mark
    except UnicodeDecodeError:
        raise BadInput(f"{where}: found bytes that are not UTF-8 text, expected a CSV file") from None
    reader = csv.reader(text.splitlines(keepends=True), strict=True, skipinitialspace=True)
    try:
        return [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise BadInput(f"{where}, line {reader.line_num}: {error}, expected comma-separated values") from None


def csv_number(text: str, where: str) -> float:
    """The number that a cell holds; `where` names file, line and column."""
    if not _NUMBER.fullmatch(text):
        hint = " (the decimal sign is a point)" if re.fullmatch(r"[+-]?\d*,\d+", text) else ""
        raise BadInput(f"{where}: found {text[:40]!r}, expected a finite number{hint}")
    value = float(text)
    if not abs(value) <= LARGEST:
        raise BadInput(f"{where}: found {text[:40]}, expected at most {LARGEST:.0f} in size")
    return value

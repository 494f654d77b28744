"""Files that appear only when they are whole."""

import os
from pathlib import Path


def write_text(path: Path, text: str) -> None:
    """Writes the file (UTF-8, Unix line ends) as `write_bytes` does."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Writes the file under a temporary name beside its place, then renames it; makes the folder if need be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.unfinished")
    try:
        with unfinished.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())  # a full disk shows itself here at the latest
        unfinished.replace(path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise

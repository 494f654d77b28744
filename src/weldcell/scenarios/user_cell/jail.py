"""Files that another file names: only plain ones of bounded size, in its own folder or below."""

import os
import stat
from pathlib import Path, PurePosixPath, PureWindowsPath

from weldcell.cell.errors import BadInput

_ARCHIVES = {
    b"PK\x03\x04": "a zip archive",
    b"PK\x05\x06": "a zip archive",
    b"\x1f\x8b": "a gzip archive",
    b"BZh": "a bzip2 archive",
    b"\xfd7zXZ": "an xz archive",
    b"7z\xbc\xaf": "a 7-Zip archive",
    b"Rar!": "a RAR archive",
    b"\x28\xb5\x2f\xfd": "a zstd archive",
    b"\x93NUMPY": "a NumPy file (which may hold pickled objects)",
    b"\x80\x04\x95": "a pickle",
    b"\x80\x05\x95": "a pickle",
}
_TAR = b"ustar"


def shown(name: object) -> str:
    """A file's name on one line, shortened."""
    text = str(name)
    text = text if text.isprintable() else repr(text)
    return text if len(text) <= 200 else f"...{text[-197:]}"


def named_file(folder: Path, name: str, where: str) -> Path:
    """The file that `name` means in a folder; refused, before anything is opened, if it lies anywhere else."""
    pure = PurePosixPath(name.replace("\\", "/"))
    if not name or "\0" in name:
        raise BadInput(f"{where}: found {shown(repr(name))}, expected a file's name")
    if pure.is_absolute() or PureWindowsPath(name).drive or name.startswith("~") or "://" in name:
        raise BadInput(f"{where}: found {shown(repr(name))}, expected a name relative to the folder of this file")
    if ".." in pure.parts:
        raise BadInput(f"{where}: found {shown(repr(name))}, expected a file in the folder of this file or below")
    try:
        home = folder.resolve()
        path = (home / pure).resolve()
    except (OSError, RuntimeError) as error:
        raise BadInput(f"{where}: found {shown(repr(name))}, which leads nowhere ({error})") from None
    if not path.is_relative_to(home):
        raise BadInput(f"{where}: found {shown(repr(name))}, a link out of the folder of this file")
    return path


def bounded_bytes(path: Path, most_bytes: int, where: str) -> bytes:
    """The content of a plain file that is not an archive; refused if it is larger than that."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise BadInput(f"{where}: expected a plain file, found a folder, pipe or device")
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with os.fdopen(descriptor, "rb") as file:
            size = os.fstat(descriptor).st_size
            if size > most_bytes:
                raise BadInput(f"{where}: found {size} bytes, expected at most {most_bytes}")
            content = file.read(most_bytes + 1)
    except OSError as error:
        raise BadInput(f"{where}: expected a file, found: {error.strerror}") from None
    except ValueError as error:
        raise BadInput(f"{where}: expected a file's name, found: {error}") from None
    if len(content) > most_bytes:
        raise BadInput(f"{where}: found more than {most_bytes} bytes, expected at most that")
    kind = next((kind for magic, kind in _ARCHIVES.items() if content.startswith(magic)), None)
    if kind is None and content[257:262] == _TAR:
        kind = "a tar archive"
    if kind:
        raise BadInput(f"{where}: found {kind}, expected a file of its own (unpack it first)")
    return content

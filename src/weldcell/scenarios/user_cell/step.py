"""STEP solids made triangles by cascadio (OpenCASCADE), an extra of this package, in a process of its own.

OpenCASCADE is a large program in C++: a file that crashes or stalls it then ends that process, not this one.
"""

import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from weldcell.cell.errors import BadInput, NotReady

_LARGEST_BYTES = 50_000_000
_LONGEST_S = 60.0
_CHORD = 0.01  # how far a triangle may stray from a curved face, in the file's unit, mostly mm
_TURN_RAD = 0.1  # and by which angle
_CONVERT = (
    "import sys, cascadio; "
    f"cascadio.step_to_glb(sys.argv[1], sys.argv[2], tol_linear={_CHORD}, tol_angular={_TURN_RAD})"
)


def glb_of_step(content: bytes, where: str) -> bytes:
    """The solids of a STEP file as GLB in metres, each face triangulated by itself (their corners not shared)."""
    if not content.lstrip().startswith(b"ISO-10303-21"):
        raise BadInput(f"{where}: found no STEP header, expected ISO-10303-21")
    if b"END-ISO-10303-21" not in content[-200:]:
        raise BadInput(f"{where}: found no end of the STEP file (truncated), expected END-ISO-10303-21")
    if len(content) > _LARGEST_BYTES:
        raise BadInput(f"{where}: found {len(content)} bytes of STEP, expected at most {_LARGEST_BYTES}")
    if find_spec("cascadio") is None:
        raise NotReady(f"{where}: STEP needs the package cascadio: pip install 'weldcell[step]' (or export as STL)")
    with tempfile.TemporaryDirectory() as folder:
        solid, mesh = Path(folder) / "part.step", Path(folder) / "part.glb"
        solid.write_bytes(content)
        try:
            done = subprocess.run(
                [sys.executable, "-c", _CONVERT, solid, mesh], capture_output=True, timeout=_LONGEST_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise BadInput(f"{where}: not triangulated within {_LONGEST_S:.0f} s, expected a simpler solid") from None
        if done.returncode or not mesh.is_file():
            raise BadInput(f"{where}: cannot be read as STEP (the converter ended with {done.returncode})")
        return mesh.read_bytes()

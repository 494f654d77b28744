"""What a machine without OpenGL libraries is told."""

import subprocess
import sys

WITHOUT_OPENGL = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name == "OpenGL" or name.startswith("OpenGL."):
            raise ImportError("libEGL.so.1: cannot open shared object file")

sys.meta_path.insert(0, Missing())
from weldcell.scenarios.command_line import main
sys.exit(main(["run", "boss", "--out", sys.argv[1]]))
"""


def test_missing_libraries_are_named_in_one_line_with_the_packages(tmp_path):
    place = tmp_path / "run"
    command = [sys.executable, "-c", WITHOUT_OPENGL, str(place)]
    done = subprocess.run(command, capture_output=True, text=True, env={"PATH": "/usr/bin:/bin"}, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "libEGL.so.1" in done.stderr
    assert "apt-get install libegl1 libopengl0 libgl1-mesa-dri" in done.stderr
    assert not place.exists()

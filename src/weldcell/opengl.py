"""MuJoCo's first import: without a screen it renders through EGL, for which the system needs libraries."""

import os

from weldcell.cell.errors import NotReady

OPENGL_HELP = (
    "rendering needs OpenGL through EGL, which did not start ({cause}). "
    "On Debian or Ubuntu: apt-get install libegl1 libopengl0 libgl1-mesa-dri"
)

os.environ.setdefault("MUJOCO_GL", "egl")  # read when MuJoCo is first imported, and never again
try:
    import mujoco  # noqa: F401
except Exception as error:  # ctypes, PyOpenGL and MuJoCo each raise their own kind
    raise NotReady(OPENGL_HELP.format(cause=str(error) or type(error).__name__)) from error

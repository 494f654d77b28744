"""No screen is needed: must be set before mujoco's first import."""

import os

os.environ.setdefault("MUJOCO_GL", "egl")

import os

os.environ.setdefault("MUJOCO_GL", "egl")  # must stand before mujoco's first import: no screen is needed

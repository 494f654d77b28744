import weldcell.opengl  # noqa: F401 (before mujoco is imported anywhere else)

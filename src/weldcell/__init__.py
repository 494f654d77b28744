"""A virtual robotic welding cell with a laser-line sensor and exact truth."""

__version__ = "0.1.0"

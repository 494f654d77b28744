"""Welding along a seam in closed loop: the moving part, the torch on its path, what guides it, and what came of it."""

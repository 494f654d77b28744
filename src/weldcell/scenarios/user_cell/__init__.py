"""The user's own part and robot, read from files that are checked, bounded and kept to their folder."""

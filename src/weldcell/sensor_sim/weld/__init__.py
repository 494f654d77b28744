"""The light of the weld in the sensor's picture: arc, spatter and fume."""

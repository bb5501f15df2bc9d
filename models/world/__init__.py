"""The simulated world: a road, and the radar and the camera that see it."""

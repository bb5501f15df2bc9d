"""Measurement: error against run time, with the goals it is held to."""

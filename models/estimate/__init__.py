"""Estimation of a sensor's noise level, its kind and its uncertainty."""

"""Degradations of camera frames and radar scans: draw the parameters, then apply them."""

"""Training of the networks that ship in ``models/weights``."""

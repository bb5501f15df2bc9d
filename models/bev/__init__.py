"""Road users in bird's-eye view: two simple detectors, the truth, and how far they are apart."""

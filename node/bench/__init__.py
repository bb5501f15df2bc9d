"""Benchmarks that need the node: each has ``run(quick) -> Iterator[Point | Goal]``."""

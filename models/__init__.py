"""Floor 3: mathematics on arrays; no threads, no sockets, no clock that paces."""

"""Floor 4: everything with a clock, a thread or a socket."""

"""Floor 1: what is on the wire, as DBC files and the codec compiled from them."""

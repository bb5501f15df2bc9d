"""Floor 2: the hardware's edge, where bytes become arrays and arrays become bytes."""

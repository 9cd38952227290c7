"""Planning measurements: optimal directions, counting times, and the order in which the axes go."""

"""How uncertain values of f are between readings, and those of a fitted model."""

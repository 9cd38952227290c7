"""Readings of a table that should be equal, and the readings nearest to a direction."""

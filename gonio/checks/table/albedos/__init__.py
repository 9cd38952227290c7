"""Directional albedos of tables by layout: on grids, of lists, of both sides, and with the help of a model."""

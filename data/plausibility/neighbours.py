"""Readings that follow each other along an axis, and how far each is off its neighbours."""

import numpy as np

from gonio.data.table import Table

SAME_LINE = 1e-6
"""Radians by which the other angles of a list's readings may differ along a line."""


def windows(table: Table, length: int, most: int, shortest: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Cells (K, length) that follow each other along an axis and their places on it, radians, for each axis.

    Args:
        table: readings; of a list lines along theta_o count, where all other angles are equal.
        length: readings of a window.
        most: windows of an axis; of more, a random choice.
        shortest: nodes of the axes that count, at least `length`.
    """
    rng, step = np.random.default_rng(0), np.arange(length)
    if not table.layout.gridded:
        theta_i, phi_i, theta_o, phi_o = (np.asarray(a, float).ravel() for a in table.layout.angles())
        order = np.lexsort((theta_o, *(np.round(a, 6) for a in (phi_o, phi_i, theta_i))))
        lines = np.stack([theta_i, phi_i, phi_o])[:, order]
        first = np.flatnonzero((np.abs(lines[:, length - 1 :] - lines[:, : 1 - length]) < SAME_LINE).all(axis=0))
        if first.size > most:
            first = rng.choice(first, most, replace=False)
        cells = order[first[:, None] + step]
        return [(cells, theta_o[cells])]
    shape, rows = table.layout.shape, []
    for axis, nodes in enumerate(table.layout.axes.values()):
        if nodes.size < shortest:
            continue
        starts = tuple(size - (length - 1) * (k == axis) for k, size in enumerate(shape))
        number = int(np.prod(starts))
        chosen = np.arange(number) if number <= most else rng.integers(number, size=most)
        index = list(np.unravel_index(chosen, starts))
        along = index[axis][:, None] + step
        others = [np.broadcast_to(i[:, None], along.shape) for i in index]
        others[axis] = along
        rows.append((np.ravel_multi_index(tuple(others), shape), np.asarray(nodes, float)[along]))
    return rows


def cubic_weights(places: np.ndarray) -> np.ndarray:
    """Weights (K, 5) of the difference of the middle reading from the cubic through the others [Lagrange]."""
    weight = np.ones_like(places)
    others = (0, 1, 3, 4)
    for j in others:
        for m in others:
            if m != j:
                weight[:, j] *= (places[:, 2] - places[:, m]) / (places[:, j] - places[:, m])
        weight[:, j] *= -1.0
    return weight

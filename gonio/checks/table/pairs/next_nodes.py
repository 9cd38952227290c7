"""By how much the readings of a grid change from node to node."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gonio.checks.table.pairs.columns import readings_of
from gonio.data.table import Table


class Change(NamedTuple):
    """From readings to those at the next nodes of an axis, to the side that changes more: 1/sr, (n, C), 0 for none."""

    size: np.ndarray
    larger: np.ndarray
    """The larger one of both readings."""
    distance: np.ndarray
    """(n,) about radians between both pairs of directions, the nearer side's."""


def changes_to_next_nodes(table: Table, cells: np.ndarray) -> Iterator[Change]:
    """The changes of readings (n,) of a grid along each of its axes."""
    layout, nodes = table.layout, np.unravel_index(cells, table.layout.shape)
    f, here = readings_of(table, cells)[0], np.concatenate(layout.directions_at(cells)).reshape(6, -1)
    for axis, (name, size) in enumerate(zip(layout.dims, layout.shape, strict=True)):
        if size == 1:
            continue
        most, larger, nearest = np.zeros(f.shape), np.abs(f), np.full(cells.size, np.inf)
        for step in (-1, 1):
            moved = nodes[axis] + step
            moved = moved % size if layout.periods[name] is not None else np.clip(moved, 0, size - 1)
            other = np.ravel_multi_index([moved if k == axis else n for k, n in enumerate(nodes)], layout.shape)
            some, back = np.unique(other, return_inverse=True)
            there = readings_of(table, some)[0][back]
            most, larger = np.fmax(most, np.abs(there - f)), np.fmax(larger, np.abs(there))
            apart = np.concatenate(layout.directions_at(other)).reshape(6, -1) - here
            distance = np.sqrt(np.sum(apart[:3] ** 2, axis=0)) + np.sqrt(np.sum(apart[3:] ** 2, axis=0))
            nearest = np.where(distance > 0, np.minimum(nearest, distance), nearest)
        yield Change(most, larger, nearest)


def change_to_next_nodes(table: Table, cells: np.ndarray) -> np.ndarray:
    """The largest difference of readings (n,) of a grid from those at the next nodes of any axis, 1/sr: (n, C).

    A peak that such a reading stands on is as narrow as the grid: beside the exchanged directions it may lie between
    the nodes.
    """
    none = np.zeros((cells.size, len(table.channels)))
    return np.max([none, *(change.size for change in changes_to_next_nodes(table, cells))], axis=0)

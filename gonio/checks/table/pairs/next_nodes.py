"""By how much the readings of a grid change from node to node."""

import numpy as np

from gonio.checks.table.pairs.columns import readings_of
from gonio.data.table import Table


def change_to_next_nodes(table: Table, cells: np.ndarray) -> np.ndarray:
    """The largest difference of readings (n,) of a grid from those at the next nodes of any axis, 1/sr: (n, C).

    A peak that such a reading stands on is as narrow as the grid: beside the exchanged directions it may lie between
    the nodes.
    """
    layout, most = table.layout, np.zeros((cells.size, len(table.channels)))
    reading, nodes = readings_of(table, cells)[0], np.unravel_index(cells, layout.shape)
    for axis, (name, size) in enumerate(zip(layout.dims, layout.shape, strict=True)):
        for step in (-1, 1) if size > 1 else ():
            moved = nodes[axis] + step
            moved = moved % size if layout.periods[name] is not None else np.clip(moved, 0, size - 1)
            other = np.ravel_multi_index([moved if k == axis else n for k, n in enumerate(nodes)], layout.shape)
            some, back = np.unique(other, return_inverse=True)
            most = np.fmax(most, np.abs(readings_of(table, some)[0][back] - reading))
    return most

"""Readings of a table by channel, a few channels at a time: a large table is never held whole."""

import numpy as np

from gonio.data.flags import Flag
from gonio.data.table import Table

HELD_BYTES = 64 << 20
"""Of readings that are held at a time, but for one channel at the least."""
SHARE_HELD = 16
"""Of a table that is read again for each few channels so much of its bytes is held at a time, up to `MOST_HELD`."""
MOST_HELD = 512 << 20


class ReadingColumns:
    """f and u_f of some cells of a table, channel by channel.

    Args:
        table: the table; values that lie in its file are read in blocks.
        cells: their C-order numbers, increasing, (n,); None for all.
        held_bytes: of readings that are held at a time.
    """

    def __init__(self, table: Table, cells: np.ndarray | None = None, held_bytes: int | None = None) -> None:
        self._table, self._cells = table, cells
        self.size = table.layout.size if cells is None else cells.size
        per_channel = 8 * self.size * (1 if table.u_f is None else 2)
        if held_bytes is None:
            stored = per_channel * len(table.channels) * (table.layout.size // max(self.size, 1))
            held_bytes = int(np.clip(stored // SHARE_HELD, HELD_BYTES, MOST_HELD))
        self._group = int(np.clip(held_bytes // max(per_channel, 1), 1, len(table.channels)))
        self._first = -1
        self._f = self._u = np.zeros((0, 0))

    def of_channel(self, channel: int) -> tuple[np.ndarray, np.ndarray]:
        """(f, u_f) of a channel, (n,) each, float64: f is NaN where it is not valid, u_f where it is unknown."""
        first = channel - channel % self._group
        if first != self._first:
            self._read(first)
        return self._f[channel - first], self._u[channel - first]

    def _read(self, first: int) -> None:
        table, last = self._table, min(first + self._group, len(self._table.channels))
        shape, unknown = (last - first, self.size), table.u_f is None
        if self._f.shape != shape:
            self._f = np.empty(shape)
            self._u = np.broadcast_to(np.nan, shape) if unknown else np.empty(shape)
        for start, stop in table.blocks():
            some, put = slice(None), slice(start, stop)
            if self._cells is not None:
                put = slice(*np.searchsorted(self._cells, (start, stop)))
                some = self._cells[put] - start
                if not some.size:
                    continue
            block = table.read_values(start, stop)
            for k, channel in enumerate(range(first, last)):
                f = self._f[k, put]
                f[...] = block["f"][some, channel]
                f[block["flag"][some, channel] != Flag.VALID] = np.nan
                if not unknown:
                    self._u[k, put] = block["u_f"][some, channel]
        self._first = first


def readings_of(table: Table, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(f, u_f) of cells in any order, each (n, channels), float64; f is NaN where it is not valid."""
    values = table.values_at(cells)
    return np.where(values["flag"] == Flag.VALID, values["f"].astype(float), np.nan), values["u_f"].astype(float)
